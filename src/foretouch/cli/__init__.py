"""The command line: `foretouch COMMAND`. Every command imports what it needs when it runs."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the `foretouch` command; a mistake of the user ends it with one line and exit code 2."""
    try:
        from foretouch.cli.app import app
        from foretouch.errors import ForetouchError

        try:
            app()
        except ForetouchError as error:
            sys.stderr.write(f"foretouch: {error}\n")
            sys.exit(2)
    except KeyboardInterrupt:  # also while imports still run
        sys.stderr.write("foretouch: interrupted\n")
        sys.exit(130)


__all__ = ["main"]

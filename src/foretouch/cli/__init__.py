"""The command line: `foretouch COMMAND`. Every command imports what it needs when it runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from foretouch.errors import ForetouchError

POOLS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Sizes of the libraries' thread pools, by variable of the environment."""

INTERRUPTED = 130
"""Exit code after Ctrl-C, as a shell gives it for a process ended by SIGINT (2): 128 + 2."""


def main() -> None:
    """Run the `foretouch` command; a mistake of the user ends it with one line and exit code 2.

    Pools of threads are bounded to one, unless the environment says otherwise: our matrices are small, and a loop in
    real time, or the job of another process, wants the other core.
    """
    for pool in POOLS:
        os.environ.setdefault(pool, "1")
    try:
        import typer

        from foretouch.cli.app import app
        from foretouch.errors import ForetouchError, SideError

        try:
            code = app(standalone_mode=False)  # that of `typer.Exit`, else None
            sys.exit(code)
        except typer.Abort:
            sys.stderr.write("foretouch: aborted\n")
            sys.exit(1)
        except typer.TyperException as error:
            sys.stderr.write(usage_line(error))
            sys.exit(2)
        except SideError as error:
            import traceback

            if not isinstance(error.__cause__, ForetouchError):
                traceback.print_exception(error.__cause__)  # for the author of a driver
            sys.stderr.write(f"foretouch: {error}\n")
            sys.exit(1)
        except ForetouchError as error:
            sys.stderr.write(f"foretouch: {as_typed(error, sys.argv[1:])}\n")
            sys.exit(2)
        except BrokenPipeError:
            raise  # the reader has gone: Typer ends quietly
        except OSError as error:
            if not _was_output(error):
                raise
            sys.stderr.write(f"foretouch: the output cannot be written: {error.strerror or error}\n")
            sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - what is left in it would be tried again at the end
            sys.exit(2)
        except SystemExit as end:
            if end.code == INTERRUPTED:  # Typer ends so, without a word
                raise KeyboardInterrupt from None
            raise
        except Exception as error:
            if _was_interrupted(error):
                raise KeyboardInterrupt from None
            raise
    except KeyboardInterrupt:  # also while imports still run
        sys.stderr.write("foretouch: interrupted\n")
        sys.exit(INTERRUPTED)


def as_typed(error: ForetouchError, words: Sequence[str]) -> str:
    """Text of an error; a setting in it has the name of the option by which it was given."""
    name = getattr(error, "name", "")
    option = f"--{name.replace('_', '-')}"
    given = bool(name) and any(word == option or word.startswith(f"{option}=") for word in words)
    return option + str(error).removeprefix(name) if given else str(error)


def usage_line(error: Exception) -> str:
    """One line on a command that was typed wrong; the whole help where a group was called without a command."""
    message = str(getattr(error, "format_message", lambda: error)())
    context = getattr(error, "ctx", None)
    if "Usage:" in message:
        return f"{message}\n"
    hint = f" (see `{context.command_path} --help`)" if context is not None else ""
    return f"foretouch: {' '.join(message.split()).rstrip('.')}{hint}\n"


def _was_output(error: OSError) -> bool:
    """Whether it was raised where the output is written, and not by a file or by a driver."""
    frame = error.__traceback__
    while frame is not None and frame.tb_next is not None:
        frame = frame.tb_next
    return frame is not None and frame.tb_frame.f_code.co_name == "echo"


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: a module being imported then may raise another one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


__all__ = ["INTERRUPTED", "main"]

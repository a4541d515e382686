"""One benchmark in this process: `python -m foretouch.bench NAME [--full]` prints its rows as one line of JSON."""

from __future__ import annotations

import sys

import msgspec

from foretouch.bench.benchmarks import benchmark
from foretouch.bench.timing import Row, Scope
from foretouch.errors import MissingExtraError
from foretouch.files.children import interruptible


def main(name: str, *options: str) -> None:
    """Measure one benchmark, with ``--full`` or without; print, and say what is left out on the error stream."""

    def say(text: str) -> None:
        sys.stderr.write(f"foretouch: {text}\n")

    rows: list[Row] = []
    try:
        with interruptible():
            rows = benchmark(name)(Scope("--full" in options, say))
    except KeyboardInterrupt:  # whoever started it reports it
        sys.exit(130)
    except MissingExtraError as error:
        say(f"{name} is left out: {error}")
    sys.stdout.write(msgspec.json.encode(rows).decode() + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])

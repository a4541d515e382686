"""Many recordings by `foretouch compare`, two processes at a time against one."""

from __future__ import annotations

import tempfile
from pathlib import Path

from foretouch.bench.children import measure_process
from foretouch.bench.recorded import write_recording
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread

__all__ = ["measure"]

RECORDINGS, SECONDS = 6, 20.0
FULL_RECORDINGS, FULL_SECONDS = 1_000, 60.0
ROUNDS = 2

CHOSEN = ("--models", "kelvin-voigt", "--estimators", "rls")
"""The cheapest law: what is compared is the fan-out."""


def measure(scope: Scope) -> list[Row]:
    """How many times as fast on two jobs; rounds run after another, one job first."""
    count, seconds = (FULL_RECORDINGS, FULL_SECONDS) if scope.full else (RECORDINGS, SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number}.parquet" for number in range(count)]
        for path in paths:
            write_recording(path, seconds)

        def jobs(number: int) -> Contestant:
            command = ["-m", "foretouch", "compare", *map(str, paths), *CHOSEN, "--jobs", str(number), "--json"]
            return Contestant(lambda: measure_process(command))

        times = interleave({"1": jobs(1), "2": jobs(2)}, 1 if scope.full else ROUNDS, warm=False)
    scaled = "" if scope.full else f" (asked: {FULL_RECORDINGS} of {FULL_SECONDS:g} s)"
    what = f"compare, {count} recordings of {seconds:g} s{scaled}"
    return [
        Row.of(f"{what}: 2 jobs, times as fast as 1", ratio(times, "1", "2"), "x", 1.7, at_least=True),
        *(Row.of(f"{what}: jobs {number}", spread(times[number]), "s") for number in times),
    ]

"""Many recordings by `foretouch compare`, two processes at a time against one."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from foretouch.bench.children import measure_process
from foretouch.bench.recorded import write_recording
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread

RECORDINGS, FULL_RECORDINGS, SECONDS = 40, 1_000, 60.0
"""So many that a process's start, some 2 s, is little beside its share of the work, some 20 s; what is asked for takes
half an hour. Their length."""

ROUNDS = 2
"""So that each goes first once."""

CHOSEN = ("--models", "kelvin-voigt", "--estimators", "rls")
"""The cheapest law: what is compared is the fan-out."""


def measure(scope: Scope) -> list[Row]:
    """How many times as fast on two jobs; each first once."""
    count = FULL_RECORDINGS if scope.full else RECORDINGS
    with tempfile.TemporaryDirectory() as folder:
        paths = write_recordings(Path(folder), count, SECONDS)

        def jobs(number: int) -> Contestant:
            command = ["-m", "foretouch", "compare", *map(str, paths), *CHOSEN, "--jobs", str(number), "--json"]
            return Contestant(lambda: measure_process(command))

        times = interleave({"1": jobs(1), "2": jobs(2)}, ROUNDS, warm=False)
    scaled = "" if scope.full else f" (asked: {FULL_RECORDINGS})"
    what = f"compare, {count} recordings of {SECONDS:g} s{scaled}"
    return [
        Row.of(f"{what}: 2 jobs, times as fast as 1", ratio(times, "1", "2"), "x", 1.7, at_least=True),
        *(Row.of(f"{what}: jobs {number}", spread(times[number]), "s") for number in times),
    ]


def write_recordings(folder: Path, count: int, seconds: float) -> list[Path]:
    """The same press so many times, each in a file of its own: who compares them cannot know.

    Args:
        folder: For the files.
        count: How many.
        seconds: Length of each.
    """
    paths = [folder / f"{number}.parquet" for number in range(count)]
    write_recording(paths[0], seconds)
    for path in paths[1:]:
        shutil.copyfile(paths[0], path)
    return paths

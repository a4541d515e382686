"""`foretouch identify` on an hour of samples at 1 kHz, as a user runs it: start-up, reading and learning.

An hour as CSV or Parquet is measured. As MCAP it would take long to write first, so that it is foretold, short of
``--full``, by a line through recordings of 1 and of 10 minutes, each the least of some runs. What is read again comes
from the samples that are kept beside recordings that are large enough, as that of 10 minutes is and that of 1 minute is
not: the other end of its line is a recording of 1 s, which is the start of a process and little else.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from foretouch.bench.children import Ended, measure_process
from foretouch.bench.recorded import COLUMNS, RATE, write_recording
from foretouch.bench.rows import Row, Scope
from foretouch.errors import MissingExtraError

__all__ = ["foretold", "measure"]

BRIEF, SHORT, LONG, HOUR = 1.0, 60.0, 600.0, 3600.0
"""Lengths of recordings [s]."""

RUNS = 3
"""Of each recording from which an hour is foretold; noise only adds."""

REACHES = {"CSV": (".csv", 6.0), "Parquet": (".parquet", 3.0), "MCAP": (".mcap", 60.0)}
"""Ending, and what an hour is to take at most [s]."""

REACH_AGAIN = 3.0
"""And MCAP read again."""

LARGEST_SHARE = 3.0
"""Most memory over that of the columns."""

CACHE = "by the samples kept beside it"


def foretold(short: tuple[float, float], long: tuple[float, float]) -> float:
    """What an hour takes, by a line through two recordings.

    Args:
        short: Length [s], and what it took.
        long: The same of a longer one.
    """
    return long[1] + (long[1] - short[1]) * (HOUR - long[0]) / (long[0] - short[0])


def measure(scope: Scope) -> list[Row]:
    """Seconds and memory of each format; those whose package is missing are left out."""
    rows = []
    for name, (ending, reach) in REACHES.items():
        with tempfile.TemporaryDirectory() as folder:
            try:
                rows += _of_format(Path(folder), name, ending, reach, scope.full)
            except MissingExtraError as error:
                scope.say(f"the rows of {name} are left out: {error}")
    return rows


def _of_format(folder: Path, name: str, ending: str, reach: float, full: bool) -> list[Row]:
    what = f"identify 1 h at 1 kHz, {name}"
    read_twice = ending == ".mcap"
    brief, _ = _identify(folder, ending, BRIEF, 1, read_twice=False)
    if full or not read_twice:
        first, again = _identify(folder, ending, HOUR, 1, read_twice=read_twice)
        seconds, seconds_again, length, how, how_again = first.seconds, again.seconds, HOUR, "", ""
    else:
        seconds, seconds_again, first = _foretold(folder, ending)
        length, how, how_again = LONG, " (foretold from 1 and 10 min)", " (foretold from 1 s and 10 min)"
    share = (first.peak - brief.peak) / ((length - BRIEF) * RATE * 8 * COLUMNS)
    of = "" if length == HOUR else " (of 10 min)"
    rows = [
        Row(f"{what}: memory over that of the columns{of}", share, "x", LARGEST_SHARE),
        Row(f"{what}{how}", seconds, "s", reach),
    ]
    if read_twice:
        rows.append(Row(f"{what}, read again {CACHE}{how_again}", seconds_again, "s", REACH_AGAIN))
    return rows


def _foretold(folder: Path, ending: str) -> tuple[float, float, Ended]:
    """Seconds of an hour at first and read again, and the run of the longest recording."""
    brief, _ = _identify(folder, ending, BRIEF, RUNS, read_twice=False)
    short, _ = _identify(folder, ending, SHORT, RUNS, read_twice=False)
    long, again = _identify(folder, ending, LONG, RUNS, read_twice=True)
    at_first = foretold((SHORT, short.seconds), (LONG, long.seconds))
    return at_first, foretold((BRIEF, brief.seconds), (LONG, again.seconds)), long


def _identify(folder: Path, ending: str, seconds: float, runs: int, *, read_twice: bool) -> tuple[Ended, Ended]:
    """The quickest run at first and that of the recording read again, or at first too where it is not."""
    path = folder / f"press-{seconds:g}{ending}"
    write_recording(path, seconds)
    command = ["-m", "foretouch", "identify", str(path), "--json"]
    first, again = [], []
    for _ in range(runs):
        first.append(measure_process(command))
        if read_twice:
            again.append(measure_process(command))
        for kept in folder.iterdir():  # beside it, so that the next run reads the recording
            if kept != path:
                kept.unlink()
    path.unlink()
    quickest = min(first, key=lambda one: one.seconds)
    return quickest, min(again, key=lambda one: one.seconds) if again else quickest

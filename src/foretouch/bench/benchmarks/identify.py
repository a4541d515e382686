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

BRIEF, SHORT, LONG, HOUR = 1.0, 60.0, 600.0, 3600.0
"""Lengths of recordings [s]."""

RUNS = 5
"""Of each recording from which an hour is foretold, by turns; noise only adds."""

REACHES = {"CSV": (".csv", 6.0), "Parquet": (".parquet", 3.0), "MCAP": (".mcap", 60.0)}
"""Ending, and what an hour is to take at most [s]."""

REACH_AGAIN = 3.0
"""And MCAP read again."""

LARGEST_SHARE = 3.0
"""Most memory over that of the columns."""

CACHE = "by the samples kept beside it"


def foretold(short: tuple[float, float], long: tuple[float, float]) -> float:
    """What an hour takes, by a line through two recordings; one that falls is noise, and taken as level.

    Args:
        short: Length [s], and what it took.
        long: The same of a longer one.
    """
    return long[1] + max(0.0, long[1] - short[1]) * (HOUR - long[0]) / (long[0] - short[0])


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
    kept = ending == ".mcap"
    lengths = (BRIEF, HOUR) if full or not kept else (BRIEF, SHORT, LONG)
    runs = 1 if lengths[-1] == HOUR else RUNS
    first, again = _identify(folder, ending, lengths, runs, kept)
    seconds, seconds_again = first[lengths[-1]].seconds, again.seconds
    of = how = how_again = ""
    if lengths[-1] != HOUR:
        seconds_again = foretold((BRIEF, first[BRIEF].seconds), (LONG, seconds_again))
        seconds = foretold((SHORT, first[SHORT].seconds), (LONG, seconds))
        of, quickest = " (of 10 min)", f"the least of {runs} runs"
        how, how_again = f" (foretold from 1 and 10 min, {quickest})", f" (foretold from 1 s and 10 min, {quickest})"
    share = (first[lengths[-1]].peak - first[BRIEF].peak) / ((lengths[-1] - BRIEF) * RATE * 8 * COLUMNS)
    rows = [
        Row(f"{what}: memory over that of the columns{of}", share, "x", LARGEST_SHARE),
        Row(f"{what}{how}", seconds, "s", reach, rounds=runs),
    ]
    if kept:
        rows.append(Row(f"{what}, read again {CACHE}{how_again}", seconds_again, "s", REACH_AGAIN, rounds=runs))
    return rows


def _identify(
    folder: Path, ending: str, lengths: tuple[float, ...], runs: int, kept: bool
) -> tuple[dict[float, Ended], Ended]:
    """The quickest run of each length, which take turns, and the quickest of the last read again, if that is `kept`."""
    paths = {seconds: folder / f"press-{seconds:g}{ending}" for seconds in lengths}
    for seconds, path in paths.items():
        write_recording(path, seconds)
    first: dict[float, list[Ended]] = {seconds: [] for seconds in lengths}
    again: list[Ended] = []
    for _ in range(runs):
        for seconds, path in paths.items():
            command = ["-m", "foretouch", "identify", str(path), "--json"]
            first[seconds].append(measure_process(command))
        if kept:
            again.append(measure_process(command))
        for beside in set(folder.iterdir()) - set(paths.values()):  # so that the next run reads the recording
            beside.unlink()
    quickest = {seconds: min(ended, key=_seconds) for seconds, ended in first.items()}
    return quickest, min(again, key=_seconds, default=quickest[lengths[-1]])


def _seconds(ended: Ended) -> float:
    return ended.seconds

"""`foretouch identify` on an hour of samples at 1 kHz, as a user runs it: start-up, reading and learning.

Recordings of 10 s and of 1 minute are measured first. Where what they foretell of an hour is long, the row is that,
short of `--full`: the longer one and 59 minutes more at the pace between both.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from foretouch.bench.children import Ended, measure_process
from foretouch.bench.recorded import COLUMNS, RATE, write_recording
from foretouch.bench.rows import Row, Scope

__all__ = ["foretold", "measure"]

SHORT, LONG, HOUR = 10.0, 60.0, 3600.0
"""Lengths of recordings [s]."""

PATIENCE = 15.0
"""An hour that is foretold to take longer [s] is measured with ``--full`` alone."""

REACHES = {"CSV": (".csv", 6.0, None), "Parquet": (".parquet", 3.0, None), "MCAP": (".mcap", 60.0, 3.0)}
"""Ending, and what an hour is to take at most [s], at first and read again."""

LARGEST_SHARE = 3.0
"""Most memory over that of the columns."""


def foretold(short: float, long: float) -> float:
    """What an hour takes, by what 10 s and 1 minute took."""
    return long + (long - short) * (HOUR - LONG) / (LONG - SHORT)


def measure(scope: Scope) -> list[Row]:
    """Seconds and memory of each format."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (ending, reach, again) in REACHES.items():
            rows += _of_format(Path(folder), name, ending, (reach, again), scope.full)
    return rows


def _of_format(folder: Path, name: str, ending: str, reaches: tuple[float, float | None], full: bool) -> list[Row]:
    measured = {seconds: _identify(folder, ending, seconds) for seconds in (SHORT, LONG)}
    first, second = ([measured[seconds][turn] for seconds in (SHORT, LONG)] for turn in (0, 1))
    seconds = [foretold(short.seconds, long.seconds) for short, long in (first, second)]
    column_bytes = (LONG - SHORT) * RATE * 8 * COLUMNS
    share = (first[1].peak - first[0].peak) / column_bytes
    what, how = f"identify 1 h at 1 kHz, {name}", " (foretold from 10 s and 1 min)"
    if full or seconds[0] < PATIENCE:
        hour = _identify(folder, ending, HOUR)
        seconds, how = [one.seconds for one in hour], ""
        share = (hour[0].peak - first[0].peak) / ((HOUR - SHORT) * RATE * 8 * COLUMNS)
    rows = [
        Row(f"{what}: memory over that of the columns{how}", share, "x", LARGEST_SHARE),
        Row(f"{what}{how}", seconds[0], "s", reaches[0]),
    ]
    if reaches[1] is not None:
        rows.append(Row(f"{what}, read again{how}", seconds[1], "s", reaches[1]))
    return rows


def _identify(folder: Path, ending: str, seconds: float) -> tuple[Ended, Ended]:
    """A fresh file, twice."""
    path = folder / f"press-{seconds:g}{ending}"
    write_recording(path, seconds)
    command = ["-m", "foretouch", "identify", str(path), "--json"]
    try:
        return measure_process(command), measure_process(command)
    finally:
        path.unlink()

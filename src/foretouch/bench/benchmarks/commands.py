"""What a user waits for: whole commands on files of recordings, and fresh processes until they have answered.

The recordings are presses in and out of a Hunt-Crossley material, with the offset and the noise of a sensor. Timed are
`foretouch compare` on many of them, by two processes against one; `foretouch identify` on an hour of samples at 1 kHz,
with start-up, reading and learning; and how long a fresh process takes to help, a package, or a first compiled call.

An hour as CSV or Parquet is measured. As MCAP it would take long to write first, so that it is extrapolated, without
``--full``, by a line through recordings of 1 and of 10 minutes, each the least of some runs. What is read again comes
from the samples that are kept beside recordings that are large enough, as that of 10 minutes is and that of 1 minute is
not: the other end of its line is a recording of 1 s, which is the start of a process and little else.
"""

from __future__ import annotations

import itertools
import shutil
import tempfile
from functools import partial
from operator import attrgetter
from pathlib import Path

import numpy as np

from foretouch.bench.timing import Array, Contestant, Row, Scope, interleave, ratio, spread
from foretouch.errors import MissingExtraError
from foretouch.files.children import Ended, measure_process
from foretouch.messages import VERSION, Hello, Telemetry
from foretouch.recordings import SessionWriter, write_columns

RATE = 1000.0
SURFACE, HIGHEST, DEEPEST, PRESSES = 0.010, 0.004, 0.006, 0.9
"""Depth of the surface, largest distance outside and inside [m], and presses a second [1/s]."""

OFFSET, NOISE = 0.5, 0.005
"""Offset and noise of the force sensor [N]."""

COLUMNS = 3  # Time, position and force, 8 bytes each a sample


def recorded_press(seconds: float) -> dict[str, Array]:
    """Columns of a recording at 1 kHz, [s] long, by the names that files have."""
    time = np.arange(round(seconds * RATE)) / RATE
    middle, swing = SURFACE + 0.5 * (DEEPEST - HIGHEST), 0.5 * (DEEPEST + HIGHEST)
    position = middle - swing * np.cos(2.0 * np.pi * PRESSES * time)
    velocity = swing * 2.0 * np.pi * PRESSES * np.sin(2.0 * np.pi * PRESSES * time)
    force = np.maximum(np.maximum(position - SURFACE, 0.0) ** 1.4 * (3000.0 + 1500.0 * velocity), 0.0)
    noise = NOISE * np.random.default_rng(0).standard_normal(time.size)
    return {"time_s": time, "position_m": position, "force_N": force + OFFSET + noise}


def write_recording(path: Path, seconds: float) -> None:
    """Write a recording of a length [s] as CSV, Parquet or MCAP, whichever the name ends with."""
    columns = recorded_press(seconds)
    if path.suffix != ".mcap":
        write_columns(path, columns)
        return
    with SessionWriter(path) as writer:  # as a follower would have written it
        writer.write(Hello(VERSION, 1, 0, "follower", (), ()), 0)
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        for sequence, (time, position, force) in zip(itertools.count(1), rows):
            now = round(time * 1e9)
            message = Telemetry(
                VERSION, sequence, now, 0, position, position, 0.0, force, force - OFFSET, force, True, False, 0, 0, 0
            )
            writer.write(message, now)


RECORDINGS, FULL_RECORDINGS, SECONDS = 40, 1_000, 60.0
"""Number of recordings, short and full, and their length [s]: enough that starting a process, some 2 s, is small beside
its part of the work, some 20 s; the full number takes half an hour."""

COMPARE_ROUNDS = 2  # Number of rounds: each contestant goes first once
CHOSEN = ("--models", "kelvin-voigt", "--estimators", "rls")  # The cheapest law: the fan-out is compared


def measure_compare(scope: Scope) -> list[Row]:
    """Speed-up on two jobs; each number of jobs comes first once."""
    count = FULL_RECORDINGS if scope.full else RECORDINGS
    with tempfile.TemporaryDirectory() as folder:
        paths = write_recordings(Path(folder), count, SECONDS)
        command = ["-m", "foretouch", "compare", *map(str, paths), *CHOSEN, "--json", "--jobs"]
        jobs = {number: Contestant(partial(measure_process, [*command, number])) for number in ("1", "2")}
        times = interleave(jobs, COMPARE_ROUNDS, warm=False)
    scaled = "" if scope.full else f" (asked: {FULL_RECORDINGS})"
    what = f"compare, {count} recordings of {SECONDS:g} s{scaled}"
    return [
        Row.of(f"{what}: 2 jobs, times as fast as 1", ratio(times, "1", "2"), "x", 1.7, at_least=True),
        *(Row.of(f"{what}: jobs {number}", spread(times[number]), "s") for number in times),
    ]


def write_recordings(folder: Path, count: int, seconds: float) -> list[Path]:
    """Write the same press, `seconds` long, to each of `count` files, which `compare` cannot know to be equal."""
    paths = [folder / f"{number}.parquet" for number in range(count)]
    write_recording(paths[0], seconds)
    for path in paths[1:]:
        shutil.copyfile(paths[0], path)
    return paths


BRIEF, SHORT, LONG, HOUR = 1.0, 60.0, 600.0, 3600.0
"""Lengths of recordings [s]."""

RUNS = 5  # Runs of each recording from which an hour is extrapolated, interleaved; noise only adds

REACHES = {"CSV": (".csv", 6.0), "Parquet": (".parquet", 3.0), "MCAP": (".mcap", 60.0)}
"""Longest time for an hour [s], by ending."""

REACH_AGAIN = 3.0  # Longest time for reading MCAP of an hour again [s]
LARGEST_SHARE = 3.0  # Most memory over that of the columns

CACHE = "by the samples kept beside it"


def foretold(short: tuple[float, float], long: tuple[float, float]) -> float:
    """Time of an hour [s], by a line through two recordings, each a length [s] and the time that it took [s].

    A line that falls is noise, and taken as level.
    """
    return long[1] + max(0.0, long[1] - short[1]) * (HOUR - long[0]) / (long[0] - short[0])


def measure_identify(scope: Scope) -> list[Row]:
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
    fraction = (first[lengths[-1]].peak - first[BRIEF].peak) / ((lengths[-1] - BRIEF) * RATE * 8 * COLUMNS)
    rows = [
        Row(f"{what}: memory over that of the columns{of}", fraction, "x", LARGEST_SHARE),
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
    seconds_of = attrgetter("seconds")
    quickest = {seconds: min(ended, key=seconds_of) for seconds, ended in first.items()}
    return quickest, min(again, key=seconds_of, default=quickest[lengths[-1]])


STARTUP_ROUNDS = 7

FIRST_CALL = (
    "from foretouch.identification import ContactMap, ContactSample\n"
    "ContactMap().update(ContactSample(0.0, 1e-3, 0.0, 1.0, True))"
)

PROCESSES: dict[str, tuple[list[str], float | None]] = {
    "foretouch --help": (["-m", "foretouch", "--help"], 0.3),
    "import foretouch": (["-c", "import foretouch"], 0.2),
    "first compiled call, from a warm cache": (["-c", FIRST_CALL], 1.5),
    "bare Python": (["-c", "pass"], None),
}
"""Commands that are started, and the longest time that each may take [s]."""


def measure_startup(scope: Scope) -> list[Row]:
    """Seconds from a process's start to its end."""
    started = {what: Contestant(partial(measure_process, arguments)) for what, (arguments, _) in PROCESSES.items()}
    times = interleave(started, STARTUP_ROUNDS)
    return [
        Row.of(f"{what}, a fresh process", spread(times[what]), "s", reach) for what, (_, reach) in PROCESSES.items()
    ]

"""The paper's estimator over many recordings: thousands beside vectorised NumPy, and one that never ends.

The second asks whether time grows with the samples alone, and memory not at all: a stream is made, learnt from and
forgotten.
"""

from __future__ import annotations

import gc
import time
from typing import NamedTuple

import numpy as np

from foretouch.bench.peers import FORGETTING_FACTOR, OPTIONS, Press, Problem, press, recursion_over_many
from foretouch.bench.timing import Array, Contestant, Row, Scope, interleave, ratio, resident_bytes, spread
from foretouch.identification import FPRLS, ContactSamples

STREAMS, SAMPLES, ROUNDS = 4096, 250, 11
"""Recordings, and samples of each."""


class Streams(NamedTuple):
    """The same press, begun elsewhere by each stream.

    Attributes:
        pressed: Columns, each of shape (m, n).
        regressors: (1, ln x, v, v / x), shape (m, 4, n).
        targets: ln F, shape (m, n).
        forgetting_factor: mu, shape (m, n): 1 at the first sample, which has not moved, then the paper's.
    """

    pressed: Press
    regressors: Array
    targets: Array
    forgetting_factor: Array

    @classmethod
    def of(cls, streams: int, samples: int = SAMPLES) -> Streams:
        """Some streams of some samples."""
        whole = press(streams + samples)
        take = np.arange(samples)[:, None] + np.arange(streams)
        problem = Problem.of(whole)
        factors = np.full((samples, streams), FORGETTING_FACTOR)
        factors[0] = 1.0
        return cls(
            Press(*(np.ascontiguousarray(column[take]) for column in whole)),
            np.ascontiguousarray(np.moveaxis(problem.regressors[take], 2, 1)),
            np.ascontiguousarray(problem.targets[take]),
            factors,
        )

    def in_ours(self) -> Array:
        """Theta of all streams, shape (n, 4), from depths, velocities and forces."""
        return FPRLS(OPTIONS).run_many(self.pressed.depth, self.pressed.velocity, self.pressed.force).theta

    def in_numpy(self) -> Array:
        """The same in NumPy, from regressors that are already computed."""
        return recursion_over_many(self.regressors, self.targets, self.forgetting_factor)


def contestants(streams: int) -> dict[str, Contestant]:
    """Ours and NumPy, over a number of streams."""
    given = Streams.of(streams)
    count = streams * SAMPLES
    return {"ours": Contestant(given.in_ours, count), "NumPy": Contestant(given.in_numpy, count)}


def measure_batch(scope: Scope) -> list[Row]:
    """Nanoseconds a sample on one core, and how many times as fast as NumPy."""
    times = interleave(contestants(STREAMS), ROUNDS)
    what = f"FPRLS over {STREAMS} recordings at once"
    return [
        Row.of(f"{what}, times as fast as NumPy", ratio(times, "NumPy", "ours"), "x", 1.0, at_least=True),
        Row.of(f"{what}, features included", spread(times["ours"], 1e9), "ns/sample", 40.0),
        Row.of("the same in NumPy, without features", spread(times["NumPy"], 1e9), "ns/sample"),
    ]


SMALLEST, LARGEST = 100_000, 100_000_000
"""Samples of the shortest and of the longest stream."""

BLOCK = 100_000  # Number of samples in memory at a time; the press repeats itself

GROWTH_ROUNDS = 3

LARGEST_SLOPE, LARGEST_GROWTH = 1.05, 1.0
"""Largest slope of log time over log samples, and largest growth of memory from shortest to longest stream [MB]."""


class Streamed(NamedTuple):
    """Samples of a stream, time that learning took [s], and memory held afterwards [bytes], 0 where unknown."""

    size: int
    seconds: float
    memory: int


def curve(largest: int, rounds: int = GROWTH_ROUNDS) -> list[Streamed]:
    """Streams of 10^5 samples, ten times that, and so on up to `largest`; of each length the quickest of the rounds.

    The longest of all runs once.
    """
    sizes = [SMALLEST * 10**power for power in range(round(np.log10(largest / SMALLEST)) + 1)]
    _stream(SMALLEST)
    values: dict[int, Streamed] = {}
    for turn in range(rounds):
        for size in sizes if turn == 0 else [size for size in sizes if size < LARGEST]:
            streamed = _stream(size)
            best = values.get(size, streamed)
            values[size] = Streamed(size, min(best.seconds, streamed.seconds), max(best.memory, streamed.memory))
    return list(values.values())


def slope(streams: list[Streamed]) -> float:
    """Slope of log time over log samples: 1 where time is linear."""
    sizes, seconds = np.array([(one.size, one.seconds) for one in streams]).T
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def _stream(size: int) -> Streamed:
    estimator, block = FPRLS(OPTIONS), ContactSamples(*press(BLOCK))
    gc.collect()
    gc.disable()
    try:
        start = time.perf_counter()
        for _ in range(size // BLOCK):
            estimator.run(block)
        seconds = time.perf_counter() - start
        return Streamed(size, seconds, resident_bytes())
    finally:
        gc.enable()


def measure_growth(scope: Scope) -> list[Row]:
    """Slope and memory."""
    streams = curve(LARGEST)
    upto = f"streams of 10^{round(np.log10(SMALLEST))} to 10^{round(np.log10(LARGEST))} samples"
    rows = [Row(f"{upto}, log time over log samples, slope", slope(streams), "1", LARGEST_SLOPE)]
    if streams[0].memory:
        grown = (streams[-1].memory - streams[0].memory) / 1e6
        rows.append(Row(f"{upto}, memory that it takes", grown, "MB", LARGEST_GROWTH))
    else:
        scope.say("this system does not say how much memory a process holds: that row is left out")
    return rows

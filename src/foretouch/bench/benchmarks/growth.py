"""Does time grow with the samples alone, and memory not at all? A stream that is made, learnt from, and forgotten."""

from __future__ import annotations

import gc
import time
from typing import NamedTuple

import numpy as np

from foretouch.bench.press import OPTIONS, press
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import resident_bytes
from foretouch.identification import FPRLS

SMALLEST, LARGEST = 100_000, 100_000_000
"""Samples of the shortest and of the longest stream."""

BLOCK = 100_000
"""So many samples are in memory at a time; the press repeats itself."""

ROUNDS = 3

LARGEST_SLOPE, LARGEST_GROWTH = 1.05, 1.0
"""Of the logarithm of time over that of samples; memory [MB] that the longest stream holds more than the shortest."""


class Streamed(NamedTuple):
    """What a stream cost.

    Attributes:
        size: Samples.
        seconds: That learning took.
        memory: That this process held afterwards [bytes]; 0 where the system does not say.
    """

    size: int
    seconds: float
    memory: int


def curve(largest: int, rounds: int = ROUNDS) -> list[Streamed]:
    """Streams of 10^5 samples, ten times that, and so on; of each length the quickest of some rounds.

    Args:
        largest: Of the longest stream, a power of ten.
        rounds: Of each; one of the longest of all.
    """
    sizes = [SMALLEST * 10**power for power in range(round(np.log10(largest / SMALLEST)) + 1)]
    _stream(SMALLEST)
    found: dict[int, Streamed] = {}
    for turn in range(rounds):
        for size in sizes if turn == 0 else [size for size in sizes if size < LARGEST]:
            streamed = _stream(size)
            best = found.get(size, streamed)
            found[size] = Streamed(size, min(best.seconds, streamed.seconds), max(best.memory, streamed.memory))
    return list(found.values())


def slope(streams: list[Streamed]) -> float:
    """Of the logarithm of time over that of samples: 1 where time is linear."""
    sizes, seconds = np.array([(one.size, one.seconds) for one in streams]).T
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def _stream(size: int) -> Streamed:
    """Learn from so many samples, a block at a time."""
    estimator, block = FPRLS(OPTIONS), press(BLOCK)
    gc.collect()
    gc.disable()
    try:
        start = time.perf_counter()
        for _ in range(size // BLOCK):
            estimator.run(block.depth, block.velocity, block.force)
        seconds = time.perf_counter() - start
        return Streamed(size, seconds, resident_bytes())
    finally:
        gc.enable()


def measure(scope: Scope) -> list[Row]:
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

"""Timing contestants against each other on a machine that does other things too, and what memory this process holds.

Contestants take turns, in another order each round, so that what slows the machine slows all of them. The garbage
collector is off while one runs. All run once before the first round, so that nothing is compiled or loaded in it.
What is compared is compared within its round: the ratio of two contestants is the median of the rounds' ratios.

A process is held to one core where the system can.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process and what it starts to one of the cores that it has."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


_STATM = Path("/proc/self/statm")


def resident_bytes() -> int:
    """Bytes of this process that are in memory now, in whole pages; 0 where the system does not say.

    It includes the memory of Python, NumPy and compiled code.
    """
    if not _STATM.exists():
        return 0
    import resource

    return int(_STATM.read_text().split()[1]) * resource.getpagesize()


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Contestant:
    """What is timed.

    Attributes:
        run: Does the work once.
        count: How many units of work that is: samples, calls.
        prepare: Called before each run, untimed.
    """

    run: Callable[[], object]
    count: int = 1
    prepare: Callable[[], object] | None = None


@dataclass(frozen=True, slots=True)
class Spread:
    """Median and quartiles over rounds.

    Attributes:
        median: Half of the rounds are below.
        lower: A quarter of them is below.
        upper: And above.
        least: The smallest.
        rounds: How many.
    """

    median: float
    lower: float
    upper: float
    least: float
    rounds: int


def spread(figures: ArrayLike, scale: float = 1.0) -> Spread:
    """The spread of figures, one a round, shape (n,), each times `scale`."""
    values = scale * np.asarray(figures, dtype=np.float64)
    lower, median, upper = np.percentile(values, (25.0, 50.0, 75.0)).tolist()
    return Spread(median, lower, upper, float(values.min()), int(values.size))


def ratio(times: Mapping[str, Array], of: str, to: str) -> Spread:
    """How many times as long one contestant takes as another, round by round."""
    return spread(times[of] / times[to])


def interleave(contestants: Mapping[str, Contestant], rounds: int, *, warm: bool = True) -> dict[str, Array]:
    """Time all contestants in turns.

    Args:
        contestants: By name.
        rounds: At least 1.
        warm: Whether each runs once before, untimed; processes that take long need none.

    Returns:
        By name, the time of one unit of work [s] in each round, shape (rounds,).
    """
    times = {name: np.empty(rounds) for name in contestants}
    gc.collect()
    for one in contestants.values() if warm else ():
        once(one)
    names = list(contestants)
    for turn in range(rounds):
        start = turn % len(names)
        for name in names[start:] + names[:start]:
            times[name][turn] = once(contestants[name])
    return times


def once(one: Contestant) -> float:
    """The time of one unit of a contestant's work [s], over one run; the garbage collector is off meanwhile."""
    if one.prepare is not None:
        one.prepare()
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = time.perf_counter()
        one.run()
        return (time.perf_counter() - start) / one.count
    finally:
        if collecting:
            gc.enable()

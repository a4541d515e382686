"""Timing contestants against each other on a machine that does other things too, and rows that say what came of it.

Contestants take turns, in another order each round, so that what slows the machine slows all of them. The garbage
collector is off while one runs. All run once before the first round, so that nothing is compiled or loaded in it.
What is compared is compared within its round: the ratio of two contestants is the median of the rounds' ratios.

A process is held to one core where the system can. A row has one figure, what is asked for, and whether it is reached.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.table import Table


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
    """What is timed: does the work once, of a number of units such as samples; called before each run, untimed."""

    run: Callable[[], object]
    count: int = 1
    prepare: Callable[[], object] | None = None


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, lower and upper quartile and the least over a number of rounds."""

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
    """Ratio of one contestant's time to another's, round by round."""
    return spread(times[of] / times[to])


def interleave(contestants: Mapping[str, Contestant], rounds: int, *, warm: bool = True) -> dict[str, Array]:
    """Time of one unit of work [s] of each contestant, by name, shape (rounds,), where all take turns.

    Each runs once before, untimed, unless `warm` is false, as for processes, which take long and need it not.
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


@dataclass(frozen=True, slots=True)
class Row:
    """One figure.

    Attributes:
        what: Name of the figure in words, with what was scaled down.
        figure: The median where it was measured in rounds.
        unit: Unit of figure, quartiles and reach; ``x`` for ratios.
        reach: Required value; None where nothing is required.
        at_least: Whether the figure is to be at least the reach; otherwise at most.
        quartiles: Lower and upper, over the rounds; None where there were none.
        rounds: Number of rounds; 1 where the figure was taken once.
    """

    what: str
    figure: float
    unit: str
    reach: float | None = None
    at_least: bool = False
    quartiles: tuple[float, float] | None = None
    rounds: int = 1

    @classmethod
    def of(cls, what: str, spread: Spread, unit: str, reach: float | None = None, *, at_least: bool = False) -> Row:
        """The row of a spread over rounds, in the unit; the other arguments are the attributes."""
        quartiles = None if spread.rounds == 1 else (spread.lower, spread.upper)
        return cls(what, spread.median, unit, reach, at_least, quartiles, spread.rounds)

    @property
    def reached(self) -> bool | None:
        """Whether the figure is as asked for; None where nothing is. What is no number reaches nothing."""
        if self.reach is None:
            return None
        return self.figure >= self.reach if self.at_least else self.figure <= self.reach

    def as_row(self) -> dict[str, Any]:
        """What, figure, unit, reach and reached, for JSON."""
        return {name: getattr(self, name) for name in ("what", "figure", "unit", "reach", "reached")}


@dataclass(frozen=True, slots=True)
class Scope:
    """The extent of a benchmark.

    Attributes:
        full: Whether all that is asked for is measured, however long it takes; else a short form that says so.
        say: Called with one line on what is left out, and why.
    """

    full: bool
    say: Callable[[str], None]


HEADS = ("What", "Median", "Quartiles", "Rounds", "Unit", "Asked", "Reached")


def cells(row: Row) -> tuple[str, ...]:
    """What stands in a row, under `HEADS`."""
    quartiles = "" if row.quartiles is None else f"{_said(row.quartiles[0])} to {_said(row.quartiles[1])}"
    asked = "" if row.reach is None else f"{'≥' if row.at_least else '≤'} {_said(row.reach)}"
    reached = {True: "yes", False: "no", None: ""}[row.reached]
    return row.what, _said(row.figure), quartiles, str(row.rounds), row.unit, asked, reached


def render_table(done: Mapping[str, Sequence[Row]]) -> Table:
    """One table of some benchmarks, by name, ratios first in each, as wide as there is room."""
    table = Table(*HEADS, header_style="bold", expand=True)
    table.columns[0].ratio = 1
    for column in (1, 2, 3):
        table.columns[column].justify = "right"
    for name, rows in done.items():
        table.add_section()
        table.add_row(f"[bold]{name}[/bold]")
        for row in sorted(rows, key=lambda one: one.unit != "x"):
            style = {True: "green", False: "red", None: ""}[row.reached]
            *most, last = cells(row)
            table.add_row(*most, f"[{style}]{last}[/]" if style else last)
    return table


def _said(value: float) -> str:
    """Three figures that count, without an exponent where it can be."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"

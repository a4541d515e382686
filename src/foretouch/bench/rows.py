"""What a benchmark says: rows of one figure each, what is asked, whether it is reached; and their table for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from foretouch.bench.timing import Spread


@dataclass(frozen=True, slots=True)
class Row:
    """One figure.

    Attributes:
        what: In words; what was scaled down is said here.
        figure: The median where it was measured in rounds.
        unit: Of figure, quartiles and reach; ``x`` for ratios.
        reach: What is asked for; None where nothing is.
        at_least: Whether the figure is to be at least the reach; else at most.
        quartiles: Lower and upper, over the rounds; None where there were none.
        rounds: How many; 1 where the figure was taken once.
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
        """The row of what was measured in rounds; arguments as the attributes.

        Args:
            what: In words.
            spread: In the unit.
            unit: Of all of it.
            reach: What is asked for.
            at_least: Whether at least that, or at most.
        """
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
        return {
            "what": self.what,
            "figure": self.figure,
            "unit": self.unit,
            "reach": self.reach,
            "reached": self.reached,
        }


@dataclass(frozen=True, slots=True)
class Scope:
    """How much a benchmark is to do.

    Attributes:
        full: Whether all that is asked for is measured, however long it takes; else a short form that says so.
        say: Told in one line what is left out, and why.
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
    """One table of some benchmarks, ratios first in each, as wide as there is room.

    Args:
        done: Rows by benchmark.
    """
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

"""What a benchmark says: rows of one figure each, what is asked of it, and whether it is reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from foretouch.bench.timing import Spread

__all__ = ["Row", "Scope"]


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

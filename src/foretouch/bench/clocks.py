"""Clocks around functions: where the time of a step goes, without a line in the step itself.

A function is replaced by one that reads the clock before and after it, where its owner keeps it: a class or a module.
Reading clocks takes time too, and is taken off. How much of that a clock shows itself is measured on a function that
does nothing; how much it is altogether, by the work with clocks and without: among other code it is more.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Target = tuple[Any, str]
"""A class or a module, and the name under which it keeps a function."""

CALLS, BATCHES = 2_000, 25
"""Calls of the function that does nothing, and how often so many."""


@contextmanager
def replaced(functions: Mapping[Target, Callable[[Any], Any]]) -> Iterator[None]:
    """Have owners keep other functions for a while.

    Args:
        functions: What makes the one that is kept meanwhile of the one that is there.
    """
    kept = {target: vars(target[0])[target[1]] for target in functions}
    try:
        for (owner, name), make in functions.items():
            setattr(owner, name, make(kept[owner, name]))
        yield
    finally:
        for (owner, name), function in kept.items():
            setattr(owner, name, function)


class Cost(NamedTuple):
    """What a clock around a function takes.

    Attributes:
        inside: What the clock shows of a function that takes no time [ns].
        whole: What a call takes longer with its clock [ns].
    """

    inside: float
    whole: float

    def among(self, more: float, calls: float) -> Cost:
        """The same where work took so much longer [ns] with so many calls of clocks in it; no less than in a loop."""
        return Cost(self.inside, max(more / calls if calls else 0.0, self.whole))


class Clocks:
    """Books the time of functions to parts. Where a part calls another, its time holds that of the other too.

    Args:
        parts: By name of a part, whose time is its functions' together.
    """

    def __init__(self, parts: Mapping[str, Sequence[Target]]) -> None:
        self._places = {target: place for place, targets in enumerate(parts.values()) for target in targets}
        self._spent = [0] * len(parts)
        self._calls = [0] * len(parts)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Put the clocks around the functions, and take them away again."""
        with replaced({target: partial(self._timed, place) for target, place in self._places.items()}):
            yield

    def clear(self) -> None:
        """What was booked so far is of nothing that is looked at."""
        for place in range(len(self._spent)):
            self._spent[place] = self._calls[place] = 0

    def take(self) -> tuple[list[int], list[int]]:
        """By part, the time booked since it was last asked [ns], and how many calls that was."""
        taken = self._spent.copy(), self._calls.copy()
        self.clear()
        return taken

    def _timed(self, place: int, function: Any) -> Any:
        spent, calls, clock = self._spent, self._calls, time.perf_counter_ns

        def timed(*arguments: Any, **named: Any) -> Any:
            start = clock()
            answer = function(*arguments, **named)
            spent[place] += clock() - start
            calls[place] += 1
            return answer

        return timed

    @classmethod
    def cost(cls) -> Cost:
        """Measure what a clock takes in a loop that does nothing else: medians over batches of calls."""
        found = np.array([cls._batch() for _ in range(BATCHES)])
        inside, whole = np.median(found, axis=0).tolist()
        return Cost(max(inside, 0.0), max(whole, 0.0))

    @classmethod
    def _batch(cls) -> tuple[float, float]:
        clocks = cls({"nothing": [(_Nothing, "call")]})
        nothing = _Nothing()

        def calls() -> float:
            start = time.perf_counter_ns()
            for _ in range(CALLS):
                nothing.call(0.0, 0.0)
            return (time.perf_counter_ns() - start) / CALLS

        start = time.perf_counter_ns()
        for _ in range(CALLS):
            pass
        turn = (time.perf_counter_ns() - start) / CALLS
        bare = calls()
        with clocks.running():
            whole = calls()
            (spent,), _ = clocks.take()
        return spent / CALLS - (bare - turn), whole - bare


class _Nothing:
    """Does nothing."""

    def call(self, one: float, other: float) -> None:
        """Take two numbers, as most methods of a step do."""


def without_cost(took: Array, spent: Array, calls: Array, cost: Cost, inner: Mapping[int, int]) -> tuple[Array, Array]:
    """Times as they are without clocks.

    Args:
        took: Of the whole, shape (n,).
        spent: Of its parts as booked, shape (n, parts).
        calls: How many calls that was, shape (n, parts).
        cost: Of a clock, in the same unit.
        inner: Parts that another part calls, and which: their time is not that one's.

    Returns:
        Of the whole and of its parts, shapes (n,) and (n, parts).
    """
    own = spent - cost.inside * calls
    for part, outer in inner.items():
        own[:, outer] -= spent[:, part] + (cost.whole - cost.inside) * calls[:, part]
    return took - cost.whole * calls.sum(axis=1), own

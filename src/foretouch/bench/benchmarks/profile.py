"""Where the time of both steps goes: the taped session of `steps`, with clocks around their parts.

A function is replaced by one that reads the clock before and after it, where its owner keeps it: a class or a module.
Of some rounds each tick's median one counts. A part's time is a mean over those ticks in contact whose whole step is
near the percentile that the row names, so that the parts and what is left of the step add up to it.

Reading clocks takes time too. How much of that a clock shows itself is measured on a function that does nothing, and
taken off; how much it is altogether, by the work with clocks and without, so that the median step takes as long as
without them. How near that comes elsewhere, the rows of the 99th percentile say, with and without clocks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.benchmarks.steps import DURATION, RobotOnTape, TapedSession
from foretouch.bench.timing import Row, Scope
from foretouch.devices import ScriptedOperator
from foretouch.identification import Learner
from foretouch.link import FaultStage
from foretouch.rendering.whole import whole
from foretouch.session.network.model_sender import ModelSender
from foretouch.session.network.round_trip import RoundTrip
from foretouch.session.steps import follower, leader
from foretouch.session.steps.follower_view import FollowerView
from foretouch.session.steps.tick import tick_at_once

Array = NDArray[np.float64]

Target = tuple[Any, str]
"""A class or a module, and the name under which it keeps a function."""

CALLS, BATCHES = 2_000, 25
"""Calls of the function that does nothing per batch, and number of batches."""


@contextmanager
def replaced(functions: Mapping[Target, Callable[[Any], Any]]) -> Iterator[None]:
    """Have owners keep other functions for a while, each made from the one that is there."""
    kept = {(owner, name): vars(owner).get(name) for owner, name in functions}
    try:
        for (owner, name), make in functions.items():
            setattr(owner, name, make(getattr(owner, name)))
        yield
    finally:
        for (owner, name), function in kept.items():
            if function is not None:
                setattr(owner, name, function)
            elif name in vars(owner):  # which it had inherited
                delattr(owner, name)


class Cost(NamedTuple):
    """What a clock shows of a function that takes no time, and what a call takes longer with its clock [ns]."""

    inside: float
    whole: float

    def among(self, more: float, calls: float) -> Cost:
        """The cost where the work took `more` ns longer with `calls` clock calls in it; no less than in a loop."""
        return Cost(self.inside, max(more / calls if calls else 0.0, self.whole))


class Clocks:
    """Books the time of functions to named parts. Where a part calls another, its time holds that of the other too."""

    def __init__(self, parts: Mapping[str, Sequence[Target]]) -> None:
        self._indices = {target: index for index, targets in enumerate(parts.values()) for target in targets}
        self._spent = [0] * len(parts)
        self._calls = [0] * len(parts)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Put the clocks around the functions, and take them away again."""
        with replaced({target: partial(self._timed, position) for target, position in self._indices.items()}):
            yield

    def clear(self) -> None:
        """Discard what has been booked: it belongs to nothing that is measured."""
        for index in range(len(self._spent)):
            self._spent[index] = self._calls[index] = 0

    def take(self) -> tuple[list[int], list[int]]:
        """Time booked by part since the last call [ns], and the number of calls in it."""
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
        result = np.array([cls._batch() for _ in range(BATCHES)])
        inside, whole = np.median(result, axis=0).tolist()
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
    def call(self, one: float, other: float) -> None:
        """Do nothing with two numbers, as most methods of a step take."""


def without_cost(took: Array, spent: Array, calls: Array, cost: Cost, inner: Mapping[int, int]) -> tuple[Array, Array]:
    """Times as they are without clocks, of the whole and of its parts, shapes (n,) and (n, parts).

    Of the whole `took` has shape (n,); of its parts `spent` as booked and the number of `calls` have shape (n, parts),
    and the cost of a clock is in the same unit. `inner` are parts that another part calls, whose time is not its own.
    """
    own = spent - cost.inside * calls
    for part, outer in inner.items():
        own[:, outer] -= spent[:, part] + (cost.whole - cost.inside) * calls[:, part]
    return took - cost.whole * calls.sum(axis=1), own


ROUNDS = 5

BANDS = {50: (40.0, 60.0), 99: (98.5, 99.5)}  # Ticks that stand for a percentile: those between two others

STEP, WITHOUT, ELSE = "the whole step", "the whole step, without clocks in it", "all else"


class Part(NamedTuple):
    """A part of a step: what it does, its functions, none of which calls another, and the part that calls it."""

    name: str
    targets: tuple[Target, ...] = ()
    within: str = ""


PARTS: dict[str, tuple[Part, ...]] = {
    "leader": (
        Part("hearing the follower", ((FollowerView, "take_telemetry"), (FollowerView, "is_for_us"))),
        Part("letting a model in", ((leader, "_adopt"),)),
        Part("predicting, mediating and limiting", ((whole, "_entry"),)),
        Part("making command and record", ((leader, "Command"), (leader, "LeaderState"))),
        Part(ELSE),
    ),
    "follower": (
        Part("taking commands", ((FaultStage, "pop_due"), (follower, "_take"))),
        Part("playing, watching, learning and keeping safe", ((tick_at_once, "_entry"),)),
        Part("taking over what was learnt", ((Learner, "taken"),)),
        Part("learning when models are used", ((RoundTrip, "applied"),)),
        Part("sending the model", ((ModelSender, "due"),)),
        Part("making the telemetry", ((follower, "Telemetry"),)),
        Part(ELSE),
    ),
}
"""The parts of both sides' steps, in the order in which they run."""


class Timed(NamedTuple):
    """Steps of one side in contact, as they are without clocks [us]: shape (ticks,), and of `PARTS` (ticks, parts)."""

    took: Array
    parts: Array


def timed_round(session: TapedSession, bare: Mapping[str, Array]) -> dict[str, Timed]:
    """Run a session, with the default operator, again with clocks in its steps; `bare` are its times without."""
    sides = list(PARTS)
    parts = {f"{side} {part.name}": part.targets for side in sides for part in PARTS[side]}
    clocks = Clocks(parts)
    cost = clocks.cost()
    booked: dict[str, list[tuple[list[int], list[int]]]] = {side: [] for side in sides}
    with replaced(_between_steps(clocks, booked)), clocks.running():
        times = session.times()
    result, first = {}, 0
    for side in sides:
        count = len(PARTS[side])
        ticks = booked[side][-times[side].size :]  # what came before them warmed up
        spent, calls = np.array(ticks, dtype=np.float64)[:, :, first : first + count].transpose(1, 0, 2)
        positions = {part.name: index for index, part in enumerate(PARTS[side])}
        inner = {positions[part.name]: positions[part.within] for part in PARTS[side] if part.within}
        touching = times["contact"] > 0.0
        longer = float(np.median(times[side][touching]) - np.median(bare[side][touching]))
        there = cost.among(1e9 * longer, float(np.median(calls[touching].sum(axis=1))))
        took, spent = without_cost(1e9 * times[side], spent, calls, there, inner)
        spent[:, -1] = took - spent[:, :-1].sum(axis=1)
        result[side] = Timed(1e-3 * took[touching], 1e-3 * spent[touching])
        first += count
    return result


def _between_steps(
    clocks: Clocks, booked: Mapping[str, list[tuple[list[int], list[int]]]]
) -> dict[Target, Callable[[Any], Any]]:
    """Look at the clocks where the runner times nothing: at the robot after a follower's step, at the device."""

    def before(look: Callable[[], object]) -> Callable[[Any], Any]:
        """Look at the clocks before each call of a method."""

        def make(method: Any) -> Any:
            def looked_at(self: Any, argument: Any) -> Any:
                look()
                return method(self, argument)

            return looked_at

        return make

    return {
        (RobotOnTape, "exchange"): before(lambda: booked["follower"].append(clocks.take())),
        (ScriptedOperator, "read"): before(clocks.clear),
        (ScriptedOperator, "render"): before(lambda: booked["leader"].append(clocks.take())),
    }


def near(took: Array, percentile: int) -> NDArray[np.bool_]:
    """Flags of the steps that stand for a percentile, of the shape of their times."""
    lower, upper = np.percentile(took, BANDS[percentile])
    result: NDArray[np.bool_] = (took >= lower) & (took <= upper)
    return result


def middle(rounds: Sequence[Timed]) -> Timed:
    """For each tick, the round with the median time: what else the machine did meanwhile is left out."""
    took = np.stack([one.took for one in rounds])
    chosen = np.argsort(took, axis=0)[len(rounds) // 2]
    ticks = np.arange(chosen.size)
    return Timed(took[chosen, ticks], np.stack([one.parts for one in rounds])[chosen, ticks])


def profile(session: TapedSession, rounds: int) -> dict[tuple[str, int], dict[str, float]]:
    """The time of each part, of the whole step, and of that without clocks [us], by side and percentile.

    The session, with the default operator, runs once to warm up and then each round with clocks and without.
    """
    session.times()
    bare, clocked = [], []
    for _ in range(rounds):
        bare.append(session.times())
        clocked.append(timed_round(session, bare[-1]))
    values = {}
    for side, parts in PARTS.items():
        timed = middle([one[side] for one in clocked])
        plain = 1e6 * np.median([one[side][one["contact"] > 0.0] for one in bare], axis=0)
        for percentile in BANDS:
            chosen = near(timed.took, percentile)
            means = timed.parts[chosen].mean(axis=0).tolist()
            values[side, percentile] = {
                STEP: float(timed.took[chosen].mean()),
                **dict(zip([part.name for part in parts], means, strict=True)),
                WITHOUT: float(plain[near(plain, percentile)].mean()),
            }
    return values


def named(side: str, name: str, percentile: int, *, share: bool = False) -> str:
    """The title of a row: a part's time [us], or its fraction of the step [%], at a percentile of `BANDS`."""
    return f"{side}: {name}, {'share of the step, ' if share else ''}{percentile} %"


def measure_profile(scope: Scope) -> list[Row]:
    """Each part's time at both percentiles, and its fraction of the median step."""
    result = profile(TapedSession(DURATION), ROUNDS)
    rows = [
        Row(named(side, name, percentile), time, "us", rounds=ROUNDS)
        for (side, percentile), times in result.items()
        for name, time in times.items()
        if (name, percentile) != (WITHOUT, 50)
    ]
    fractions = [
        Row(named(side, part.name, 50, share=True), 100.0 * times[part.name] / times[STEP], "%", rounds=ROUNDS)
        for side, times in ((side, result[side, 50]) for side in PARTS)
        for part in PARTS[side]
    ]
    return rows + fractions

"""Where the time of both steps goes: the taped session of `steps`, with clocks around their parts.

Of some rounds each tick's median one counts. A part's time is a mean over those ticks in contact whose whole step is
near the percentile that the row names, so that the parts and what is left of the step add up to it. What the clocks
themselves take is measured in the same run and taken off: so much, that the median step takes as long as without them.
How near that comes elsewhere, the rows of the 99th percentile say, with and without clocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.benchmarks.steps import DURATION, RobotOnTape, TapedSession
from foretouch.bench.clocks import Clocks, Target, replaced, without_cost
from foretouch.bench.rows import Row, Scope
from foretouch.devices import ScriptedOperator
from foretouch.identification import ContactMapBank, SensorWatch
from foretouch.identification.conditioning.conditioner import Conditioner, SensorLag
from foretouch.link import FaultStage
from foretouch.models import Predictor
from foretouch.rendering import EnergyAccount, ForceLimiter, Mediation, Proxy, Renderer
from foretouch.rendering.energy import Ledger
from foretouch.session.network.model_sender import ModelSender
from foretouch.session.network.playout import Playout
from foretouch.session.steps import follower, leader
from foretouch.session.steps.heard import Heard

Array = NDArray[np.float64]

ROUNDS = 5

BANDS = {50: (40.0, 60.0), 99: (98.5, 99.5)}
"""Ticks that stand for a percentile: those between two others."""

STEP, WITHOUT, ELSE = "the whole step", "the whole step, without clocks in it", "all else"


class Part(NamedTuple):
    """A part of a step.

    Attributes:
        name: What it does.
        buys: What it is there for, one sentence.
        targets: Its functions; none of them calls another.
        within: Name of the part that calls it; empty where the step itself does.
    """

    name: str
    buys: str
    targets: tuple[Target, ...] = ()
    within: str = ""


PARTS: dict[str, tuple[Part, ...]] = {
    "leader": (
        Part(
            "hearing the follower",
            "Whoever renders must know whether the robot obeys, stands still, or is another process than before.",
            ((Heard, "take_telemetry"), (Heard, "is_for_us")),
        ),
        Part(
            "letting a model in",
            "What arrives is checked before it may make a force, and takes over the material's memory where it stands.",
            ((leader, "_adopt"),),
        ),
        Part(
            "placing the proxy",
            "The hand may be beyond a surface that turned up late: the proxy stands where the force is to be felt.",
            ((Proxy, "follow"),),
        ),
        Part(
            "predicting the force",
            "The contact map at the hand's own motion, with what the material remembers: the force without the delay.",
            ((Predictor, "update"),),
        ),
        Part(
            "mediating",
            "A model that has learnt something changes the force without a jerk.",
            ((Mediation, "update"),),
        ),
        Part(
            "foreseeing the way out",
            "What the model would give back if the hand left now bounds what mediation may add: it is integrated anew.",
            ((Renderer, "_exit_work"),),
            within="mediating",
        ),
        Part(
            "keeping the energy account",
            "It proves, tick by tick, that the hand gets back no more than it gave.",
            ((EnergyAccount, "observe"), (Ledger, "bound_with")),
        ),
        Part(
            "limiting",
            "Whatever went wrong before it, 10 N and 200 N/s are not passed.",
            ((ForceLimiter, "update"),),
        ),
        Part(
            "making command and record",
            "The robot is told where to be; recorder, report and console see what the hand felt, and why.",
            ((leader, "Command"), (leader, "LeaderState")),
        ),
        Part(ELSE, "The calls between all of these, and what the runner hands over."),
    ),
    "follower": (
        Part(
            "taking commands",
            "Only one leader is obeyed, and only while its commands are fresh.",
            ((FaultStage, "pop_due"), (follower, "_take")),
        ),
        Part(
            "playing them evenly",
            "Commands come in bursts; a robot that followed those would shake.",
            ((Playout, "advance"),),
        ),
        Part(
            "watching the sensors",
            "Nothing is learnt from a sensor that is stuck, saturated or gone, and the robot holds.",
            ((SensorWatch, "update"),),
        ),
        Part(
            "conditioning",
            "Force offset, contact, surface and velocity are found in the raw samples, causally.",
            ((Conditioner, "update"),),
        ),
        Part(
            "learning",
            "The contact map learns from every fourth sample in full, and its memory of the material from each.",
            ((ContactMapBank, "update"),),
        ),
        Part(
            "measuring the sensor's lag",
            "A force that comes later than the position belongs to another place; how late it is, is told.",
            ((SensorLag, "update"),),
        ),
        Part(
            "sending the model",
            "50 a second, and at once when something changed: packed, counted in bytes, and with its round trip.",
            ((ModelSender, "due"),),
        ),
        Part(
            "keeping safe",
            "Force, depth, speed, acceleration and jerk stay within limits, whatever was commanded.",
            ((follower, "_allowed"),),
        ),
        Part(
            "making the telemetry",
            "Everything that watches, and the leader's check that it is obeyed, live on it.",
            ((follower, "Telemetry"),),
        ),
        Part(ELSE, "The calls between all of these, and what the runner hands over."),
    ),
}
"""The parts of both sides' steps, in the order in which they run."""


class Timed(NamedTuple):
    """Steps of one side in contact, as they are without clocks.

    Attributes:
        took: The whole step [us], shape (ticks,).
        parts: Its parts in the order of `PARTS` [us], what is left last, shape (ticks, parts).
    """

    took: Array
    parts: Array


def timed_round(session: TapedSession, bare: Mapping[str, Array]) -> dict[str, Timed]:
    """Run a session again with clocks in its steps.

    Args:
        session: With the default operator.
        bare: Its `times` without.
    """
    sides = list(PARTS)
    parts = {f"{side} {part.name}": part.targets for side in sides for part in PARTS[side]}
    clocks = Clocks(parts)
    cost = clocks.cost()
    booked: dict[str, list[tuple[list[int], list[int]]]] = {side: [] for side in sides}
    with replaced(_between_steps(clocks, booked)), clocks.running():
        times = session.times()
    found, first = {}, 0
    for side in sides:
        count = len(PARTS[side])
        ticks = booked[side][-times[side].size :]  # what came before them warmed up
        spent, calls = np.array(ticks, dtype=np.float64)[:, :, first : first + count].transpose(1, 0, 2)
        places = {part.name: place for place, part in enumerate(PARTS[side])}
        inner = {places[part.name]: places[part.within] for part in PARTS[side] if part.within}
        touching = times["contact"] > 0.0
        longer = float(np.median(times[side][touching]) - np.median(bare[side][touching]))
        there = cost.among(1e9 * longer, float(np.median(calls[touching].sum(axis=1))))
        took, spent = without_cost(1e9 * times[side], spent, calls, there, inner)
        spent[:, -1] = took - spent[:, :-1].sum(axis=1)
        found[side] = Timed(1e-3 * took[touching], 1e-3 * spent[touching])
        first += count
    return found


def _between_steps(
    clocks: Clocks, booked: Mapping[str, list[tuple[list[int], list[int]]]]
) -> dict[Target, Callable[[Any], Any]]:
    """Look at the clocks where the runner times nothing: at the robot after a follower's step, at the device."""

    def exchange(function: Any) -> Any:
        def exchanged(robot: RobotOnTape, desired_position: float) -> Any:
            booked["follower"].append(clocks.take())
            return function(robot, desired_position)

        return exchanged

    def read(function: Any) -> Any:
        def was_read(device: ScriptedOperator, now_ns: int) -> Any:
            clocks.clear()
            return function(device, now_ns)

        return was_read

    def render(function: Any) -> Any:
        def rendered(device: ScriptedOperator, force: float) -> Any:
            booked["leader"].append(clocks.take())
            return function(device, force)

        return rendered

    return {
        (RobotOnTape, "exchange"): exchange,
        (ScriptedOperator, "read"): read,
        (ScriptedOperator, "render"): render,
    }


def near(took: Array, percentile: int) -> NDArray[np.bool_]:
    """Which steps stand for a percentile: flags of the shape of their times."""
    lower, upper = np.percentile(took, BANDS[percentile])
    found: NDArray[np.bool_] = (took >= lower) & (took <= upper)
    return found


def middle(rounds: Sequence[Timed]) -> Timed:
    """Of each tick the round that took it the median time: what else the machine did meanwhile is left out."""
    took = np.stack([one.took for one in rounds])
    chosen = np.argsort(took, axis=0)[len(rounds) // 2]
    ticks = np.arange(chosen.size)
    return Timed(took[chosen, ticks], np.stack([one.parts for one in rounds])[chosen, ticks])


def profile(session: TapedSession, rounds: int) -> dict[tuple[str, int], dict[str, float]]:
    """By side and percentile, the time of each part [us], of the whole step, and of that without clocks.

    Args:
        session: With the default operator.
        rounds: How often, after once to warm up; each with clocks and without.
    """
    session.times()
    bare, clocked = [], []
    for _ in range(rounds):
        bare.append(session.times())
        clocked.append(timed_round(session, bare[-1]))
    found = {}
    for side, parts in PARTS.items():
        timed = middle([one[side] for one in clocked])
        plain = 1e6 * np.median([one[side][one["contact"] > 0.0] for one in bare], axis=0)
        for percentile in BANDS:
            chosen = near(timed.took, percentile)
            means = timed.parts[chosen].mean(axis=0).tolist()
            found[side, percentile] = {
                STEP: float(timed.took[chosen].mean()),
                **dict(zip([part.name for part in parts], means, strict=True)),
                WITHOUT: float(plain[near(plain, percentile)].mean()),
            }
    return found


def named(side: str, name: str, percentile: int, *, share: bool = False) -> str:
    """What the row of a part says that it is.

    Args:
        side: Whose step.
        name: Of the part.
        percentile: Of `BANDS`.
        share: Whether of the step [%], else its time [us].
    """
    return f"{side}: {name}, {'share of the step, ' if share else ''}{percentile} %"


def measure_profile(scope: Scope) -> list[Row]:
    """Each part's time at both percentiles, and its share of the median step."""
    found = profile(TapedSession(DURATION), ROUNDS)
    rows = [
        Row(named(side, name, percentile), time, "us", rounds=ROUNDS)
        for (side, percentile), times in found.items()
        for name, time in times.items()
        if (name, percentile) != (WITHOUT, 50)
    ]
    shares = [
        Row(named(side, part.name, 50, share=True), 100.0 * times[part.name] / times[STEP], "%", rounds=ROUNDS)
        for side, times in ((side, found[side, 50]) for side in PARTS)
        for part in PARTS[side]
    ]
    return rows + shares

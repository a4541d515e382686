"""The paper's experiment on sponge, foam and hand in simulated time, and what to say of the parameters' course.

An operator presses, a session runs; then parameters settle, swing or jump.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import Device
from foretouch.devices.device import limit_force, minimum_jerk
from foretouch.errors import SettingError, UnknownNameError
from foretouch.messages import SessionLog
from foretouch.quantities import Array, Brief
from foretouch.robot import Material, make_material, make_robot
from foretouch.session import SessionSettings, simulate

History = Mapping[str, Array]

JUMP_TIME = 0.1  # changes within this time are jumps [s]: a twelfth of a compression


def settled_at(history: History, period: float, band: float | None) -> int | None:
    """Iteration from which on s stays where it is in the end; None where it leaves within the last two presses.

    Where it is in the end is a band [-] to either side of its median over the last two presses, or without a band its
    range over these two, wider by half of itself on either side. The period of a press is in s.
    """
    time, s = history["time"], history["s"]
    if not time.size:
        return None
    late = time > time[-1] - 2.0 * period
    middle, half = float(np.median(s[late])), band
    if half is None:
        low, high = float(s[late].min()), float(s[late].max())
        middle, half = 0.5 * (low + high), high - low
    outside = np.flatnonzero(np.abs(s - middle) > half)
    if not outside.size:
        return int(history["iteration"][0])
    return None if late[outside[-1]] else int(history["iteration"][outside[-1] + 1])


def swing(history: History, period: float) -> tuple[float, float]:
    """Period of the strongest sine in ln k after the first press [s], and the ratio of the variance that it explains.

    A quadratic drift is taken off first. Sines from 0.4 s to 1.6 periods of a press [s] are tried.
    """
    time = np.arange(history["time"][0] + period, history["time"][-1], 0.02)
    values = np.interp(time, history["time"], history["ln_k"])
    values = values - np.polyval(np.polyfit(time, values, 2), time)
    total = float(values @ values)
    if not total > 1e-20 * values.size:  # rounding alone is left
        return math.nan, 0.0
    periods = np.arange(0.4, 1.6 * period, 0.02)
    fractions = []
    for tried in periods:
        phase = 2.0 * np.pi * time / tried
        columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
        left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        fractions.append(1.0 - float(left @ left) / total)
    best = int(np.argmax(fractions))
    return float(periods[best]), fractions[best]


def jump(history: History, after: float) -> float:
    """Largest change of ln k within 0.1 s, after a time [s] since the first sample: 1 is a factor of e in k."""
    time = np.arange(history["time"][0] + after, history["time"][-1], 0.5 * JUMP_TIME)
    values = np.interp(time, history["time"], history["ln_k"])
    return float(np.abs(values[2:] - values[:-2]).max())


def local_stiffness(ln_k: Array, s: Array, depth: float) -> Array:
    """dF/dx = k s x^(s-1) of a slow press [N/m] at a depth [m]."""
    with np.errstate(over="ignore"):
        return np.asarray(s * np.exp(ln_k + (s - 1.0) * np.log(depth)))


def stiffness_in_phases(
    history: History, turns: Sequence[float], depth: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Medians over compression and over restitution: of k [N/m^s], and of dF/dx at a depth [m] in N/m.

    Compression begins at the first of the turning points, which are times [s]; the history is one of `Watched`.
    """
    compressing = np.zeros(history["time"].size, dtype=np.bool_)
    inside = (history["time"] >= turns[0]) & (history["time"] < turns[-1])
    for begin, end in list(pairwise(turns))[::2]:
        compressing |= (history["time"] >= begin) & (history["time"] < end)
    with np.errstate(over="ignore"):
        k = np.exp(history["ln_k"])
    slope = local_stiffness(history["ln_k"], history["s"], depth)
    into, out = compressing & inside, ~compressing & inside
    first, second = ((float(np.median(values[into])), float(np.median(values[out]))) for values in (k, slope))
    return first, second


def material_stiffness(position: Array, force: Array, turns: Sequence[float], time: Array, at: float) -> list[float]:
    """Slope of the felt force [N/m] within 0.5 mm of a position [m], in each phase between two turning points."""
    slopes = []
    for begin, end in pairwise(turns):
        near = (time >= begin) & (time < end) & (np.abs(position - at) < 5e-4)
        slopes.append(float(np.polyfit(position[near], force[near], 1)[0]))
    return slopes


def in_deep_half(history: History, deepest: float, depth: float) -> NDArray[np.intp]:
    """Indices of the samples at more than half of its depth [m], within 1.5 s of when a press is deepest [s]."""
    return np.flatnonzero((np.abs(history["time"] - deepest) < 1.5) & (history["depth"] > 0.5 * depth))


def peak(values: Array, inside: NDArray[np.intp]) -> int | None:
    """Index of the largest of some values, None where there are fewer than three."""
    return int(inside[np.argmax(values[inside])]) if inside.size >= 3 else None


def stiffness_at_force(ln_k: float, s: float, force: float) -> float:
    """dF/dx of F = k x^s [N/m] where the force is `force` [N]: s F / x."""
    return s * force / float(np.exp((np.log(force) - ln_k) / s))


MATERIALS = ("sponge", "foam", "hand")
"""Materials in the order of the paper's Figs. 10 and 11."""

FORCE_DELAY = 0.3  # delay of models and telemetry in the paper's experiment [s]

PRESS_PERIOD = 2.5
"""Period of one compression and one restitution of sponge and foam [s]; the paper gives none, its figures last 14 s."""

APPROACH, FIRST_PRESS = 0.6, 1.5
"""Times at which the probe waits above the surface, and at which it begins to press [s]."""

CLEARANCE = -0.003  # depth at which the probe waits [m]: above the surface

Script = tuple[tuple[float, float], ...]
"""Turning points of the hand: time [s] and depth [m], negative above the surface."""

BACK, FURTHER_BACK = 1.0 / 2.0, 1.0 / 3.0
"""Fraction of the depth kept in each restitution of sponge and foam: without leaving contact, and nearly leaving it."""

_HAND: Script = (
    *((3.2, 0.0070), (4.9, -0.002), (5.4, -0.002)),
    *((7.4, 0.0082), (9.4, -0.002), (9.9, -0.002)),
    *((11.5, 0.0065), (13.1, -0.002), (14.0, -0.002)),
)
_DEEPEST = {"sponge": 0.015, "foam": 0.019}


def make_script(material: str, presses: int | None = None, *, back: float = BACK) -> Script:
    """Turning points of the operator after the approach, on one of `MATERIALS`, for all presses or the first ones.

    Sponge and foam are penetrated five times, and each time let go to the fraction `back` of the depth. The hand is
    pressed three times, the second time deepest, with less than 15 N, and left each time.
    """
    if material not in MATERIALS:
        raise UnknownNameError("material of the experiment", material, MATERIALS)
    if material == "hand":
        return _HAND if presses is None else _HAND[: 3 * presses]
    deepest, half = _DEEPEST[material], 0.5 * PRESS_PERIOD
    return tuple(
        (FIRST_PRESS + (turn + 1) * half, deepest if turn % 2 == 0 else back * deepest)
        for turn in range(2 * (5 if presses is None else presses))
    )


class SlowPresses(Device):
    """Smooth slow presses by a script of turning points, open loop; the same on every run.

    From 0 the hand comes to 3 mm above the surface, which is at 4 mm or beyond, waits, and goes from turning point to
    turning point in minimum-jerk moves; their times [s] increase from 1.5 s on.
    """

    __slots__ = ("_positions", "_times")
    name: ClassVar[str] = "slow-presses"
    closed_loop: ClassVar[bool] = False

    def __init__(self, surface: float, script: Sequence[tuple[float, float]]) -> None:
        if not 0.004 <= surface < math.inf:
            raise SettingError("surface", surface, "must be at least 0.004 m: the hand waits 3 mm above it")
        points = [(APPROACH, CLEARANCE), (FIRST_PRESS, CLEARANCE), *script]
        self._times = [0.0, *(time for time, _ in points)]
        self._positions = [0.0, *(surface + depth for _, depth in points)]
        if any(later <= earlier for earlier, later in zip(self._times, self._times[1:], strict=False)):
            raise SettingError("script", tuple(script), f"its times must increase, from {FIRST_PRESS} s on")

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; after the last turning point it rests there."""
        time = now_ns * 1e-9
        move = bisect_right(self._times, time)
        if move >= len(self._times):
            return self._positions[-1]
        begin, here = self._times[move - 1], self._positions[move - 1]
        there = self._positions[move]
        return here + (there - here) * minimum_jerk((time - begin) / (self._times[move] - begin))

    def render(self, force: float) -> float:
        """Limit the force [N] as every device does; no hand feels it."""
        return limit_force(force)


@dataclass(frozen=True, eq=False)
class Experiment(Brief):
    """One session on one material."""

    material: Material  # material that is pressed
    # turning points after the approach, in the operator's time, which is that of `foretouch.report.pair`
    script: Script
    log: SessionLog  # the session's log

    @property
    def deepest(self) -> tuple[float, ...]:
        """Times at which the hand is deepest, one for each press [s]."""
        depths = [CLEARANCE, *(depth for _, depth in self.script), -math.inf]
        return tuple(
            time
            for (time, depth), before, after in zip(self.script, depths, depths[2:], strict=False)
            if depth > 0.0 and depth > before and depth > after
        )


@cache
def run_experiment(name: str, presses: int | None = None, *, back: float = BACK, seed: int = 0) -> Experiment:
    """The session on one material, with the real steps of both sides, 80 ms out and 300 ms back, as in the paper.

    The seed is that of the noise of sensor and encoder; the rest is as in `make_script`.
    """
    script = make_script(name, presses, back=back)
    material = make_material(name)
    settings = SessionSettings(
        material=name,
        model="continuous-switching",
        estimator="fprls",
        position_delay=0.08,
        force_delay=FORCE_DELAY,
        seed=seed,
    )
    session = simulate(
        settings,
        duration=script[-1][0],
        operator=SlowPresses(material.surface, script),
        robot=make_robot(material, seed=settings.seed),
    )
    return Experiment(material, script, session.log)

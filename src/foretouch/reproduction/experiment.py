"""The paper's experiment on sponge, foam and hand, in simulated time: an operator that presses, and the session."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

from foretouch.devices import Device
from foretouch.devices.device import limit_force, minimum_jerk
from foretouch.errors import SettingError, UnknownNameError
from foretouch.messages import SessionLog
from foretouch.quantities import Brief
from foretouch.robot import Material, make_material, make_robot
from foretouch.session import SessionSettings, simulate

__all__ = [
    "FORCE_DELAY",
    "FURTHER_BACK",
    "MATERIALS",
    "PRESS_PERIOD",
    "Experiment",
    "Script",
    "SlowPresses",
    "make_script",
    "run_experiment",
]

MATERIALS = ("sponge", "foam", "hand")
"""In the order of the paper's Figs. 10 and 11."""

FORCE_DELAY = 0.3
"""Of models and telemetry in the paper's experiment [s]."""

PRESS_PERIOD = 2.5
"""Of one compression and one restitution of sponge and foam [s]; the paper gives none, its figures last 14 s."""

APPROACH, FIRST_PRESS = 0.6, 1.5
"""When the probe waits above the surface, and when it begins to press [s]."""

CLEARANCE = -0.003
"""Depth at which the probe waits [m]: above the surface."""

Script = tuple[tuple[float, float], ...]
"""Turning points of the hand: time [s] and depth [m], negative above the surface."""


BACK, FURTHER_BACK = 1.0 / 2.0, 1.0 / 3.0
"""Share of the depth to which sponge and foam are let go in each restitution: without being left, and nearly so."""

_HAND: Script = (
    *((3.2, 0.0070), (4.9, -0.002), (5.4, -0.002)),
    *((7.4, 0.0082), (9.4, -0.002), (9.9, -0.002)),
    *((11.5, 0.0065), (13.1, -0.002), (14.0, -0.002)),
)

_DEEPEST = {"sponge": 0.015, "foam": 0.019}


def make_script(material: str, presses: int | None = None, *, back: float = BACK) -> Script:
    """What the operator does after the approach.

    Sponge and foam are penetrated, five times if not said otherwise, and each time let go to a share of the depth. The
    hand is pressed three times, the second time deepest, with less than 15 N, and left each time.

    Args:
        material: One of `MATERIALS`.
        presses: Counted from the first; None for all.
        back: That share, for sponge and foam.

    Raises:
        UnknownNameError: No such material here.
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

    From 0 the hand comes to 3 mm above the surface, waits, and then goes from turning point to turning point in
    minimum-jerk moves.

    Args:
        surface: Position of the undeformed surface [m], at least 0.004.
        script: Times [s], increasing, from 1.5 s on, and depths [m].

    Raises:
        SettingError: A surface or a script out of range.
    """

    __slots__ = ("_places", "_times")
    name: ClassVar[str] = "slow-presses"
    closed_loop: ClassVar[bool] = False

    def __init__(self, surface: float, script: Sequence[tuple[float, float]]) -> None:
        if not 0.004 <= surface < math.inf:
            raise SettingError("surface", surface, "must be at least 0.004 m: the hand waits 3 mm above it")
        points = [(APPROACH, CLEARANCE), (FIRST_PRESS, CLEARANCE), *script]
        self._times = [0.0, *(time for time, _ in points)]
        self._places = [0.0, *(surface + depth for _, depth in points)]
        if any(later <= earlier for earlier, later in zip(self._times, self._times[1:], strict=False)):
            raise SettingError("script", tuple(script), f"its times must increase, from {FIRST_PRESS} s on")

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; after the last turning point it rests there."""
        time = now_ns * 1e-9
        move = bisect_right(self._times, time)
        if move >= len(self._times):
            return self._places[-1]
        begin, here = self._times[move - 1], self._places[move - 1]
        there = self._places[move]
        return here + (there - here) * minimum_jerk((time - begin) / (self._times[move] - begin))

    def render(self, force: float) -> float:
        """Nobody feels it: the force [N] within the limit that every device has."""
        return limit_force(force)


@dataclass(frozen=True, eq=False)
class Experiment(Brief):
    """One session on one material.

    Attributes:
        material: Pressed.
        script: Turning points after the approach, in the operator's time, which is that of `foretouch.report.pair`.
        log: What was said.
    """

    material: Material
    script: Script
    log: SessionLog

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

    Args:
        name: One of `MATERIALS`.
        presses: As of `make_script`.
        back: As of `make_script`.
        seed: Of the noise of sensor and encoder, not negative; the motion is the same.

    Raises:
        UnknownNameError: No such material here.
        MissingExtraError: MuJoCo is not installed.
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

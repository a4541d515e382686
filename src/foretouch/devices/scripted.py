"""Operators without a person: one that presses by script, and one that waits where it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from foretouch.devices.device import PEAK_SPEED_RATIO, Device, Operator, limit_force, minimum_jerk
from foretouch.errors.checks import require


class RestingOperator(Device):
    """A hand at 0 that never moves: it stands in for a script where the surface is unknown."""

    __slots__ = ()
    name: ClassVar[str] = "resting"
    closed_loop: ClassVar[bool] = False

    def read(self, now_ns: int) -> float:
        """Position of the hand: 0 [m]."""
        return 0.0

    def render(self, force: float) -> float:
        """Limit the force [N] as every device does; no hand feels it."""
        return limit_force(force)


APPROACH_SPEED = 0.05  # Peak speed [m/s] of the first approach through free air
APPROACH_TIME, FREE_AIR_TIME = 0.6, 1.0
"""Shortest approach [s], and when the first press begins [s] (later only where the surface is far away)."""
FIRST_SPEED, SLOWEST, FASTEST = 0.045, 0.015, 0.055
"""Peak speeds of presses [m/s]: of the first, and the bounds of all others."""
SHORTEST_MOVE = 0.25  # Shortest time of a press [s]: a small one would otherwise be a jerk
CLEARANCE = (0.002, 0.004)  # Height at which the hand rests above the surface between presses [m]
LARGEST_DRIFT = 2e-4  # Bound on the slow wander [m]
DRIFT_RATES = (0.62, 1.74)  # Rates of the wander's two sines [rad/s]


class ScriptedOperator(Operator):
    r"""Presses like those of a palpating hand: smooth, never two alike, without end, the same for one seed.

    From 0 the hand comes close to the surface, waits in free air until 1 s has passed, touches before 1.5 s, and then
    presses for ever: to 30 to 100 % of `press_depth`, at a peak of 15 to 55 mm/s, holds for up to 0.6 s, leaves the
    material by 2 to 4 mm, rests. Every move is a minimum-jerk move; two slow sines (0.1 and 0.3 Hz, together 0.2 mm at
    most) make the hand wander. Position, velocity and acceleration are continuous.

    Args:
        surface: Position of the undeformed surface [m], 0.001 to 0.2; up to 0.03 the first touch is before 1.5 s.
        press_depth: Depth of the deepest presses below the surface [m], 0.0005 to 0.1.
        seed: Seed of depths, speeds and pauses, not negative.

    Raises:
        SettingError: An argument out of range.
    """

    __slots__ = ("_drift", "_move", "_moves", "_phases")
    name: ClassVar[str] = "scripted"

    def __init__(self, surface: float, press_depth: float, seed: int = 0) -> None:
        super().__init__()
        require("surface", surface, at_least=0.001, at_most=0.2)
        require("press_depth", press_depth, at_least=0.0005, at_most=0.1)
        require("seed", seed, at_least=0)
        random = np.random.default_rng(seed)
        self._drift = min(LARGEST_DRIFT, 0.02 * press_depth)
        self._phases = tuple(random.uniform(0.0, 2.0 * math.pi, 2).tolist())
        self._moves = _moves(surface, press_depth - self._drift, random)
        self._move = next(self._moves)

    def position_at(self, time: float) -> float:
        """Position of the hand [m] at a time since the first `read` [s], which never goes back."""
        begin, duration, here, there = self._move
        while time >= begin + duration:
            begin, duration, here, there = self._move = next(self._moves)
        position = here + (there - here) * minimum_jerk((time - begin) / duration)
        first, second = self._phases
        wander = math.sin(DRIFT_RATES[0] * time + first) + math.sin(DRIFT_RATES[1] * time + second)
        return position + 0.5 * self._drift * minimum_jerk(time) * wander


def _moves(surface: float, deepest: float, random: np.random.Generator) -> Iterator[tuple[float, float, float, float]]:
    """Endless moves: begin [s], duration [s], from [m], to [m]; a pause is a move to the same place."""

    def uniform(bounds: tuple[float, float]) -> float:
        return float(random.uniform(*bounds))

    here = surface - min(uniform(CLEARANCE), 0.5 * surface)
    duration = max(APPROACH_TIME, PEAK_SPEED_RATIO * here / APPROACH_SPEED)
    yield 0.0, duration, 0.0, here
    time = max(duration + 0.1, FREE_AIR_TIME)
    yield duration, time - duration, here, here
    speed = FIRST_SPEED
    while True:
        bottom = surface + deepest * uniform((0.3, 1.0))
        top = surface - min(uniform(CLEARANCE), 0.5 * surface)
        for there, pause in ((bottom, uniform((0.0, 0.6))), (top, uniform((0.1, 0.5)))):
            duration = max(SHORTEST_MOVE, PEAK_SPEED_RATIO * abs(there - here) / speed)
            yield time, duration, here, there
            yield time + duration, pause, there, there
            time += duration + pause
            here = there
            speed = uniform((SLOWEST, FASTEST))

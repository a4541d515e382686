"""A simulated robot behind the safety layer, as the follower has it, and the limits that its path keeps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from foretouch.identification import Conditioner
from foretouch.robot import make_robot
from foretouch.session.safety import kernel
from foretouch.session.safety.safety import STATES, Safety, SafetyLimits

TICK = 1e-3
SPEED, ACCELERATION, JERK = 0.25, 40.0, 1e5


def kept(path: list[float]) -> None:
    """The limits, by differences of the path; who stops going deeper may brake five times as hard, at once."""
    values = np.array(path)
    speed = np.diff(values) / TICK
    acceleration = np.diff(speed) / TICK
    assert np.abs(speed).max(initial=0.0) <= SPEED * (1 + 1e-9)
    brakes = (speed[:-1] > 0.0) & (acceleration < 0.0)
    assert np.abs(acceleration[1:][~brakes[1:]]).max(initial=0.0) <= ACCELERATION * (1 + 1e-6)
    assert np.abs(acceleration[1:]).max(initial=0.0) <= 5.0 * ACCELERATION * (1 + 1e-6)
    quiet = ~(brakes[1:-1] | brakes[2:])
    assert np.abs(np.diff(acceleration[1:]))[quiet].max(initial=0.0) / TICK <= JERK * (1 + 1e-6)


def keep_safe(safety: Safety, desired: float, sensed: tuple[Any, ...], surface: float, silence: float) -> float:
    """A tick of safety along a line: the position for the robot [m]; `sensed` may end with faulty and uncertain."""
    *shown, faulty, uncertain = (*sensed, False, False)[:5]
    stopped, rest = safety.stop_reason != "", (surface, silence, faulty, False, -math.inf, uncertain)
    safety.status = STATES[kernel.keep_safe.entry(safety.memories, stopped, desired, *shown, *rest)[1]]
    return kernel.limit.entry(safety.memories)


class Pressed:
    def __init__(self, material: str, *, force_limit: float = 15.0, **limits: float | bool) -> None:
        self.robot = make_robot(material, seed=1, force_limit=force_limit)
        workspace = self.robot.specification.workspace
        self.safety = Safety(SafetyLimits(workspace=workspace, **limits), TICK)  # type: ignore[arg-type]
        self.conditioner = Conditioner()
        self.sample = self.robot.read()
        self.path: list[float] = []
        self.forces: list[float] = []
        self.felt = 0.0
        self._silence = 0.0

    def run(self, desired: float, seconds: float, *, silent: bool = False, faulty: bool = False) -> None:
        """Tell it to be somewhere [m] for a while, or tell it nothing: a silence goes on from the one before."""
        for _ in range(round(seconds / TICK)):
            self._silence = self._silence + TICK if silent else 0.0
            force = self.sample.sensor_force - self.robot.specification.tool_force(self.sample.acceleration)
            felt = self.conditioner.update(TICK * len(self.path), self.sample.position, force)
            sensed = self.sample.position, felt.force, felt.in_contact, faulty
            told = keep_safe(self.safety, desired, sensed, self.conditioner.surface, self._silence)
            self.felt = felt.force
            self.path.append(told)
            self.sample = self.robot.exchange(told)
            self.forces.append(self.sample.exact_force)

"""An arm that presses along a line: its tip stays on the vertical through the scene's origin."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from foretouch.models import ContactState
from foretouch.robot.arms.arm import ArticulatedArm
from foretouch.robot.arms.description import ArmDescription
from foretouch.robot.materials import Material
from foretouch.robot.robot import Robot, RobotSample, SpatialSample, Vector


class ArmAlongLine(Robot):
    """An arm over a block of material, as a robot along a line.

    Position 0 is the origin of the scene, and a position grows downwards into the material. What the tip does to the
    side the block does not resist.

    Args:
        description: Of the arm.
        material: Material that the probe presses.
        seed: Seed of sensor and encoder noise, not negative.
        **options: Of `ArticulatedArm`.

    Attributes:
        arm: The arm inside.
        material: As given.
        surface: Position of the undeformed surface [m].
    """

    def __init__(self, description: ArmDescription, material: Material, *, seed: int, **options: Any) -> None:
        self.material, self.surface = material, material.surface
        self._state: ContactState = material.model.initial_state()
        self.arm = ArticulatedArm(description, self._touch, seed=seed, start=(0.0, 0.0, 0.0), **options)
        (_, _, low), (_, _, high) = self.arm.reach
        self.specification = replace(self.arm.specification, workspace=(-high, -low))
        self._position = 0.0

    def _touch(self, place: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Force of the material on the tip [N]; see `foretouch.robot.TouchedWorld`."""
        self._state, force, _ = self.material.model.advance(
            self._state, -place[2] - self.surface, -velocity[2], elapsed
        )
        return 0.0, 0.0, force if self.material.pulls else max(force, 0.0)

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return self.arm.fresh

    @property
    def says(self) -> str:
        """See `AnyRobot.says`."""
        return self.arm.says

    def read(self) -> RobotSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._along(self.arm.read())

    def exchange(self, desired_position: float) -> RobotSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `Robot`."""
        if math.isfinite(desired_position):
            self._position = desired_position
        return self._along(self.arm.exchange((0.0, 0.0, -self._position)))

    def _along(self, sample: SpatialSample) -> RobotSample:
        felt, exact = sample.force[2], sample.exact_force[2]
        places = -sample.place[2], -sample.exact_place[2]
        return RobotSample(
            places[0], felt, 0.0, exact, places[1], -self.arm.commanded[2], sample.clipped, math.nan, sample.held
        )

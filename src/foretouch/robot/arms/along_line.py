"""An arm that presses along a line: its tip stays on the vertical through the scene's origin."""

from __future__ import annotations

from typing import Any

from foretouch.models import ContactState
from foretouch.robot.along_line import AlongLine
from foretouch.robot.arms.arm import ArticulatedArm
from foretouch.robot.arms.description import ArmDescription
from foretouch.robot.materials import Material
from foretouch.robot.robot import Vector


class ArmAlongLine(AlongLine):
    """An arm over a block of material, as a robot along a line.

    Position 0 is the origin of the scene. What the tip does to the side the block does not resist.

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
        super().__init__(ArticulatedArm(description, self._touch, seed=seed, start=(0.0, 0.0, 0.0), **options))

    def _touch(self, place: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Force of the material on the tip [N]; see `foretouch.robot.TouchedWorld`."""
        self._state, force, _ = self.material.model.advance(
            self._state, -place[2] - self.surface, -velocity[2], elapsed
        )
        return 0.0, 0.0, force if self.material.pulls else max(force, 0.0)

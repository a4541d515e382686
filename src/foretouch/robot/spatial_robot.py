"""What a follower robot in three dimensions is: places in, sensors out, one exchange a sample period."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple, TypeAlias

from foretouch.robot.robot import RobotSpecification

__all__ = ["SpatialRobot", "SpatialSample", "Vector"]

Vector: TypeAlias = tuple[float, float, float]
"""In the world's frame, z up."""


class SpatialSample(NamedTuple):
    """What the robot's sensors show after one sample period. Places are of the probe's tip.

    Attributes:
        place: From the encoders [m].
        force: Contact force on the probe [N] as its sensor gives it, less the tool's weight and inertia; its offset is
            in it.
        exact_force: The simulator's own contact force on the probe [N]; NaN on hardware.
        exact_place: The simulator's own place [m]; NaN on hardware.
        fixture: The simulator's own pose of what is touched, a place [m] and a rotation vector [rad]; empty on
            hardware.
        clipped: Whether a force limit cut the command in this tick.
    """

    place: Vector
    force: Vector
    exact_force: Vector
    exact_place: Vector
    fixture: tuple[float, ...]
    clipped: bool


class SpatialRobot(ABC):
    """A position-controlled follower that moves its probe in three dimensions, with a force sensor of three axes.

    Attributes:
        specification: What there is to know about it; of the workspace, the lowest and highest place along each axis is
            `reach`, and the tool is weighed out already.
        reach: Lowest and highest place [m].
    """

    specification: RobotSpecification
    reach: tuple[Vector, Vector]

    @abstractmethod
    def read(self) -> SpatialSample:
        """What the sensors show now; no time passes and nothing moves."""

    @abstractmethod
    def exchange(self, desired: Vector) -> SpatialSample:
        """Give a command, let one sample period pass, and return what the sensors show then.

        Never raises on bad data.

        Args:
            desired: Where the tip should be now [m]; limited to the reach. One that is not finite is left out: the one
                before holds.
        """

    def close(self) -> None:
        """Give back what the robot holds; a second call does nothing."""
        return None

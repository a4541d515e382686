"""A robot that moves in space, as one along a line: its tip stays on the vertical through a place."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from foretouch.robot.robot import Robot, RobotSample, SpatialSample, Vector


class AlongLine(Robot):
    """A robot in space along the vertical through a place of its frame.

    Position 0 is that place, and a position grows downwards, into what is pressed.

    Args:
        arm: A `SpatialRobot` that has an attribute `commanded`, the place that it was told to go to in the end [m].
        origin: The place [m].

    Attributes:
        arm: As given.
    """

    def __init__(self, arm: Any, origin: Vector = (0.0, 0.0, 0.0)) -> None:
        self.arm, self._origin, self._position = arm, origin, math.nan  # which an arm leaves out
        (_, _, low), (_, _, high) = arm.reach
        self.specification = replace(arm.specification, workspace=(origin[2] - high, origin[2] - low))

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return bool(self.arm.fresh)

    @property
    def says(self) -> str:
        """See `AnyRobot.says`."""
        return str(self.arm.says)

    def read(self) -> RobotSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._along(self.arm.read())

    def exchange(self, desired_position: float) -> RobotSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `Robot`."""
        x, y, z = self._origin
        if math.isfinite(desired_position):
            self._position = desired_position
        return self._along(self.arm.exchange((x, y, z - self._position)))

    def close(self) -> None:
        """Give back what the arm holds; a second call does nothing."""
        self.arm.close()

    def _along(self, sample: SpatialSample) -> RobotSample:
        felt, exact, z = sample.force[2], sample.exact_force[2], self._origin[2]
        places = z - sample.place[2], z - sample.exact_place[2], z - self.arm.commanded[2]
        return RobotSample(places[0], felt, 0.0, exact, places[1], places[2], sample.clipped, math.nan, sample.held)

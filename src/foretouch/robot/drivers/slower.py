"""Robots that take a command less often than a session gives one."""

from __future__ import annotations

import dataclasses
from typing import Any

from foretouch.errors import InputError
from foretouch.robot.robot import Place, Robot, RobotSample, Sample, SpatialRobot, SpatialSample, Wrapped

SLOWEST = 0.005  # Longest period of a robot [s]: with a longer one a session holds at once, as with a slow loop


class _Slower(Wrapped[Place, Sample]):
    """A robot of 500, 250 or 200 Hz in a session of 1 kHz.

    It is exchanged with in every 2nd, 4th or 5th tick, by the newest command; between, it shows what it showed. So a
    command is late by up to its period, and a force, too. `exchange` of the robot inside must not wait for its cycle.

    Args:
        robot: Whose sample period is a whole number of the session's.
        tick: Sample period of the session [s].

    Raises:
        InputError: Its period is none of 1 to 5 ms.
    """

    def __init__(self, robot: Any, tick: float = 1e-3) -> None:
        super().__init__(robot)
        self._ticks = ticks_of(robot.specification.sample_period, tick)
        self.specification = dataclasses.replace(robot.specification, sample_period=tick)
        self._sample: Sample = robot.read()

    @property
    def says(self) -> str:
        """What the robot says, and what its rate costs."""
        period = 1e3 * self._ticks * self.specification.sample_period
        cost = f"it takes a command every {period:g} ms, so commands and forces are up to {period:g} ms later"
        return "; ".join(filter(None, (self.robot.says, cost)))

    def exchange(self, desired_position: Place) -> Sample:
        """Give a command where the robot takes one, and return what it showed last: see `AnyRobot`."""
        if self._exchanges % self._ticks == 0:
            self._sample = self.robot.exchange(desired_position)
        self._exchanges += 1
        return self._sample


class SlowerRobot(_Slower[float, RobotSample], Robot):
    """A slower robot along a line; see `ticks_of` for its rates."""


class SlowerSpatialRobot(_Slower[tuple[float, float, float], SpatialSample], SpatialRobot):
    """The same in space."""

    def __init__(self, robot: SpatialRobot, tick: float = 1e-3) -> None:
        super().__init__(robot, tick)
        self.reach = robot.reach


def ticks_of(period: float, tick: float) -> int:
    """Number of a session's ticks in a robot's period.

    Raises:
        InputError: It is no whole number, or longer than 5 ms.
    """
    ticks = round(period / tick) if tick <= period <= SLOWEST else 0  # as for what is no number
    if ticks == 0 or abs(ticks * tick - period) > 1e-9:
        raise InputError(
            f"a sample period of {period:g} s: a session exchanges every {tick:g} s, and takes a robot of 1 kHz, 500, "
            "250 or 200 Hz: sample_period = 0.001, 0.002, 0.004 or 0.005"
        )
    return ticks

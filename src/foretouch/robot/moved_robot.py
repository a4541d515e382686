"""A robot that somebody else moves: with a pendant, by hand, by a program of its own."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.robot.robot import Robot, RobotSample

__all__ = ["MovedRobot"]


class MovedRobot(Robot):
    """Any robot, moved by a motion of its own; what it is told otherwise it leaves out.

    Its time is its own and begins at 0; an exchange is one sample period.

    Args:
        robot: That moves.
        position_at: Where it is moved to [m] at a time [s]; asked once for each exchange, in order.

    Attributes:
        robot: The robot inside.
    """

    def __init__(self, robot: Robot, position_at: Callable[[float], float]) -> None:
        self.robot = robot
        self.specification = robot.specification
        self._position_at = position_at
        self._exchanges = 0

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return self.robot.fresh

    def read(self) -> RobotSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self.robot.read()

    def exchange(self, desired_position: float) -> RobotSample:
        """Let one sample period pass and return what the sensors show then.

        Args:
            desired_position: Left out, whatever it is.
        """
        time = self._exchanges * self.specification.sample_period
        self._exchanges += 1
        return self.robot.exchange(self._position_at(time))

    def close(self) -> None:
        """Give back what the robot holds; a second call does nothing."""
        self.robot.close()

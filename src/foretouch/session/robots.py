"""The robot of a session: a simulated arm, or another package's."""

from __future__ import annotations

import math
from typing import Any

from foretouch.devices import Reach
from foretouch.errors import SettingError, UnknownNameError
from foretouch.plugins import make_plugin
from foretouch.robot import Material, Robot, SpatialRobot, make_robot
from foretouch.session.operators import reach_of, require_axes
from foretouch.session.settings import ROBOTS, SAMPLE_PERIOD, SessionSettings
from foretouch.session.workspace import framed_robot, inverse
from foretouch.settings import SIMULATED


def make_session_robot(settings: SessionSettings) -> tuple[Robot, Material | Reach]:
    """The robot of the settings, and how far what it presses is, as far as anybody knows.

    The simulated arm counts as the settings' follower frame says because it is built to, so that its own line of
    positions, in which the material is given, is the session's. Another package's counts as it does by itself, and the
    session translates it; its specification rules. Where it has an attribute ``material`` that is a
    `foretouch.robot.Material`, the operators know where to press; else they do not, and the surface is found by
    touching.

    Raises:
        UnknownNameError: No such robot or material.
        PluginError: Another package's robot, which cannot be made.
        SettingError: One that does not exchange once in a sample period of the session.
    """
    if settings.robot != SIMULATED:
        robot = foreign_robot(settings)
        return robot, reach_of(robot, settings)
    arm = make_robot(settings.material, seed=settings.seed)
    return mounted_robot(settings, arm), arm.material


def mounted_robot(settings: SessionSettings, arm: Any) -> Any:
    """A simulated arm with the settings' sensor fault, in their follower frame."""
    if settings.sensor_fault:
        arm = settings.workspace.faulty(arm, settings.sensor_fault, seed=settings.seed)
    return framed_robot(arm, inverse(settings.follower_frame))


def reach_texts(reach: Material | Reach) -> dict[str, str]:
    """Where a material is in the session's frame and how deep it is pressed, for an operator to reach it.

    Nothing where nobody knows.
    """
    lengths = {"surface": reach.surface, "press_depth": reach.press_depth}
    return {name: str(length) for name, length in lengths.items() if math.isfinite(length)}


def require_simulated_robot(robot: Robot | SpatialRobot, settings: SessionSettings) -> None:
    """Refuse a robot that does not live in simulated time.

    Raises:
        SettingError: It is a real one.
    """
    if not robot.specification.simulated:
        robot.close()
        raise SettingError("robot", settings.robot, "is a real one and needs real time: foretouch teleop")


def foreign_robot(settings: SessionSettings) -> Any:
    """Another package's robot; see `make_session_robot`."""
    kinds: Any = (Robot, SpatialRobot)
    robot = make_plugin("robot", settings.robot, kinds, settings, built_in=ROBOTS)
    if robot is None:
        raise UnknownNameError("robot", settings.robot, settings.robots())
    require_axes("robot", robot, settings.robot, settings)
    period = getattr(getattr(robot, "specification", None), "sample_period", None)
    if period != SAMPLE_PERIOD:
        robot.close()
        raise SettingError(
            "robot", settings.robot, f"has a sample period of {period} s: a session exchanges every {SAMPLE_PERIOD:g} s"
        )
    return robot

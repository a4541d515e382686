"""The robot of a session: a simulated arm, as the settings say; also one that somebody else moves."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.robot import FaultySensor, Material, MovedRobot, Robot, SensorFault, make_robot
from foretouch.session.frames import framed_robot, inverse
from foretouch.session.operators import make_operator
from foretouch.session.settings import SessionSettings
from foretouch.session.shadow import shadow_settings

__all__ = ["make_moved_robot", "make_session_robot"]


def make_session_robot(settings: SessionSettings) -> tuple[Robot, Material]:
    """The simulated arm that presses the settings' material, with its faults, and that material.

    It counts as the settings' follower frame says because it is built to, so that its own line of positions, in which
    the material is given, is the session's.
    """
    arm = make_robot(settings.material, seed=settings.seed)
    robot: Robot = arm
    if settings.sensor_fault:
        fault = SensorFault.from_text("sensor_fault", settings.sensor_fault)
        robot = FaultySensor(arm, fault, seed=settings.seed)
    return framed_robot(robot, inverse(settings.frames[1])), arm.material


def make_moved_robot(settings: SessionSettings, *, say: Callable[[str], None]) -> tuple[Robot, Material]:
    """The same arm, moved by the settings' operator as by somebody with a pendant, and the material.

    Args:
        settings: Of the session.
        say: Told in one line when the measured motion is not to be had and the script is used instead.
    """
    settings = shadow_settings(settings)
    robot, material = make_session_robot(settings)
    operator = make_operator(settings, surface=material.surface, press_depth=material.press_depth, say=say)
    frame = settings.frames[1]
    return MovedRobot(robot, lambda time: frame.outside(operator.read(round(time * 1e9)))), material

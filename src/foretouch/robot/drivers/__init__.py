"""Real arms: what a driver says and takes, and what keeps it safe whoever wrote it."""

from foretouch.robot.drivers.arm_link import ArmLink, ArmState
from foretouch.robot.drivers.driven_arm import DrivenArm, LostArmError, arm_robot
from foretouch.robot.drivers.slower import SlowerRobot, SlowerSpatialRobot

__all__ = ["ArmLink", "ArmState", "DrivenArm", "LostArmError", "SlowerRobot", "SlowerSpatialRobot", "arm_robot"]

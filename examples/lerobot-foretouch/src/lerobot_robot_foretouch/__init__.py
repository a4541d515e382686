"""A robot and a teleoperator named `foretouch` for LeRobot; importing this registers both."""

from lerobot_robot_foretouch.robot import ForetouchRobot, ForetouchRobotConfig
from lerobot_robot_foretouch.teleoperator import ForetouchTeleoperator, ForetouchTeleoperatorConfig

__all__ = ["ForetouchRobot", "ForetouchRobotConfig", "ForetouchTeleoperator", "ForetouchTeleoperatorConfig"]

"""What a force sensor carries and how it stands on what carries it, from static poses."""

from foretouch.identification.calibration.sensor_frame import (
    SensorFrame,
    check_orientations,
    check_torques,
    fit_sensor_frame,
    outlying_poses,
)
from foretouch.identification.calibration.tool_load import ToolLoadFit, fit_tool_load

__all__ = [
    "SensorFrame",
    "ToolLoadFit",
    "check_orientations",
    "check_torques",
    "fit_sensor_frame",
    "fit_tool_load",
    "outlying_poses",
]

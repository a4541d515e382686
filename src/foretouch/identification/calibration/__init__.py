"""What a force sensor carries and how it stands on what carries it, from static poses."""

from foretouch.identification.calibration.sensor_frame import SensorFrame, fit_sensor_frame, outlying_poses

__all__ = ["SensorFrame", "fit_sensor_frame", "outlying_poses"]

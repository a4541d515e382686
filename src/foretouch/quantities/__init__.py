"""What is measured: one table of names, units and signs, and the recording that holds the samples."""

from foretouch.quantities.brief import Brief, ByValue, brief_number, brief_text, measured, shortest
from foretouch.quantities.columns import (
    QUANTITIES,
    Array,
    Columns,
    Flags,
    Quantity,
    Rows,
    as_frame,
    in_words,
    new_figure,
    parameter_unit,
)
from foretouch.quantities.frames import BASE, CAMERA, FIXTURE, FLANGE, FRAMES, SENSOR, TIP, WORLD, wrong_frame
from foretouch.quantities.pose import Pose, cross_matrix
from foretouch.quantities.recording import LARGEST_POSITION, Frame, Recording, SpatialFrame, numbers_of
from foretouch.quantities.sensor_calibration import SensorCalibration
from foretouch.quantities.tool_load import STANDARD_GRAVITY, ToolLoad

__all__ = [
    "BASE",
    "CAMERA",
    "FIXTURE",
    "FLANGE",
    "FRAMES",
    "LARGEST_POSITION",
    "QUANTITIES",
    "SENSOR",
    "STANDARD_GRAVITY",
    "TIP",
    "WORLD",
    "Array",
    "Brief",
    "ByValue",
    "Columns",
    "Flags",
    "Frame",
    "Pose",
    "Quantity",
    "Recording",
    "Rows",
    "SensorCalibration",
    "SpatialFrame",
    "ToolLoad",
    "as_frame",
    "brief_number",
    "brief_text",
    "cross_matrix",
    "in_words",
    "measured",
    "new_figure",
    "numbers_of",
    "parameter_unit",
    "shortest",
    "wrong_frame",
]

"""Devices: where the operator's hand is, and what it is given to feel.

A `Device` is read and rendered to at every leader tick; it gets the time and reads no clock. The operators are open
loop: the force does not move them. A `Hand` wants what an operator does, holds a device of mass and friction, and is
moved by the force (closed loop).
"""

from foretouch.devices.browser import BrowserOperator
from foretouch.devices.device import AnyDevice, Device, DeviceSpecification, limit_force
from foretouch.devices.gamepad import UNKNOWN_REACH, Reach
from foretouch.devices.hand import GRIPS, INTENDED_FORCE, Grip, Hand
from foretouch.devices.recorded import RecordedOperator
from foretouch.devices.scripted import RestingOperator, ScriptedOperator
from foretouch.devices.spatial import (
    Keyframe,
    PalpatingOperator,
    RecordedPalpatingOperator,
    SpatialBrowserOperator,
    SpatialDevice,
    SpatialHand,
)

__all__ = [
    "GRIPS",
    "HARDWARE_OPERATORS",
    "INTENDED_FORCE",
    "OPERATORS",
    "UNKNOWN_REACH",
    "AnyDevice",
    "BrowserOperator",
    "Device",
    "DeviceSpecification",
    "Grip",
    "Hand",
    "Keyframe",
    "PalpatingOperator",
    "Reach",
    "RecordedOperator",
    "RecordedPalpatingOperator",
    "RestingOperator",
    "ScriptedOperator",
    "SpatialBrowserOperator",
    "SpatialDevice",
    "SpatialHand",
    "limit_force",
]

OPERATORS = ("scripted", "recorded", "browser")
"""Names of the operators in the package that need nothing else."""

HARDWARE_OPERATORS = ("gamepad", "force-dimension")
"""Names of those that need a thing in the hand: `foretouch.devices.gamepad` and `foretouch.devices.force_dimension`,
which are imported where they are asked for. Others come from `foretouch.plugins`."""

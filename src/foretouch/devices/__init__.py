"""Devices: where the operator's hand is, and what it is given to feel.

A `Device` is read and rendered to at every leader tick; it gets the time and reads no clock. The operators are open
loop: the force does not move them. A `Hand` wants what an operator does, holds a device of mass and friction, and is
moved by the force (closed loop).
"""

from foretouch.devices.browser import BrowserOperator
from foretouch.devices.device import Device
from foretouch.devices.grips import GRIPS, INTENDED_FORCE, Grip
from foretouch.devices.hand import Hand
from foretouch.devices.recorded import RecordedOperator
from foretouch.devices.scripted import ScriptedOperator
from foretouch.devices.spatial import Keyframe, PalpatingOperator, SpatialBrowserOperator, SpatialDevice, SpatialHand
from foretouch.devices.specification import DeviceSpecification

__all__ = [
    "GRIPS",
    "INTENDED_FORCE",
    "OPERATORS",
    "BrowserOperator",
    "Device",
    "DeviceSpecification",
    "Grip",
    "Hand",
    "Keyframe",
    "PalpatingOperator",
    "RecordedOperator",
    "ScriptedOperator",
    "SpatialBrowserOperator",
    "SpatialDevice",
    "SpatialHand",
]

OPERATORS = ("scripted", "recorded", "browser")
"""Names of the operators in the package."""

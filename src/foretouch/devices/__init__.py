"""Devices: where the operator's hand is, and what it is given to feel.

A `Device` is read and rendered to at every leader tick; it gets the time and reads no clock. All of them here are open
loop: the force does not move the hand.
"""

from foretouch.devices.browser import BrowserOperator
from foretouch.devices.device import Device
from foretouch.devices.recorded import RecordedOperator
from foretouch.devices.scripted import ScriptedOperator

__all__ = ["OPERATORS", "BrowserOperator", "Device", "RecordedOperator", "ScriptedOperator"]

OPERATORS = ("scripted", "recorded", "browser")
"""Names of the operators in the package."""

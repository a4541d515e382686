"""What the simulated arm's drive and force sensor do around a physics step, compiled; see `rcm_arm`.

What they remember is one array, by the places named here; it begins with the numbers of the insertion servo.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.robot.insertion_servo_kernel import SIZE as SERVO_SIZE
from foretouch.robot.insertion_servo_kernel import drive, take

__all__ = ["BUILT", "NOISE", "SENSOR", "SIZE", "TOOL", "begin", "effort", "sense"]

Array = NDArray[np.float64]

SENSOR, TOOL, NOISE, SPEED = range(SERVO_SIZE, SERVO_SIZE + 4)
"""Behind the low-pass, the force between carriage and tool and the part of it that the tool makes [N]; what the noise of
the sensor adds in this period [N]; velocity before the physics step [m/s]."""

H, LOW_PASS, TOOL_MASS, GRAVITY = range(SERVO_SIZE + 4, SERVO_SIZE + 8)
BUILT = slice(H, GRAVITY + 1)
"""What stays: length of a physics step [s], share of the way that the low-pass goes in it, kg, m/s^2."""

SIZE = SERVO_SIZE + 8


def _begin(arm: Array, desired: float, noise: float, velocity: float) -> None:
    """A sample period begins, with a command [m] and the noise that the drive has on its force [N]."""
    take(arm[:SERVO_SIZE], desired)
    arm[NOISE], arm[SPEED] = noise, velocity


begin: Callable[[Array, float, float, float], None] = njit("void(f8[::1], f8, f8, f8)", cache=True)(_begin)


def _effort(arm: Array, position: float, velocity: float) -> float:
    """Drive force for the next physics step [N], net of gravity."""
    return drive(arm[:SERVO_SIZE], position, velocity, arm[SENSOR] + arm[NOISE] - arm[TOOL], arm[H])


effort: Callable[[Array, float, float], float] = njit("f8(f8[::1], f8, f8)", cache=True)(_effort)


def _sense(arm: Array, velocity: float, compression: float) -> None:
    """After a physics step: what sensor and drive see of the force between carriage and tool [N]."""
    arm[SENSOR] += arm[LOW_PASS] * (compression - arm[SENSOR])
    tool = arm[TOOL_MASS] * ((velocity - arm[SPEED]) / arm[H] - arm[GRAVITY])
    arm[TOOL] += arm[LOW_PASS] * (tool - arm[TOOL])  # the drive's own compensation, as late as the sensor
    arm[SPEED] = velocity


sense: Callable[[Array, float, float], None] = njit("void(f8[::1], f8, f8)", cache=True)(_sense)

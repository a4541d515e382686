"""What the simulated arm's drive and sensors do around the physics steps of a sample period, compiled; see `rcm_arm`.

What they remember is one array, by the places named here; it begins with the numbers of the insertion servo.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.robot.insertion_servo_kernel import CLIPPED, REFERENCE, drive, take
from foretouch.robot.insertion_servo_kernel import SERVO_SIZE

__all__ = ["BUILT", "DESIRED", "SENSOR", "SERVO", "SHOWN", "SIZE", "TOOL", "begin", "effort", "sense", "show"]

Array = NDArray[np.float64]

SERVO = slice(0, SERVO_SIZE)

DESIRED, SENSOR, TOOL, SHOWN, NOISE, SPEED = range(SERVO_SIZE, SERVO_SIZE + 6)
"""The newest command [m]; behind the low-pass, the force between carriage and tool, and what the tool makes of it [N];
what the force sensor shows, and what of that the drive takes for noise [N]; velocity before the physics step [m/s]."""

H, LOW_PASS, TOOL_MASS, GRAVITY, LOWEST, HIGHEST = range(SERVO_SIZE + 6, SERVO_SIZE + 12)
ENCODER_NOISE, RESOLUTION, OFFSET, SENSOR_NOISE, RANGE, ACCELEROMETER_NOISE = range(SERVO_SIZE + 12, SERVO_SIZE + 18)
BUILT = slice(H, ACCELEROMETER_NOISE + 1)
"""What stays: length of a physics step [s], share of the way that the low-pass goes in it, then as `RcmArm` is told."""

SIZE = SERVO_SIZE + 18


def _begin(arm: Array, desired: float, velocity: float) -> None:
    """A sample period begins, with a command [m]; one that is not finite is left out."""
    if math.isfinite(desired):
        arm[DESIRED] = min(arm[HIGHEST], max(arm[LOWEST], desired))
    take(arm[SERVO], arm[DESIRED])
    arm[NOISE] = arm[SHOWN] - arm[SENSOR] - arm[OFFSET]  # the drive's own copy is tared at the start
    arm[SPEED] = velocity


begin = compiled("void(f8[::1], f8, f8)")(_begin)


def _effort(arm: Array, position: float, velocity: float) -> float:
    """Drive force for the next physics step [N], net of gravity."""
    return drive(arm[SERVO], position, velocity, arm[SENSOR] + arm[NOISE] - arm[TOOL], arm[H])


effort = compiled("f8(f8[::1], f8, f8)")(_effort)


def _sense(arm: Array, velocity: float, compression: float) -> None:
    """After a physics step: what sensor and drive see of the force between carriage and tool [N]."""
    arm[SENSOR] += arm[LOW_PASS] * (compression - arm[SENSOR])
    tool = arm[TOOL_MASS] * ((velocity - arm[SPEED]) / arm[H] - arm[GRAVITY])
    arm[TOOL] += arm[LOW_PASS] * (tool - arm[TOOL])  # the drive's own compensation, as late as the sensor
    arm[SPEED] = velocity


sense = compiled("void(f8[::1], f8, f8)")(_sense)


def _show(
    arm: Array, exact: float, encoder: float, sensor: float, accelerometer: float
) -> tuple[float, float, float, float, bool]:
    """What the sensors show at the end of a sample period, with a normal draw of noise for each.

    Returns:
        Position [m], sensor force [N], acceleration [m/s^2], the drive's own command after its limits [m], and whether
        the force limit cut it.
    """
    position = exact + arm[ENCODER_NOISE] * encoder
    if arm[RESOLUTION] > 0.0:
        position = round(position / arm[RESOLUTION]) * arm[RESOLUTION]
    felt = arm[SENSOR] + arm[OFFSET] + arm[SENSOR_NOISE] * sensor
    arm[SHOWN] = min(max(felt, -arm[RANGE]), arm[RANGE])
    acceleration = arm[TOOL] / arm[TOOL_MASS] + arm[GRAVITY] + arm[ACCELEROMETER_NOISE] * accelerometer
    return float(position), float(arm[SHOWN]), float(acceleration), float(arm[REFERENCE]), bool(arm[CLIPPED])


show = compiled("Tuple((f8, f8, f8, f8, b1))(f8[::1], f8, f8, f8, f8)")(_show)

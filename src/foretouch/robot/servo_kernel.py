"""The simulated arm's drive and sensors around the physics steps of a sample period, compiled.

The servo's equations are in `foretouch.robot.insertion_servo`, the arm is `foretouch.robot.rcm_arm`. What each
remembers is one array, by the places named here; that of the arm begins with the numbers of the servo.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

COMMAND, COMMAND_SLOPE, COMMAND_VELOCITY, COMMAND_VELOCITY_SLOPE, REFERENCE, VELOCITY, CLIPPED, NEWEST = range(8)

MASS, DAMPING, FORCE_LIMIT, PERIOD, VELOCITY_GAIN = range(8, 13)
RAIL = slice(MASS, VELOCITY_GAIN + 1)
"""Constants, as `InsertionServo` is given them."""

SERVO_SIZE = 13

REFERENCE_RATE = 400.0  # how fast the reference closes in on the command [rad/s]
LARGEST_VELOCITY = 0.5  # of the reference [m/s]
LARGEST_ACCELERATION = 30.0  # of the reference [m/s^2]; the joint could do 37 within 15 N
SERVO_RATE = 300.0  # bandwidth of the position loop [rad/s]
LARGEST_RETRACTION = 100.0  # drive force out of the material [N]


@compiled("f8(f8[::1], f8)")
def move_reference(state: NDArray[np.float64], h: float) -> float:
    """Move the reference and the command on by h seconds; gives the reference's acceleration [m/s^2]."""
    error = state[COMMAND] - state[REFERENCE]
    distance = abs(error)
    closing = min(0.5 * REFERENCE_RATE * distance, math.sqrt(1.4 * LARGEST_ACCELERATION * distance))
    wanted = state[COMMAND_VELOCITY] + math.copysign(closing, error)
    wanted = max(-LARGEST_VELOCITY, min(LARGEST_VELOCITY, wanted))
    acceleration = 2.0 * REFERENCE_RATE * (wanted - state[VELOCITY])
    acceleration = max(-LARGEST_ACCELERATION, min(LARGEST_ACCELERATION, acceleration))
    state[VELOCITY] += h * acceleration
    state[REFERENCE] += h * state[VELOCITY]
    state[COMMAND] += h * state[COMMAND_SLOPE]
    state[COMMAND_VELOCITY] += h * state[COMMAND_VELOCITY_SLOPE]
    return float(acceleration)


@compiled("void(f8[::1], f8)")
def take(state: NDArray[np.float64], position: float) -> None:
    """See `InsertionServo.command`."""
    slope = (position - state[NEWEST]) / state[PERIOD]
    state[COMMAND] = state[NEWEST]
    state[COMMAND_SLOPE] = slope
    change = state[VELOCITY_GAIN] * (slope - state[COMMAND_VELOCITY])
    state[COMMAND_VELOCITY_SLOPE] = change / state[PERIOD]
    state[CLIPPED] = 0.0
    state[NEWEST] = position


@compiled("f8(f8[::1], f8, f8, f8, f8)")
def drive(state: NDArray[np.float64], position: float, velocity: float, contact_force: float, h: float) -> float:
    """Drive force for the next h seconds [N]: see `InsertionServo.effort`."""
    mass, ceiling = state[MASS], state[FORCE_LIMIT]
    stiffness, damping = SERVO_RATE * SERVO_RATE, 2.0 * SERVO_RATE
    restoring = stiffness * (state[REFERENCE] - position) + damping * (state[VELOCITY] - velocity)
    friction = state[DAMPING] * state[VELOCITY]
    effort = mass * (move_reference(state, h) + restoring) + friction + contact_force
    excess = contact_force - ceiling
    if excess > 0.0:  # what speed and the moving mass add: brake, and go back
        ceiling -= excess + damping * mass * max(velocity, 0.0)
    if effort > ceiling:
        effort = ceiling
        state[CLIPPED] = 1.0
        state[REFERENCE] = min(state[REFERENCE], position + max(0.0, -excess) / (mass * stiffness))
        state[VELOCITY] = min(state[VELOCITY], max(velocity, 0.0))
    return float(max(effort, -LARGEST_RETRACTION))


Array = NDArray[np.float64]

SERVO = slice(0, SERVO_SIZE)

DESIRED, SENSOR, TOOL, SHOWN, NOISE, SPEED = range(SERVO_SIZE, SERVO_SIZE + 6)
"""The newest command [m]; behind the low-pass, the force between carriage and tool, and what the tool makes of it [N];
what the force sensor shows, and what of that the drive takes for noise [N]; velocity before the physics step [m/s]."""

H, LOW_PASS, TOOL_MASS, GRAVITY, LOWEST, HIGHEST = range(SERVO_SIZE + 6, SERVO_SIZE + 12)
ENCODER_NOISE, RESOLUTION, OFFSET, SENSOR_NOISE, RANGE, ACCELEROMETER_NOISE = range(SERVO_SIZE + 12, SERVO_SIZE + 18)
BUILT = slice(H, ACCELEROMETER_NOISE + 1)
"""Constants: length of a physics step [s], fraction that the low-pass moves in it, then the arguments of `RcmArm`."""

SIZE = SERVO_SIZE + 18


@compiled("void(f8[::1], f8, f8)")
def begin(arm: Array, desired: float, velocity: float) -> None:
    """A sample period begins, with a command [m]; one that is not finite is left out."""
    if math.isfinite(desired):
        arm[DESIRED] = min(arm[HIGHEST], max(arm[LOWEST], desired))
    take(arm[SERVO], arm[DESIRED])
    arm[NOISE] = arm[SHOWN] - arm[SENSOR] - arm[OFFSET]  # the drive's own copy is tared at the start
    arm[SPEED] = velocity


@compiled("f8(f8[::1], f8, f8)")
def effort(arm: Array, position: float, velocity: float) -> float:
    """Drive force for the next physics step [N], net of gravity."""
    return drive(arm[SERVO], position, velocity, arm[SENSOR] + arm[NOISE] - arm[TOOL], arm[H])


@compiled("void(f8[::1], f8, f8)")
def sense(arm: Array, velocity: float, compression: float) -> None:
    """Update after a physics step what sensor and drive measure of the force between carriage and tool [N]."""
    arm[SENSOR] += arm[LOW_PASS] * (compression - arm[SENSOR])
    tool = arm[TOOL_MASS] * ((velocity - arm[SPEED]) / arm[H] - arm[GRAVITY])
    arm[TOOL] += arm[LOW_PASS] * (tool - arm[TOOL])  # the drive's own compensation, as late as the sensor
    arm[SPEED] = velocity


@compiled("Tuple((f8, f8, f8, f8, b1))(f8[::1], f8, f8, f8, f8)")
def show(
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

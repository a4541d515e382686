"""The simulated arms' drives and sensors around the physics steps of a sample period, compiled.

The arms are `foretouch.robot.rcm_arm` and `foretouch.robot.gantry_arm`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.robot.engine import GRAVITY, MOVED_MASS, RAIL_DAMPING, TOOL_MASS

Array = NDArray[np.float64]
States = NDArray[np.void]

VELOCITY_CUTOFF = 80.0  # of the command's velocity [Hz]: smooths samples that are late and then jump
REFERENCE_RATE = 400.0  # how fast the reference closes in on the command [rad/s]
LARGEST_VELOCITY = 0.5  # of the reference [m/s]
LARGEST_ACCELERATION = 30.0  # of the reference [m/s^2]; the joint could do 37 within 15 N
SERVO_RATE = 300.0  # bandwidth of the position loop [rad/s]
LARGEST_RETRACTION = 100.0  # drive force out of the material [N]


class Servo(Record):
    r"""Reference generator, computed-force control and force limit of one linear joint; it never presses beyond that.

    The command is a straight line through each sample period, from the sample before to the newest, so that a smooth
    path is reached at the end of the period in which it was commanded. The reference r follows it with

    .. math::
        \ddot r = 2 \omega (v_c - \dot r), \quad
        v_c = \hat v + \mathrm{sign}(e) \min\big(\omega |e| / 2,\; \sqrt{1.4 A |e|}\big)

    e being command less reference and v-hat the low-passed velocity of the command; velocity and acceleration A are
    limited, and the square root brakes in time, so that a step in the command becomes a quick, smooth move without
    overshoot. The drive force, net of gravity, is

    .. math:: u = M (\ddot r + \omega_s^2 (r - p) + 2 \omega_s (\dot r - \dot p)) + d \dot r + \hat F \le F_{limit}

    with the measured contact force F-hat fed forward. At rest u is the contact force: it can never stay above the
    limit. While F-hat is above it, the excess and 2 M omega_s p-dot are taken off u, so that what speed and the
    moving mass add passes quickly. Where the limit cuts, the reference is held back too, and does not run on inside
    the material.

    The loop is closed on the joint's own motion, as in a drive whose motor encoder is much finer than the encoder
    that the robot reports.
    """

    command: float  # [m]
    command_slope: float  # [m/s]
    command_velocity: float  # low-passed [m/s]
    command_velocity_slope: float  # [m/s^2]
    reference: float  # r, the command after all limits [m]
    velocity: float  # of the reference [m/s]
    clipped: bool  # whether the force limit has cut since the newest command
    newest: float  # the newest command [m]
    mass: float = MOVED_MASS  # M, that the joint moves [kg]
    damping: float = RAIL_DAMPING  # d of the rail [N s/m]
    force_limit: float  # [N]
    period: float  # of the commands [s]
    velocity_gain: float  # of the low-pass


def make_servo(force_limit: float, sample_period: float, position: float) -> Any:
    """A servo at rest at a position of the tip [m]."""
    gain = 1.0 - math.exp(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
    servo = Servo.new(force_limit=force_limit, period=sample_period, velocity_gain=gain)[0]
    servo.command = servo.reference = servo.newest = position
    return servo


@compiled
def move_reference(servo: Servo, h: float) -> float:
    """Move the reference and the command on by h seconds; gives the reference's acceleration [m/s^2]."""
    error = servo.command - servo.reference
    distance = abs(error)
    closing = min(0.5 * REFERENCE_RATE * distance, math.sqrt(1.4 * LARGEST_ACCELERATION * distance))
    wanted = servo.command_velocity + math.copysign(closing, error)
    wanted = max(-LARGEST_VELOCITY, min(LARGEST_VELOCITY, wanted))
    acceleration = 2.0 * REFERENCE_RATE * (wanted - servo.velocity)
    acceleration = max(-LARGEST_ACCELERATION, min(LARGEST_ACCELERATION, acceleration))
    servo.velocity += h * acceleration
    servo.reference += h * servo.velocity
    servo.command += h * servo.command_slope
    servo.command_velocity += h * servo.command_velocity_slope
    return float(acceleration)


@compiled
def take(servo: Servo, position: float) -> None:
    """Take the command of this sample period [m], finite."""
    slope = (position - servo.newest) / servo.period
    servo.command, servo.command_slope = servo.newest, slope
    change = servo.velocity_gain * (slope - servo.command_velocity)
    servo.command_velocity_slope = change / servo.period
    servo.clipped = False
    servo.newest = position


@compiled
def drive(servo: Servo, position: float, velocity: float, contact_force: float, h: float) -> float:
    """Drive force u for the next h seconds [N], net of gravity, at most the force limit.

    Args:
        servo: Written.
        position: Position of the joint [m].
        velocity: Velocity of the joint [m/s].
        contact_force: Measured, tool compensated [N].
        h: Length of the step [s].
    """
    mass, ceiling = servo.mass, servo.force_limit
    stiffness, damping = SERVO_RATE * SERVO_RATE, 2.0 * SERVO_RATE
    restoring = stiffness * (servo.reference - position) + damping * (servo.velocity - velocity)
    friction = servo.damping * servo.velocity
    effort = mass * (move_reference(servo, h) + restoring) + friction + contact_force
    excess = contact_force - ceiling
    if excess > 0.0:  # what speed and the moving mass add: brake, and go back
        ceiling -= excess + damping * mass * max(velocity, 0.0)
    if effort > ceiling:
        effort = ceiling
        servo.clipped = True
        servo.reference = min(servo.reference, position + max(0.0, -excess) / (mass * stiffness))
        servo.velocity = min(servo.velocity, max(velocity, 0.0))
    return float(max(effort, -LARGEST_RETRACTION))


class Arm(Record):
    """State of an `RcmArm` between physics steps, with its constants."""

    servo: Servo
    desired: float  # newest command [m]
    sensor: float  # force between carriage and tool, behind the low-pass [N]
    tool: float  # what the tool makes of that force [N]
    shown: float  # what the force sensor shows [N]
    noise: float  # what of that the drive takes for noise [N]
    speed: float  # before the physics step [m/s]
    h: float  # length of a physics step [s]
    low_pass: float  # fraction that the low-pass moves in it
    workspace: Annotated[Array, float, 2]  # [m]
    encoder_noise: float  # [m]
    resolution: float  # of the encoder [m]
    offset: float  # of the force sensor [N]
    sensor_noise: float  # [N]
    largest: float  # force that the sensor shows [N]
    accelerometer_noise: float  # [m/s^2]


@kernel("void(Arm[::1], f8, f8)")
def begin(arms: States, desired: float, velocity: float) -> None:
    """A sample period begins, with a command [m]; one that is not finite is left out."""
    arm = arms[0]
    if math.isfinite(desired):
        arm.desired = min(arm.workspace[1], max(arm.workspace[0], desired))
    take(arm.servo, arm.desired)
    arm.noise = arm.shown - arm.sensor - arm.offset  # the drive's own copy is tared at the start
    arm.speed = velocity


@kernel("f8(Arm[::1], f8, f8)")
def effort(arms: States, position: float, velocity: float) -> float:
    """Drive force for the next physics step [N], net of gravity."""
    arm = arms[0]
    return drive(arm.servo, position, velocity, arm.sensor + arm.noise - arm.tool, arm.h)


@kernel("void(Arm[::1], f8, f8)")
def sense(arms: States, velocity: float, compression: float) -> None:
    """Update after a physics step what sensor and drive measure of the force between carriage and tool [N]."""
    arm = arms[0]
    arm.sensor += arm.low_pass * (compression - arm.sensor)
    tool = TOOL_MASS * ((velocity - arm.speed) / arm.h - GRAVITY)
    arm.tool += arm.low_pass * (tool - arm.tool)  # the drive's own compensation, as late as the sensor
    arm.speed = velocity


@kernel("Tuple((f8, f8, f8, f8, b1))(Arm[::1], f8, f8, f8, f8)")
def show(
    arms: States, exact: float, encoder: float, sensor: float, accelerometer: float
) -> tuple[float, float, float, float, bool]:
    """What the sensors show at the end of a sample period, with a normal draw of noise for each.

    Returns:
        Position [m], sensor force [N], acceleration [m/s^2], the drive's own command after its limits [m], and whether
        the force limit cut it.
    """
    arm = arms[0]
    position = exact + arm.encoder_noise * encoder
    if arm.resolution > 0.0:
        position = round(position / arm.resolution) * arm.resolution
    felt = arm.sensor + arm.offset + arm.sensor_noise * sensor
    arm.shown = min(max(felt, -arm.largest), arm.largest)
    acceleration = arm.tool / TOOL_MASS + GRAVITY + arm.accelerometer_noise * accelerometer
    return float(position), float(arm.shown), float(acceleration), float(arm.servo.reference), bool(arm.servo.clipped)


DOWN = 2
WAYS = (1.0, 1.0, -1.0)  # Direction of each axis in which its servo counts: the third goes in as it goes down

Numbers3 = Annotated[Array, float, 3]


class Gantry(Record):
    """State of a `GantryArm` between physics steps, with its constants; three axes."""

    servos: Annotated[States, Servo, 3]
    sensor: Numbers3  # contact force behind the low-pass, as the compensated sensor shows it [N]
    tool: Numbers3  # what weight and inertia of the tool make of the force between carriage and tool [N]
    raw: Numbers3  # that force [N]
    speed: Numbers3  # before the physics step [m/s]
    h: float  # length of a physics step [s]
    low_pass: float  # fraction that the low-pass moves in it


@kernel("void(Gantry[::1], f8, f8, f8)")
def begin_gantry(gantries: States, x: float, y: float, z: float) -> None:
    """A sample period begins, with a command [m]."""
    for axis, position in enumerate((x, y, z)):
        take(gantries[0].servos[axis], WAYS[axis] * position)


@kernel("b1(Gantry[::1], f8[::1], f8[::1], f8[::1])")
def push_gantry(gantries: States, place: Array, velocity: Array, efforts: Array) -> bool:
    """Write the drive forces for the next physics step [N]; whether a force limit has cut in this sample period.

    A servo counts inwards, against the force that it meets; the third one moves in downwards.
    """
    gantry, clipped = gantries[0], False
    for axis in range(3):
        servo, way = gantry.servos[axis], WAYS[axis]
        inwards = drive(servo, way * place[axis], way * velocity[axis], -way * gantry.sensor[axis], gantry.h)
        efforts[axis] = way * max(inwards, -servo.force_limit) + (MOVED_MASS * GRAVITY if axis == DOWN else 0.0)
        gantry.speed[axis] = velocity[axis]
        clipped = clipped or servo.clipped
    return bool(clipped)


@kernel("void(Gantry[::1], f8[::1], f8[::1])")
def sense_gantry(gantries: States, velocity: Array, interaction: Array) -> None:
    """Update after a physics step what is measured of the force that the tool needs from the carriage [N]."""
    gantry = gantries[0]
    for axis in range(3):
        tool = TOOL_MASS * ((velocity[axis] - gantry.speed[axis]) / gantry.h + (GRAVITY if axis == DOWN else 0.0))
        gantry.tool[axis] += gantry.low_pass * (tool - gantry.tool[axis])
        gantry.raw[axis] += gantry.low_pass * (interaction[axis] - gantry.raw[axis])
        gantry.sensor[axis] = gantry.tool[axis] - gantry.raw[axis]

"""The way of an arm's tip from command to command: within its speed and acceleration, and back from too much force."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel, squared

Array = NDArray[np.float64]
States = NDArray[np.void]
Vector3 = Annotated[Array, float, 3]

RATE = 200.0  # How fast the reference closes in on the command [rad/s]
VELOCITY_CUTOFF = 40.0  # Of the command's velocity [Hz]: smooths samples that are late and then jump
BRAKING = 1.4  # Of the acceleration limit, under the root: the reference brakes with 70 % of what it may

YIELDING_RATE = 30.0
"""Rate at which a force comes back to its limit against something rigid [rad/s], which the slowest controller follows.
The stiffness that the arm itself shows at its tip says how fast it goes back for each newton."""

STILL_ALLOWED = 0.1  # Share of its speed that the tip keeps at a singular pose

FELT = 0.1  # Share of the force limit from which a force counts: what is less is no contact yet


class Reference(Record):
    r"""Where the tip is told to be, and where it was told to be in the end.

    The command is a straight line through each period of the arm, from the command before to the newest. The reference
    r follows it with

    .. math::
        \ddot r = 2 \omega (v_c - \dot r), \quad
        v_c = \hat v + \frac{e}{|e|} \min\big(\omega |e| / 2,\; \sqrt{1.4 A |e|}\big)

    e being command less reference and v-hat the low-passed velocity of the command. Speed and acceleration A are
    limited as vectors, so that a step becomes a straight way. Against a measured force F the reference goes on at most
    as fast as

    .. math:: -n \cdot v_c \le Y (F_{limit} - F)

    n being the direction of the force; above the limit it goes back. Across the force it goes no faster than `sliding`.
    While a link of the arm has met something, r is
    held, and goes only where the force at the tip that would push as that does leads it, Y metres a second for each
    newton.
    """

    newest: Vector3  # the newest command [m]
    command: Vector3  # on its way there [m]
    slope: Vector3  # of the command [m/s]
    velocity_command: Vector3  # low-passed [m/s]
    place: Vector3  # r [m]
    velocity: Vector3  # of the reference [m/s]
    low: Vector3  # lowest command [m]
    high: Vector3  # highest command [m]
    speed: float  # largest of the reference [m/s]
    acceleration: float  # largest of the reference [m/s^2]
    force_limit: float  # [N]
    yielding: float  # Y, `YIELDING_RATE` by the stiffness of the tip [m/s/N]
    period: float  # of the commands [s]
    sliding: float = math.inf  # largest speed across a force that is felt [m/s]
    share: float = 1.0  # of the speed that is allowed where the arm is, 0 to 1
    clipped: bool  # whether the force limit has cut since the newest command
    held: bool  # because a link has met something
    ahead: Vector3  # direction in which it went then
    push: Vector3  # force at the tip that would push as what was met does [N]


def make_reference(place: Any, reach: Any, **limits: float) -> States:
    """A reference at rest at a place [m], within a box [m]; limits are fields of `Reference`."""
    low, high = reach
    return Reference.new(newest=place, command=place, place=place, low=low, high=high, **limits)


@kernel("void(Reference[::1], f8, f8, f8)")
def take_command(references: States, x: float, y: float, z: float) -> None:
    """A period begins, with a command [m]; one that is not finite is left out, and one beyond the box brought to it."""
    reference, command = references[0], (x, y, z)
    known = math.isfinite(x) and math.isfinite(y) and math.isfinite(z)
    gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * reference.period)
    for axis in range(3):
        before = reference.newest[axis]
        wanted = command[axis] if known else before
        newest = min(max(wanted, reference.low[axis]), reference.high[axis])
        slope = (newest - before) / reference.period
        reference.command[axis], reference.slope[axis], reference.newest[axis] = before, slope, newest
        slope = min(max(slope, -reference.speed), reference.speed)
        reference.velocity_command[axis] += gain * (slope - reference.velocity_command[axis])
    reference.clipped = False


@compiled
def _limited(x: float, y: float, z: float, largest: float) -> tuple[float, float, float]:
    size = math.sqrt(x * x + y * y + z * z)
    share = largest / size if size > largest else 1.0
    return share * x, share * y, share * z


@compiled(allocates=True)
def allowed_share(jacobian: Array, well_away: float) -> float:
    """Share of its speed that the tip is allowed, which is less than 1 near a singular pose.

    Args:
        jacobian: Of the tip, shape (3, n) or more, of which the first three rows count.
        well_away: Its smallest singular value below which the share is less, in proportion [m/rad].
    """
    translational = np.ascontiguousarray(jacobian[:3])
    least = math.sqrt(max(np.linalg.eigvalsh(translational @ translational.T)[0], 0.0))
    return min(max(least / well_away, STILL_ALLOWED), 1.0)


@kernel("void(Reference[::1], f8[::1], f8[::1], f8)")
def move_reference(references: States, force: Array, acceleration: Array, h: float) -> None:
    """Move the reference and the command on by h seconds, and write the reference's acceleration [m/s^2].

    Args:
        references: One, written.
        force: On the probe as the arm knows it [N].
        acceleration: Written.
        h: Length of the step [s].
    """
    reference = references[0]
    e0 = reference.command[0] - reference.place[0]
    e1 = reference.command[1] - reference.place[1]
    e2 = reference.command[2] - reference.place[2]
    distance = math.sqrt(e0 * e0 + e1 * e1 + e2 * e2)
    largest = reference.acceleration
    closing = min(0.5 * RATE, math.sqrt(BRAKING * largest / max(distance, 1e-12)))  # times the error, which has a sign
    v0 = reference.velocity_command[0] + closing * e0
    v1 = reference.velocity_command[1] + closing * e1
    v2 = reference.velocity_command[2] + closing * e2
    size = math.sqrt(squared(force[0]) + squared(force[1]) + squared(force[2]))
    if size > FELT * reference.force_limit:
        n0, n1, n2 = force[0] / size, force[1] / size, force[2] / size
        more = reference.yielding * (size - reference.force_limit) - (v0 * n0 + v1 * n1 + v2 * n2)
        if more > 0.0:
            v0, v1, v2 = v0 + more * n0, v1 + more * n1, v2 + more * n2
            reference.clipped = True
        along = v0 * n0 + v1 * n1 + v2 * n2
        a0, a1, a2 = _limited(v0 - along * n0, v1 - along * n1, v2 - along * n2, reference.sliding)
        v0, v1, v2 = along * n0 + a0, along * n1 + a1, along * n2 + a2
    if reference.held:
        away = reference.yielding
        v0, v1, v2 = away * reference.push[0], away * reference.push[1], away * reference.push[2]
        reference.clipped = True
    v0, v1, v2 = _limited(v0, v1, v2, reference.share * reference.speed)
    gain = 2.0 * RATE
    a0, a1, a2 = _limited(
        gain * (v0 - reference.velocity[0]),
        gain * (v1 - reference.velocity[1]),
        gain * (v2 - reference.velocity[2]),
        largest,
    )
    acceleration[0], acceleration[1], acceleration[2] = a0, a1, a2
    for axis in range(3):
        reference.velocity[axis] += h * acceleration[axis]
        reference.place[axis] += h * reference.velocity[axis]
        reference.command[axis] += h * reference.slope[axis]

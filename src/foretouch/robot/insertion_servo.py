"""Position control of the arm's insertion joint: follows a path of samples, and never presses beyond its limit."""

from __future__ import annotations

import math

__all__ = ["InsertionServo"]

REFERENCE_RATE = 400.0  # how fast the reference closes in on the command [rad/s]
VELOCITY_CUTOFF = 80.0  # of the command's velocity [Hz]: smooths samples that are late and then jump
LARGEST_VELOCITY = 0.5  # of the reference [m/s]
LARGEST_ACCELERATION = 30.0  # of the reference [m/s^2]; the joint could do 37 within 15 N
SERVO_RATE = 300.0  # bandwidth of the position loop [rad/s]
LARGEST_RETRACTION = 100.0  # drive force out of the material [N]


class InsertionServo:
    r"""Reference generator, computed-force control and force limit of one linear joint.

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

    Args:
        mass: M, that the joint moves [kg].
        damping: d of the rail [N s/m].
        force_limit: [N].
        sample_period: Of the commands [s].
        position: Where the tip is [m].

    Attributes:
        reference: r, the command after all limits [m].
        velocity: Of the reference [m/s].
        clipped: Whether the force limit has cut since `command`.
    """

    __slots__ = (
        "_command",
        "_damping",
        "_force_limit",
        "_mass",
        "_newest",
        "_period",
        "_slope",
        "_velocity",
        "_velocity_gain",
        "_velocity_slope",
        "clipped",
        "reference",
        "velocity",
    )

    def __init__(
        self, *, mass: float, damping: float, force_limit: float, sample_period: float, position: float
    ) -> None:
        self._mass = mass
        self._damping = damping
        self._force_limit = force_limit
        self._period = sample_period
        self._velocity_gain = 1.0 - math.exp(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
        self._newest = self._command = self.reference = position
        self._slope = self._velocity = self._velocity_slope = self.velocity = 0.0
        self.clipped = False

    def command(self, position: float) -> None:
        """Take the command of this sample period [m], finite."""
        self._command = self._newest
        self._newest = position
        self._slope = (position - self._command) / self._period
        self._velocity_slope = self._velocity_gain * (self._slope - self._velocity) / self._period
        self.clipped = False

    def effort(self, position: float, velocity: float, contact_force: float, h: float) -> float:
        """Drive force u for the next h seconds [N], net of gravity, at most the force limit.

        Args:
            position: Of the joint [m].
            velocity: Of the joint [m/s].
            contact_force: Measured, tool compensated [N].
            h: Length of the step [s].
        """
        stiffness, damping = SERVO_RATE * SERVO_RATE, 2.0 * SERVO_RATE
        restoring = stiffness * (self.reference - position) + damping * (self.velocity - velocity)
        friction = self._damping * self.velocity
        effort = self._mass * (self._move_reference(h) + restoring) + friction + contact_force
        ceiling = self._force_limit
        excess = contact_force - ceiling
        if excess > 0.0:  # what speed and the moving mass add: brake, and go back
            ceiling -= excess + damping * self._mass * max(velocity, 0.0)
        if effort > ceiling:
            effort = ceiling
            self.clipped = True
            self.reference = min(self.reference, position + max(0.0, -excess) / (self._mass * stiffness))
            self.velocity = min(self.velocity, max(velocity, 0.0))
        return max(effort, -LARGEST_RETRACTION)

    def _move_reference(self, h: float) -> float:
        """Move the reference and the command on by h seconds; gives the reference's acceleration [m/s^2]."""
        error = self._command - self.reference
        distance = abs(error)
        closing = min(0.5 * REFERENCE_RATE * distance, math.sqrt(1.4 * LARGEST_ACCELERATION * distance))
        wanted = self._velocity + math.copysign(closing, error)
        wanted = max(-LARGEST_VELOCITY, min(LARGEST_VELOCITY, wanted))
        acceleration = 2.0 * REFERENCE_RATE * (wanted - self.velocity)
        acceleration = max(-LARGEST_ACCELERATION, min(LARGEST_ACCELERATION, acceleration))
        self.velocity += h * acceleration
        self.reference += h * self.velocity
        self._command += h * self._slope
        self._velocity += h * self._velocity_slope
        return acceleration

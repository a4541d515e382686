"""Position control of the arm's insertion joint: follows a path of samples, and never presses beyond its limit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

VELOCITY_CUTOFF = 80.0  # of the command's velocity [Hz]: smooths samples that are late and then jump


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
        sample_period: Period of the commands [s].
        position: Position of the tip [m].
        state: Array with its numbers, which the caller may hold too, shape
            (`foretouch.robot.servo_kernel.SERVO_SIZE`,); None for one of its own.
    """

    __slots__ = ("_kernel", "_state")

    def __init__(
        self,
        *,
        mass: float,
        damping: float,
        force_limit: float,
        sample_period: float,
        position: float,
        state: NDArray[np.float64] | None = None,
    ) -> None:
        from foretouch.robot import servo_kernel as kernel  # Numba is slow to import: only when used

        self._kernel = kernel
        self._state = np.empty(kernel.SERVO_SIZE) if state is None else state
        self._state[:] = 0.0
        self._state[[kernel.COMMAND, kernel.REFERENCE, kernel.NEWEST]] = position
        velocity_gain = 1.0 - math.exp(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
        self._state[kernel.RAIL] = mass, damping, force_limit, sample_period, velocity_gain

    @property
    def reference(self) -> float:
        """r, the command after all limits [m]."""
        return float(self._state[self._kernel.REFERENCE])

    @property
    def velocity(self) -> float:
        """Velocity of the reference [m/s]."""
        return float(self._state[self._kernel.VELOCITY])

    @property
    def clipped(self) -> bool:
        """Whether the force limit has cut since `command`."""
        return bool(self._state[self._kernel.CLIPPED])

    def command(self, position: float) -> None:
        """Take the command of this sample period [m], finite."""
        self._kernel.take(self._state, position)

    def effort(self, position: float, velocity: float, contact_force: float, h: float) -> float:
        """Drive force u for the next h seconds [N], net of gravity, at most the force limit.

        Args:
            position: Position of the joint [m].
            velocity: Velocity of the joint [m/s].
            contact_force: Measured, tool compensated [N].
            h: Length of the step [s].
        """
        return self._kernel.drive(self._state, position, velocity, contact_force, h)

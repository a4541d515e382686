"""The contact force by the current of an arm's motors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import kernel
from foretouch.robot.arms.body import FRICTION_KNOWN, FRICTION_SPEED, Body

Array = NDArray[np.float64]

CURRENT_STEP = 7e-3
"""Resolution of a torque by the current [N m]: a servo that shows it in steps of 6.5 mA, and gives about 1.1 N m
for an ampere."""

CURRENT_BANDWIDTH = 6.0
"""Cut-off of the two low-passes behind a current [Hz]: a servo with a coarse encoder pushes to and fro by a step of it
times its stiffness, 1.5 N m for 12 bits."""


@kernel("void(f8[:,:,::1], f8[::1], f8[::1], f8[::1], f8)")
def take_current(passes: Array, bias: Array, torques: Array, counted: Array, gain: float) -> None:
    """Move two low-passes behind each other by a physics step.

    Args:
        passes: Shape (2, 2, n), written: of each the torques of the weight less those of the motors [N m], and the
            positions of the joints [rad].
        bias: Torques of the arm's weight [N m], shape (n,).
        torques: Of the motors [N m].
        counted: Positions of the joints [rad].
        gain: Share of the way in a step.
    """
    for joint in range(bias.size):
        seen = bias[joint] - np.rint(torques[joint] / CURRENT_STEP) * CURRENT_STEP, counted[joint]
        for kind in range(2):
            passes[0, kind, joint] += gain * (seen[kind] - passes[0, kind, joint])
            passes[1, kind, joint] += gain * (passes[0, kind, joint] - passes[1, kind, joint])


class CurrentForce:
    r"""The force at the tip by what the motors push beyond the arm's own weight and motion, without a sensor.

    .. math:: \hat F = (J_t^T)^+ \left(M \ddot q + b \dot q + g(q) - \tau_m\right)

    with a part of the joints' Coulomb friction taken off; the rest of it is in the force. Torques and positions go
    through the same two low-passes, so that a force belongs to its place, and give velocities and accelerations too.

    Args:
        body: Whose motors they are.
        seed: Of no use: what is not known is friction, and the steps of the current.
    """

    noise, bandwidth, range = 0.05, CURRENT_BANDWIDTH, math.inf
    contact, beside_tip = None, False  # motors that hold a tip know no torque about it

    def __init__(self, body: Body, seed: int) -> None:
        limits = body.limits()
        self._body, self._damping, self._friction = body, limits["damping"], limits["friction"]
        self._rate = 2.0 * math.pi * CURRENT_BANDWIDTH
        self._gain = -math.expm1(-2.0 * math.pi * CURRENT_BANDWIDTH * float(body.model.opt.timestep))
        self.largest_offset = float(np.linalg.norm(np.abs(self._inverse()) @ limits["friction"]))
        self.contact_floor = 2.0 * self.largest_offset  # where a joint turns around
        first = np.stack([np.zeros(limits["damping"].size), body.counted])
        self._passes, self.force = np.stack([first, first]), np.zeros(3)
        (self._first, self._second), self._take = self._passes, take_current.entry

    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self._body.jacobian[:3].T), np.float64)

    def step(self) -> None:
        """See `Sensing.step`."""
        body = self._body
        self._take(self._passes, body.bias, body.data.actuator_force, body.counted, self._gain)

    def positions(self, counted: Array) -> Array:
        """See `Sensing.positions`."""
        return np.array(self._second[1])

    def read(self) -> Array:
        """See `Sensing.read`."""
        body, (once, twice) = self._body, (self._first[1], self._second[1])
        velocities, accelerations = self._rate * (once - twice), self._rate**2 * (body.counted - 2.0 * once + twice)
        moving = self._damping * velocities + FRICTION_KNOWN * self._friction * np.tanh(velocities / FRICTION_SPEED)
        self.force = self._inverse() @ (self._second[0] + moving + body.inertia @ accelerations)
        return self.force

"""An arm's own notice of what its links meet: a torque that nothing it knows of explains."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, kernel
from foretouch.robot.arms.body import FRICTION_KNOWN, FRICTION_SPEED, Body

Array = NDArray[np.float64]
States = NDArray[np.void]

TORQUE_SHARE = 0.04
"""Share of a joint's largest torque that may be unexplained beyond friction: quick steps in all directions, and against
a stiff floor, stay below it."""

STEP_SHARE = 0.15
"""Share of the torque that a servo gives for one step of its encoder that may be unexplained, too: it pushes to and fro
by that, and moves its rotor in the play of the gear, which the encoder does not show."""

BY_SENSOR, BY_CURRENT = 100.0, 20.0
"""How fast what disturbs the joints is known where a sensor tells the contact force, and where that is the motors'
current [rad/s]."""

GONE = 0.5  # Share of what may be unexplained below which nothing is met any more
GONE_FOR = 0.1  # Time for which it has to be so [s]
CREEPS = 1e-3  # Speed above which a reference goes on the way that it went [m/s]
BESIDE = 2e-3  # Distance from where something was met up to which a command leads neither on nor back [m]


class Watching(Record):
    """State of the notice."""

    rate: float  # K [1/s]
    h: float  # period of the controller [s]
    worst: float  # largest unexplained torque of a joint as a share of what is allowed
    gone: float  # time since it was last near that [s]
    met: bool  # whether a link has met something, and the arm holds


@kernel("void(Watching[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])", Watching, allocates=True)
def watch_links(
    watchings: States, joints: Array, known: Array, inertia: Array, explained: Array, contact: Array, push: Array
) -> None:
    r"""Take what the motors did in a period, and whether a link has met something.

    .. math::
        r \leftarrow r + K h \left(P (M (\dot q - \dot q^-) / h - \bar\tau + c + g + b \dot q
        + 0.7 f \tanh(\dot q / v) - J^T F) - r\right)

    is the observer of De Luca et al. (2006) of what disturbs the joints, less what is explained: the weight, the
    joints' damping and a known part of their Coulomb friction f, and the contact force F at the tip. What may be left
    of each is, through the same low-pass, :math:`|P| (f (1 - 0.7 |\tanh|) + 0.04\, \tau_{max} + 0.15\, k \epsilon)`,
    k being the stiffness of a servo and epsilon the step of its encoder. P is the identity where a sensor tells F.
    Where F is itself the motors' torque, P takes off what a force at the tip explains: a link that pushes just so is
    then felt as one, and the force limit holds it.

    Args:
        watchings: One, written.
        joints: Shape (6, n): velocities [rad/s], gravity and Coriolis torques and the motors' mean torques [N m] of the
            period; velocities before it, r, and what of it may be left, which are written.
        known: Shape (3, n): damping [N m s/rad], Coulomb friction, and what may be left beside it [N m].
        inertia: M [kg m^2], shape (n, n).
        explained: P, shape (n, n).
        contact: Torques that the tip's contact force explains, :math:`J^T F` [N m].
        push: What is unexplained beyond what may be, of each joint [N m], written.
    """
    own = watchings[0]
    velocity, bias, torque, before, left, allowed = joints[0], joints[1], joints[2], joints[3], joints[4], joints[5]
    count, gain = velocity.size, -math.expm1(-own.rate * own.h)
    gained = inertia @ ((velocity - before) / own.h)
    seen, may = np.empty(count), np.empty(count)
    for joint in range(count):
        damping, friction, margin = known[:, joint]
        turning = FRICTION_KNOWN * math.tanh(velocity[joint] / FRICTION_SPEED)
        seen[joint] = gained[joint] - torque[joint] + bias[joint] + damping * velocity[joint] - contact[joint]
        seen[joint] += friction * turning
        may[joint] = friction * (1.0 - abs(turning)) + margin
        before[joint] = velocity[joint]
    own.worst = 0.0
    for joint in range(count):
        unexplained = may_be = 0.0
        for other in range(count):
            share = explained[joint, other]
            unexplained += share * seen[other]
            may_be += abs(share) * may[other]
        left[joint] += gain * (unexplained - left[joint])
        allowed[joint] += gain * (may_be - allowed[joint])
        own.worst = max(own.worst, abs(left[joint]) / max(allowed[joint], 1e-12))
        beyond = max(abs(left[joint]) - GONE * allowed[joint], 0.0)
        push[joint] = beyond if left[joint] > 0.0 else -beyond
    own.gone = own.gone + own.h if own.worst < GONE else 0.0
    own.met = own.met or own.worst > 1.0


class LinkWatch:
    """The notice of an arm, which its control asks in each period.

    Args:
        body: Of the arm.
        h: Period of the controller [s].
    """

    def __init__(self, body: Body, h: float) -> None:
        limits, count = body.limits(), body.description.home.size
        self._body, self._watch = body, watch_links.entry
        self._by_current = body.description.force == "current"
        self.states = Watching.new(h=h, rate=BY_CURRENT if self._by_current else BY_SENSOR)
        step = body.description.stiffness * body.description.encoder
        margin = TORQUE_SHARE * limits["torque"] + STEP_SHARE * step
        self._known = np.ascontiguousarray([limits["damping"], limits["friction"], margin])
        self._joints, self._explained, self._contact = np.zeros((6, count)), np.eye(count), np.zeros(count)
        self._joints[5] = limits["friction"] + margin
        self._torque, self._steps = np.zeros(count), 0
        self._push, self._where = np.zeros(count), np.zeros(3)  # where the tip was told to be when something was met

    def add(self, torques: Array) -> None:
        """The motors' torques of a physics step [N m]."""
        self._torque += torques
        self._steps += 1

    def look(self, force: Array, beside_tip: bool) -> bool:
        """A period is over, with this contact force [N], at the tip or beside it; whether something was met."""
        body, joints, along = self._body, self._joints, self._body.jacobian[:3]
        if not self._steps:
            return False
        joints[0], joints[1], joints[2] = body.velocities, body.bias, self._torque / self._steps
        self._torque[:], self._steps = 0.0, 0
        if self._by_current:
            self._explained[:] = np.eye(self._contact.size) - along.T @ np.linalg.pinv(along.T)
        else:
            self._contact = along.T.dot(force)
        self._watch(self.states, joints, self._known, body.inertia, self._explained, self._contact, self._push)
        if beside_tip:
            self.states["met"], self.states["gone"] = True, 0.0
        return bool(self.states["met"][0])

    def hold(self, reference: States, force: Array, beside_tip: bool) -> None:
        """A period is over, with this contact force [N], at the tip or beside it: hold the reference, or let it go on.

        What is held may go back on the way that it went. It may go anywhere once nothing is unexplained any more and
        the command does not lead on that way.
        """
        own, before = reference[0], bool(self.states["met"][0])
        if not self.look(force, beside_tip):
            return
        if not before:
            way = own["velocity"]
            own["ahead"] = way / max(math.sqrt(float(way @ way)), 1e-9)
            self._where[:] = own["place"]
        own["push"] = np.linalg.pinv(self._body.jacobian[:3].T) @ self._push
        further = float((own["newest"] - self._where) @ own["ahead"])
        met = further > BESIDE or not float(self.states["gone"][0]) > GONE_FOR
        goes_on = float(own["velocity"] @ own["ahead"]) > CREEPS
        own["held"] = met and (further > -BESIDE if own["held"] or not before else goes_on)
        self.states["met"] = met

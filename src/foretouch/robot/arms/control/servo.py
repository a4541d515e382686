"""A position servo at each joint of an arm, led by inverse kinematics."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import kernel, squared
from foretouch.robot.arms.body import Body
from foretouch.robot.arms.control.links import LinkWatch
from foretouch.robot.arms.control.reference import allowed_share, move_reference, take_command
from foretouch.robot.arms.kinematics import InverseKinematics
from foretouch.robot.robot import Vector

Array = NDArray[np.float64]

TORQUE_MARGIN = 0.9  # Share of a joint's largest torque that its controller asks for

SUDDEN = 0.4
"""Share of the force limit with which joints push whose force is known late, by their current: what is pushed suddenly,
as when a rotor has gone through its play, is felt twice as much for a moment, and a fifth is left for the damping."""

WINDS_UP = 0.02  # Distance by which the reference may be ahead of what the joints can follow [m]

CARRIED = 0.3
"""Share of the force limit up to which inertia is fed forward along the force, the less the nearer it is: beyond, what
yields would swing against something rigid."""

REMEMBERED = 0.1
"""Time with which a force fades that inertia is fed forward by [s]: what is not given to leave a contact is not to be
taken back just after it, or the arm would be thrown against what it left."""

WELL_AWAY = 0.1  # Smallest singular value of the tip's Jacobian below which it slows down [m/rad]


@kernel("f8(f8[:,::1])", allocates=True)
def share_of_speed(jacobian: Array) -> float:
    """Share of its speed that the tip is allowed with the Jacobian of its place, shape (3, n)."""
    return allowed_share(jacobian, WELL_AWAY)


@kernel("void(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8, f8[::1])", allocates=True)
def carry(inertia: Array, jacobian: Array, acceleration: Array, felt: Array, limit: float, torque: Array) -> None:
    r"""Write the torques that give the joints their acceleration [N m], which the servos would else be late by.

    .. math:: \tau = M \ddot q_d - w\, J^T \Lambda\, n n^T J \ddot q_d, \quad \Lambda = (J M^{-1} J^T)^{-1}

    n being the direction of the force that is remembered at the tip, and w its share of what `CARRIED` leaves of the
    limit, 1 at most. Late joint by joint, a quick step across would turn into a push.

    Args:
        inertia: M, shape (n, n) [kg m^2].
        jacobian: J of the tip's place, shape (3, n) [m].
        acceleration: Commanded, shape (n,) [rad/s^2].
        felt: At the tip, remembered, shape (3,) [N].
        limit: Of the force [N].
        torque: Written, shape (n,).
    """
    torque[:] = inertia @ acceleration
    size = math.sqrt(felt @ felt)
    if size > 0.0:
        share = min(size / (CARRIED * limit), 1.0)
        along = share * (felt @ (jacobian @ acceleration)) / squared(size) * felt
        shown = jacobian @ np.linalg.solve(inertia, np.ascontiguousarray(jacobian.T))
        for axis in range(3):
            shown[axis, axis] += 1e-6  # at a singular pose, where a direction weighs endlessly
        torque -= np.linalg.solve(shown, along) @ jacobian


@kernel("void(f8[:,::1], f8[:,::1], f8[:,::1], f8, b1, f8)")
def serve(joints: Array, limits: Array, pushed: Array, most: float, compensates: bool, h: float) -> None:
    r"""Write the torques with which the joints' servos hold their positions [N m], and let these go on.

    .. math:: \tau = s\,[k (e + k_i \int e) + b \dot q_d] + b_m (\dot q_d - \dot q) + g, \quad e = q_d - q

    g being the arm's weight and what `carry` gives, b the damping of the joint itself, which the servo knows; q as its
    encoder shows it. A servo that does not know the arm's weight has g in the brackets, too, with a minus. The share s
    leaves of them what presses with the largest force at the tip, at once, for a measured force is late. The integral
    stands still where s or the largest torque cuts.

    Args:
        joints: Shape (7, n): positions as measured [rad], velocities [rad/s], g [N m], commanded positions [rad], which
            are written, and velocities [rad/s]; the torques [N m] and the integrals [rad s], which are written.
        limits: Shape (5, n): k [N m/rad], k_i [1/s], b_m [N m s/rad], b [N m s/rad], and the largest torque [N m].
        pushed: Force at the tip by torques, shape (3, n) [1/m].
        most: Its largest [N].
        compensates: Whether the servo knows the weight.
        h: Until the next call [s].
    """
    count, size = joints.shape[1], 0.0
    for joint in range(count):
        error = joints[3, joint] - joints[0, joint] + limits[1, joint] * joints[6, joint]
        joints[5, joint] = limits[0, joint] * error + limits[3, joint] * joints[4, joint]
        joints[5, joint] -= 0.0 if compensates else joints[2, joint]
    for axis in range(3):
        force = 0.0
        for joint in range(count):
            force += pushed[axis, joint] * joints[5, joint]
        size += force * force
    share = min(most / max(math.sqrt(size), 1e-12), 1.0)
    for joint in range(count):
        torque = share * joints[5, joint] + joints[2, joint]
        torque += limits[2, joint] * (joints[4, joint] - joints[1, joint])
        if share == 1.0 and abs(torque) < limits[4, joint]:
            joints[6, joint] += h * (joints[3, joint] - joints[0, joint])
        joints[5, joint] = min(max(torque, -limits[4, joint]), limits[4, joint])
        joints[3, joint] += h * joints[4, joint]


class ServoControl:
    """A position servo at each joint, led by inverse kinematics.

    Args:
        body: That is driven.
        reference: Way of the tip, written.
        tick: The reference is moved in steps of this length [s].

    Attributes:
        commanded: Speeds of the joints [rad/s], shape (n,).
        links: Notices what the links meet.
    """

    def __init__(self, body: Body, reference: NDArray[np.void], tick: float = 1e-3) -> None:
        description, own = body.description, body.limits()
        self._body, self.reference = body, reference
        self._take, self._move, self._serve = take_command.entry, move_reference.entry, serve.entry
        self._carry = carry.entry
        self._share = share_of_speed.entry
        period = 1.0 / description.rate
        self._tick, self._ticks = tick, range(round(period / tick))
        self._inverse = InverseKinematics(description, period)
        self._inverse.begin(body.positions)
        self._knows_weight = description.force == "wrist"
        most, integral = TORQUE_MARGIN * own["torque"], np.full_like(own["torque"], description.integral)
        limits = description.stiffness, integral, description.damping, own["damping"], most
        self._limits = np.ascontiguousarray(np.array(limits))
        self._joints = np.zeros((7, description.home.size))
        self._joints[3] = body.positions
        self.links, self.commanded = LinkWatch(body, period), self._joints[4]
        self._limit, self._rate = float(reference["force_limit"][0]), description.rate
        self._felt, self._fades = np.zeros(3), math.exp(-period / REMEMBERED)
        self._most = SUDDEN * self._limit if description.force == "current" else math.inf
        self._force, self._acceleration = np.zeros(9), np.zeros(9)
        self._pushed, self._carried = np.zeros((3, description.home.size)), np.zeros(description.home.size)
        self._step = float(body.model.opt.timestep)

    @staticmethod
    def stiffness_along(body: Body, direction: Array) -> float:
        r"""Stiffness that the tip shows along a unit direction u [N/m], :math:`1 / (u^T J K^{-1} J^T u)`."""
        row = direction @ body.jacobian[:3]
        return 1.0 / float(row @ (row / body.description.stiffness))

    def begin(self, place: Vector, force: Array, beside_tip: bool) -> None:
        """See `Control.begin`."""
        reference, inverse = self.reference, self._inverse
        self.links.hold(reference, force, beside_tip)
        self._take(reference, *place)
        self._force[:3] = force
        for _ in self._ticks:
            self._move(reference, self._force, self._acceleration, self._tick)
        self._joints[3] = inverse.positions  # where the period before was to end
        inverse.follow(reference["place"][0])
        if self._knows_weight:
            acceleration, body = self._rate * (inverse.velocities - self._joints[4]), self._body
            self._felt *= self._fades
            if force @ force > self._felt @ self._felt:
                self._felt[:] = force
            self._carry(body.inertia, body.jacobian[:3], acceleration, self._felt, self._limit, self._carried)
        self._joints[4] = inverse.velocities
        behind = reference["place"][0] - inverse.place
        distance = math.sqrt(float(behind @ behind))
        if distance > WINDS_UP:  # a limit of the joints holds it: the reference waits
            reference["place"][0] -= (1.0 - WINDS_UP / distance) * behind
        if self._most < math.inf:
            self._pushed[:] = np.linalg.pinv(self._body.jacobian[:3].T)
        reference["share"] = self._share(inverse.jacobian())

    def turn(self, rotation: Array) -> None:
        """See `Control.turn`."""
        self._inverse.turn(rotation)

    def torques(self) -> Array:
        """See `Control.torques`."""
        body, joints = self._body, self._joints
        joints[0], joints[1], joints[2] = body.counted, body.velocities, body.bias + self._carried
        self._serve(joints, self._limits, self._pushed, self._most, self._knows_weight, self._step)
        torques: Array = joints[5]
        self.links.add(torques)
        return torques

"""Cartesian impedance of an arm through its joint torques."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel, squared
from foretouch.robot.arms.body import Body
from foretouch.robot.arms.control.links import LinkWatch
from foretouch.robot.arms.control.reference import Reference, allowed_share, move_reference, take_command
from foretouch.robot.robot import Vector

Array = NDArray[np.float64]
States = NDArray[np.void]

WELL_AWAY = 0.15  # Smallest singular value of the tip's Jacobian below which it slows down [m/rad]

TORQUE_MARGIN = 0.9  # Share of a joint's largest torque that its controller asks for

LIMIT_ZONE, LIMIT_STIFFNESS = 0.1, 300.0
"""A joint that comes closer to its limit than this [rad] is pushed back by so much [N m/rad]."""

SPEED_ZONE = 0.8  # Share of a joint's speed limit above which what drives it on fades
TURNING = 10.0  # Largest torque about the tip that holds the tool's orientation [N m]


class Impedance(Record):
    r"""Constants of the impedance, from Khatib (1987) and Ott (2008), section 3.2.

    .. math::
        \tau = J^T F + c(q, \dot q) + g(q) + (1 - J^T \bar J^T)\, \tau_0 + \tau_f, \quad
        F = \Lambda \ddot r + K (r - x) + 2 \zeta \sqrt{K \lambda}\, (\dot r - \dot x) - \hat F

    r being the reference, x the tip, :math:`\Lambda = (J M^{-1} J^T)^{-1}` the inertia that the tip shows, lambda the
    mean of its diagonal, and F-hat the measured contact force: fed forward, it leaves to the stiffness only what the
    joints' friction does. What of F is not for acceleration is at most the force limit; what of the acceleration goes
    against F-hat counts the less, the nearer that is to the limit. tau_0 draws the elbow to where it began; tau_f is a
    share of the joints' Coulomb friction in the direction in which the reference moves them. Where torques would change
    faster than they may, all go the same share of their way.
    """

    stiffness: float = 3000.0  # K, of the tip's place: the largest that Franka's own impedance takes [N/m]
    turning_stiffness: float = 150.0  # of the tool's orientation [N m/rad]
    damping_ratio: float = 0.9  # zeta
    elbow_stiffness: float = 15.0  # of the posture, where it moves no tip [N m/rad]
    observer_rate: float = 80.0  # how fast what disturbs the joints is known [rad/s]
    torque_step: float = math.inf  # largest change of a torque in a period [N m]
    h: float  # period of the controller [s]


@compiled(allocates=True)
def _turned_back(rotation: Array, target: Array) -> Array:
    """Rotation that is left to the target, as a vector in the world's frame, half the sum of the axes' products."""
    error = np.zeros(3)
    for axis in range(3):
        a0, a1, a2 = rotation[axis], rotation[3 + axis], rotation[6 + axis]
        b0, b1, b2 = target[axis], target[3 + axis], target[6 + axis]
        error[0] += 0.5 * (a1 * b2 - a2 * b1)
        error[1] += 0.5 * (a2 * b0 - a0 * b2)
        error[2] += 0.5 * (a0 * b1 - a1 * b0)
    return error


@compiled
def _shortened(vector: Array, largest: float) -> bool:
    size = math.sqrt(squared(vector[0]) + squared(vector[1]) + squared(vector[2]))
    if size > largest:
        vector *= largest / size
        return True
    return False


@compiled(allocates=True)
def _observed(own: Impedance, inertia: Array, joints: Array) -> Any:
    r"""What disturbs the joints beside their motors and the arm's weight [N m], shape (n,), a row of `joints`.

    .. math:: r \leftarrow r + K h \left(M (\dot q - \dot q^-) / h - \tau^- + c + g - r\right)

    the observer of De Luca et al. (2006), of a momentum whose inertia changes little in a period.
    """
    velocity, bias, torque, disturbed, before = joints[1], joints[2], joints[4], joints[5], joints[6]
    gained = inertia @ (velocity - before)
    for joint in range(velocity.size):
        seen = gained[joint] / own.h - torque[joint] + bias[joint]
        disturbed[joint] += own.observer_rate * own.h * (seen - disturbed[joint])
        before[joint] = velocity[joint]
    return disturbed


@kernel(
    "b1(Impedance[::1], Reference[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])",
    Impedance,
    Reference,
    allocates=True,
)
def push(
    impedances: States, references: States, jacobian: Array, inertia: Array, joints: Array, limits: Array, tip: Array
) -> bool:
    """Write the motors' torques for the next period [N m]; whether the force limit has cut.

    Args:
        impedances: One.
        references: One; its share of speed is written.
        jacobian: Of the tip's place, and below it of its orientation, shape (6, n).
        inertia: M of the joints, shape (n, n) [kg m^2].
        joints: Shape (7, n): positions [rad], velocities [rad/s], gravity and Coriolis torques [N m], the posture that
            is held [rad]; the motors' torques, what disturbs the joints, and the velocities before, which
            are written [N m].
        limits: Shape (5, n): lowest and highest position [rad], largest speed [rad/s], largest torque [N m], and
            Coulomb friction [N m].
        tip: Shape (5, 9), of which the first numbers count: place [m], contact force [N], acceleration of the reference
            [m/s^2], orientation and the one that is held (matrices, row by row).
    """
    own, reference = impedances[0], references[0]
    position, velocity, bias, posture, torque = joints[0], joints[1], joints[2], joints[3], joints[4]
    count = position.size
    inverse = np.linalg.inv(inertia)
    spread = inverse @ jacobian.T
    seen = jacobian @ spread
    for axis in range(6):
        seen[axis, axis] += 1e-6  # at a singular pose, where a direction weighs endlessly
    task = np.linalg.inv(seen)

    moved = jacobian @ velocity
    wrench, held = np.zeros(6), np.zeros(3)
    damping = 2.0 * own.damping_ratio * math.sqrt(own.stiffness * (task[0, 0] + task[1, 1] + task[2, 2]) / 3.0)
    for axis in range(3):
        held[axis] = own.stiffness * (reference.place[axis] - tip[0, axis]) - tip[1, axis]
        held[axis] += damping * (reference.velocity[axis] - moved[axis])
    clipped = _shortened(held, reference.force_limit)
    turning = own.turning_stiffness * _turned_back(tip[3], tip[4])
    turning_damping = task[3, 3] + task[4, 4] + task[5, 5]
    turning -= 2.0 * own.damping_ratio * math.sqrt(own.turning_stiffness * turning_damping / 3.0) * moved[3:]
    _shortened(turning, TURNING)
    force, ahead = tip[1, :3], tip[2, :3].copy()
    against, size = ahead @ force, math.sqrt(force @ force)
    if against < 0.0:  # the nearer to the limit, the less presses on for the arm's inertia: it would swing there
        ahead -= min(size / reference.force_limit, 1.0) * against / squared(size) * force
    driven = np.ascontiguousarray(task[:, :3]) @ ahead  # with the torque that keeps the tool from turning then
    wrench[:3], wrench[3:] = held + driven[:3], turning + driven[3:]

    drawn = np.empty(count)
    for joint in range(count):
        pull = own.elbow_stiffness * (posture[joint] - position[joint])
        drawn[joint] = pull - 2.0 * math.sqrt(own.elbow_stiffness * inertia[joint, joint]) * velocity[joint]
    disturbed = _observed(own, inertia, joints)
    felt = np.ascontiguousarray(jacobian[:3]).T @ tip[1, :3]
    active = jacobian.T @ (wrench - task @ (spread.T @ drawn)) + drawn
    change, share = np.empty(count), 1.0
    for joint in range(count):
        low, high, fastest, strongest, friction = limits[:, joint]
        push = active[joint] - min(max(disturbed[joint] - felt[joint], -friction), friction)
        near = min(position[joint] - low - LIMIT_ZONE, 0.0) - min(high - position[joint] - LIMIT_ZONE, 0.0)
        push -= LIMIT_STIFFNESS * near
        if push * velocity[joint] > 0.0:
            push *= min(max((fastest - abs(velocity[joint])) / ((1.0 - SPEED_ZONE) * fastest), 0.0), 1.0)
        change[joint] = min(max(push + bias[joint], -strongest), strongest) - torque[joint]
        share = min(share, own.torque_step / max(abs(change[joint]), 1e-12))
    torque += share * change  # as one: a joint that were later than others would turn a quick step across into a push

    reference.share = allowed_share(jacobian, WELL_AWAY)
    reference.clipped = reference.clipped or clipped
    return bool(reference.clipped)


class ImpedanceControl:
    """Cartesian impedance through joint torques; see `Impedance`.

    Args:
        body: That is driven.
        reference: Way of the tip, written.

    Attributes:
        commanded: The motors' torques [N m], shape (n,).
        links: Notices what the links meet.
    """

    def __init__(self, body: Body, reference: NDArray[np.void]) -> None:
        description, own = body.description, body.limits()
        self._body, self.reference = body, reference
        self._take, self._move, self._push = take_command.entry, move_reference.entry, push.entry
        self._h = 1.0 / description.rate
        self._own = Impedance.new(h=self._h, torque_step=description.torque_rate * self._h)
        names = ("low", "high", "speed", "torque", "friction")
        own |= {"speed": description.joint_speed, "torque": TORQUE_MARGIN * own["torque"]}
        self._limits = np.ascontiguousarray(np.array([own[name] for name in names]))
        self._joints = np.zeros((7, description.home.size))
        self._joints[3], self._joints[4] = body.positions, body.bias
        self.links, self.commanded = LinkWatch(body, self._h), self._joints[4]
        self._tip = np.zeros((5, 9))
        self._tip[4] = body.rotation
        self._home = body.rotation.reshape(3, 3).copy()

    @staticmethod
    def stiffness_along(body: Body, direction: Array) -> float:
        """Stiffness that the tip shows along a unit direction [N/m]."""
        return float(Impedance.new()["stiffness"][0])

    def begin(self, place: Vector, force: Array, beside_tip: bool) -> None:
        """See `Control.begin`."""
        body, joints, tip = self._body, self._joints, self._tip
        self.links.hold(self.reference, force, beside_tip)
        self._take(self.reference, *place)
        tip[1, :3] = force
        self._move(self.reference, tip[1], tip[2], self._h)
        joints[0], joints[1], joints[2] = body.positions, body.velocities, body.bias
        tip[0, :3], tip[3] = body.place, body.rotation
        self._push(self._own, self.reference, body.jacobian, body.inertia, joints, self._limits, tip)

    def turn(self, rotation: Array) -> None:
        """See `Control.turn`."""
        self._tip[4] = (rotation @ self._home).ravel()

    def torques(self) -> Array:
        """See `Control.torques`."""
        torques: Array = self._joints[4]
        self.links.add(torques)
        return torques

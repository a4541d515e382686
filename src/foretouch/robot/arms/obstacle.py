"""Something that stands in the way of an arm's links: a ball that gives way, met by the capsules of its description."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.robot.arms.body import Body
from foretouch.robot.engine import load_mujoco
from foretouch.robot.robot import Vector

Array = NDArray[np.float64]


class Obstacle:
    r"""A ball that a simulated arm's links can meet.

    Where it overlaps one of their capsules by a depth x, it pushes that link away, along the line from its middle to
    the nearest point of the capsule's axis, with :math:`F = \max(k x + b \dot x, 0)`. The probe it does not meet: that
    touches the scene.

    Args:
        place: Of its middle, in the scene [m].
        radius: Its own [m].
        stiffness: k [N/m].
        damping: b [N s/m].

    Attributes:
        force: Its newest force on each of the capsules that it can meet [N].

    Raises:
        SettingError: A number out of range.
    """

    def __init__(self, place: Vector, radius: float, stiffness: float, damping: float = 0.0) -> None:
        require("radius", radius, above=0.0)
        require("stiffness", stiffness, above=0.0)
        require("damping", damping, at_least=0.0)
        self.place, self.radius, self.stiffness, self.damping = place, radius, stiffness, damping
        self.force = np.zeros(0)

    def join(self, arm: Body) -> None:
        """Stand beside an arm."""
        model, data = arm.model, arm.data
        capsule = load_mujoco().mjtGeom.mjGEOM_CAPSULE
        tool, still = model.body("tool").id, model.body("base").id
        bodies = model.geom_bodyid
        met = np.flatnonzero((model.geom_type == capsule) & (bodies != tool) & (bodies != still))
        self._data, self._met, self._bodies = data, met, bodies[met]
        self._radii, self._halves = model.geom_size[met, 0] + self.radius, model.geom_size[met, 1]
        self._origin, self.force = arm.origin, np.zeros(met.size)
        self.move(self.place)

    def move(self, place: Vector) -> None:
        """Stand elsewhere from now on, with its middle there [m]."""
        self.place, self._middle = place, self._origin + np.asarray(place)
        self._before = self._overlap()[0]

    def _overlap(self) -> tuple[Array, Array, Array]:
        """Depths in the capsules [m], directions from the middle to their nearest points, and these points [m]."""
        data, met = self._data, self._met
        axes = data.geom_xmat[met].reshape(-1, 3, 3)[:, :, 2]
        along = np.einsum("ij,ij->i", self._middle - data.geom_xpos[met], axes)
        nearest = data.geom_xpos[met] + np.clip(along, -self._halves, self._halves)[:, None] * axes
        away = nearest - self._middle
        distance = np.maximum(np.sqrt(np.einsum("ij,ij->i", away, away)), 1e-9)
        return self._radii - distance, away / distance[:, None], nearest

    def push(self, h: float) -> None:
        """Push the links for a physics step of h seconds, beside what pushes the tool."""
        depth, away, nearest = self._overlap()
        rate, self._before = (depth - self._before) / h, depth
        self.force = np.where(depth > 0.0, np.maximum(self.stiffness * depth + self.damping * rate, 0.0), 0.0)
        applied = self._data.xfrc_applied
        applied[self._bodies] = 0.0
        for number in np.flatnonzero(self.force):
            body = self._bodies[number]
            force = self.force[number] * away[number]
            applied[body, :3] += force
            applied[body, 3:] += np.cross(nearest[number] - self._data.xipos[body], force)

    def places(self) -> Array:
        """Middles of the capsules that it can meet, in the scene [m], shape (count, 3)."""
        places: Array = self._data.geom_xpos[self._met] - self._origin
        return places

    @property
    def clear(self) -> bool:
        """Whether it meets no capsule where the arm is."""
        return bool((self._overlap()[0] < 0.0).all())

    def distances(self) -> Array:
        """Distances between its middle and the axes of the capsules at which they touch [m], shape (count,)."""
        distances: Array = self._radii
        return distances

    def mass(self, body: Body, number: int) -> float:
        r"""Mass that the arm shows to it where a capsule is nearest [kg], :math:`1 / (n^T J M^{-1} J^T n)`.

        What play its gears have is taken as closed: the rotors move with the links.
        """
        mujoco, (_, away, nearest) = load_mujoco(), self._overlap()
        jacobian = np.zeros((3, body.model.nv))
        mujoco.mj_jac(body.model, self._data, jacobian, None, nearest[number], self._bodies[number])
        row = away[number] @ jacobian[:, body.joints]
        shown = float(row @ np.linalg.solve(body.inertia, row))
        return 1.0 / shown if shown > 0.0 else math.inf

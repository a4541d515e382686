"""What tells of the fixture's pose: an image of its board, a touch of its surface, and a probe that slides over it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from foretouch.errors import SettingError
from foretouch.quantities.pose import Array, Pose, cross_matrix

LEAST_ACROSS = 0.1  # Least sine of the angle between force and motion of a probe that slides

LEAST_STEP = 1e-3
"""Least distance over which a normal's turning is looked at [m]: the triangles of a mesh are flat for less."""


@dataclass(frozen=True, slots=True)
class ImageSeen:
    """The fixture's pose as one image gives it.

    Attributes:
        time: Time of the exposure [s].
        pose: Pose of the fixture in the world.
        covariance: Covariance of its error on the right, (6, 6).
    """

    time: float
    pose: Pose
    covariance: Array


@dataclass(frozen=True, slots=True)
class ContactSeen:
    """A point of the surface that the probe has just touched.

    Attributes:
        time: Time of the first contact [s].
        point: Point of the surface, in the world [m].
        deviation: Standard deviation along the normal [m].
    """

    time: float
    point: tuple[float, float, float]
    deviation: float


@dataclass(frozen=True, slots=True)
class SlideSeen:
    """The direction of the force on a probe that slides over the surface.

    Attributes:
        time: [s].
        point: Position of the probe, in the world [m].
        force: Direction of the force on it, in the world, of length 1.
        motion: Direction of its motion, the same, and not along the force.
        deviation: Standard deviation of the force's direction [rad].
    """

    time: float
    point: tuple[float, float, float]
    force: tuple[float, float, float]
    motion: tuple[float, float, float]
    deviation: float

    def normal(self, friction: float) -> tuple[Array, Array]:
        r"""Outward normal of the surface in the world, by a coefficient of friction, and its derivative by that.

        The force is :math:`N (n - \mu t)`, where t is the direction of the motion along the surface. With the part d of
        the motion across the force, of length 1,

        .. math:: n = \frac{f + \mu d}{\sqrt{1 + \mu^2}}, \qquad
            \frac{\partial n}{\partial \mu} = \frac{d - \mu f}{(1 + \mu^2)^{3/2}}
        """
        force, motion = np.asarray(self.force), np.asarray(self.motion)
        across = motion - (motion @ force) * force
        across /= np.linalg.norm(across)
        size = math.hypot(1.0, friction)
        return (force + friction * across) / size, (across - friction * force) / size**3


Seen: TypeAlias = ImageSeen | ContactSeen | SlideSeen


def is_finite(seen: Seen) -> bool:
    """Whether all of it is finite, and its covariance is one."""
    if not math.isfinite(seen.time):
        return False
    if isinstance(seen, SlideSeen):
        whole = np.array([seen.point, seen.force, seen.motion])
        across = np.linalg.norm(np.cross(whole[1], whole[2]))
        return bool(np.isfinite(whole).all() and across > LEAST_ACROSS and 0.0 < seen.deviation < math.inf)
    if isinstance(seen, ContactSeen):
        return len(seen.point) == 3 and all(map(math.isfinite, seen.point)) and 0.0 < seen.deviation < math.inf
    covariance = seen.covariance
    if covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        return False
    return bool(np.abs(covariance - covariance.T).max() < 1e-9 and np.linalg.eigvalsh(covariance)[0] > 0.0)


class TouchedSurface(Protocol):
    """What the filter has to know of the surface that is touched, in the fixture's own frame."""

    def height(self, point: Array) -> tuple[float, Array]:
        """Height of a point above the surface [m], negative inside, and the outward normal there, (3,)."""

    @property
    def relief(self) -> float:
        """Range of heights of the surface along its mean normal [m]; 0 for a flat one."""

    def holds(self, point: Array) -> bool:
        """Whether a touch there can be one of this surface."""


@dataclass(frozen=True, slots=True)
class Fixture:
    """A flat surface that is touched, in the fixture's own frame.

    Attributes:
        normal: Outward, of length 1.
        offset: Offset of the surface from the origin along the normal [m].
        radius: Contacts farther from the origin, along the surface, are no contacts of it [m].
    """

    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    offset: float = 0.0
    radius: float = 0.1

    def __post_init__(self) -> None:
        if not abs(math.hypot(*self.normal) - 1.0) < 1e-6:
            raise SettingError("normal", self.normal, "must have length 1")
        if not (math.isfinite(self.offset) and 0.0 < self.radius < math.inf):
            raise SettingError("radius", self.radius, "must be finite and above 0, and the offset finite")

    def height(self, point: Array) -> tuple[float, Array]:
        """See `TouchedSurface`: n . q - offset, and n."""
        normal = np.asarray(self.normal)
        return float(normal @ point) - self.offset, normal

    @property
    def relief(self) -> float:
        """See `TouchedSurface`: none."""
        return 0.0

    def holds(self, point: Array) -> bool:
        """See `TouchedSurface`: within the radius, along the surface."""
        normal = np.asarray(self.normal)
        return float(np.linalg.norm(point - (normal @ point) * normal)) <= self.radius


def height_derivative(normal: Array, point: Array) -> Array:
    """Derivative of the height of a point q [m] by the pose's error on the right, (-n, n x q), (6,); n is outward."""
    return np.concatenate([-normal, cross_matrix(normal) @ point])


def bend(surface: TouchedSurface, point: Array, covariance: Array) -> float:
    r"""Variance of a point's height that its derivative does not tell, for the surface is not flat [m^2].

    .. math:: \frac{1}{18} \sum_i \left(h(q + \sqrt 3\, s_i) + h(q - \sqrt 3\, s_i) - 2 h(q)\right)^2

    over the principal axes s_i of where q is in the fixture's frame, from the pose's covariance; each bracket is no
    more than the surface's relief. Without it touches of a curved surface whose place along itself is not known would
    seem to tell that place, and be believed. The point q is in m, the covariance of the error on the right (6, 6).

    References:
        Norgaard, Poulsen and Ravn (2000), New developments in state estimation for nonlinear systems, Automatica 36.
    """
    if surface.relief == 0.0:
        return 0.0
    moves = np.hstack([-np.eye(3), cross_matrix(point)])
    variances, axes = np.linalg.eigh(moves @ covariance @ moves.T)
    height, total = surface.height(point)[0], 0.0
    for variance, axis in zip(variances, axes.T, strict=True):
        step = math.sqrt(3.0 * max(variance, 0.0)) * axis
        bent = surface.height(point + step)[0] + surface.height(point - step)[0] - 2.0 * height
        total += min(abs(bent), surface.relief) ** 2
    return total / 18.0


def turning(surface: TouchedSurface, point: Array, covariance: Array) -> tuple[Array, Array, float]:
    r"""The normal at a point q [m], its derivative by the pose's error on the right, and what that does not tell.

    The normal is compared with one that is seen from the fixture; its derivative is

    .. math:: \left(-S,\; S [q]_\times - [n]_\times\right), \qquad
        S \approx \sum_i \frac{n(q + h_i) - n(q - h_i)}{2 |h_i|^2} h_i^T

    with steps h_i as in `bend`, and of `LEAST_STEP` at least, so that the derivative is that over the whole of where q
    may be. Returned are n (3,), its derivative (3, 6), and the variance by the second differences, as in `bend`.
    """
    moves = np.hstack([-np.eye(3), cross_matrix(point)])
    variances, axes = np.linalg.eigh(moves @ covariance @ moves.T)
    normal, shape, bent = surface.height(point)[1], np.zeros((3, 3)), 0.0
    for variance, axis in zip(variances, axes.T, strict=True):
        wide = math.sqrt(3.0 * max(variance, 0.0))
        step = max(wide, LEAST_STEP)
        ahead, behind = surface.height(point + step * axis)[1], surface.height(point - step * axis)[1]
        shape += np.outer(ahead - behind, axis) / (2.0 * step)
        second = ahead + behind - 2.0 * normal
        bent += float(second @ second) * (wide / step) ** 4 / 18.0
    derivative = shape @ moves
    derivative[:, 3:] -= cross_matrix(normal)
    return normal, derivative, bent

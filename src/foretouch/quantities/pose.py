"""The pose of a rigid body in another's frame, with its covariance and as plain numbers.

Loops take the plain numbers, for there an array for three of them costs more than the arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError

Vector: TypeAlias = tuple[float, float, float]


def add(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """First vector less the second."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scaled(a: Vector, factor: float) -> Vector:
    """Vector times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def dot(a: Vector, b: Vector) -> float:
    """Inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Vector) -> float:
    """Length of a vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])  # calls nothing of this module: kernels compile it


def rotation_of(a: float, b: float, c: float) -> tuple[Vector, Vector, Vector]:
    r"""Rows of the rotation matrix of a rotation vector [rad], by Rodrigues' formula.

    .. math:: R = I + \frac{\sin\theta}{\theta} [\phi] + \frac{1 - \cos\theta}{\theta^2} [\phi]^2
    """
    square = a * a + b * b + c * c
    angle = math.sqrt(square)
    small = angle < 1e-4  # the next terms are below 1e-16 of these
    s = 1.0 - square / 6.0 if small else math.sin(angle) / angle
    k = 0.5 - square / 24.0 if small else (1.0 - math.cos(angle)) / square
    return (
        (1.0 - k * (b * b + c * c), k * a * b - s * c, k * a * c + s * b),
        (k * a * b + s * c, 1.0 - k * (a * a + c * c), k * b * c - s * a),
        (k * a * c - s * b, k * b * c + s * a, 1.0 - k * (a * a + b * b)),
    )


class RigidMotion(NamedTuple):
    r"""Points of a body's frame to those of the frame it is seen from, :math:`p = R q + t`."""

    first: Vector  # first row of R
    second: Vector  # second row
    third: Vector  # third row
    translation: Vector  # t [m]

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> RigidMotion:
        """The pose of a position [m] and a rotation vector [rad], six numbers below 1e100."""
        x, y, z, a, b, c = map(float, numbers)
        return cls(*rotation_of(a, b, c), (x, y, z))

    def rotate(self, v: Vector) -> Vector:
        """R v: a direction of the body, seen from outside."""
        return dot(self.first, v), dot(self.second, v), dot(self.third, v)

    def rotate_back(self, v: Vector) -> Vector:
        """R^T v: a direction from outside, in the body."""
        (a, b, c), (d, e, f), (g, h, i) = self.first, self.second, self.third
        x, y, z = v
        return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z

    def apply(self, point: Vector) -> Vector:
        """R q + t."""
        return add(self.rotate(point), self.translation)

    def apply_back(self, point: Vector) -> Vector:
        """R^T (p - t): a point from outside, in the body's frame."""
        return self.rotate_back(subtract(point, self.translation))


Array = NDArray[np.float64]
ORTHONORMAL = 1e-6  # largest deviation of R^T R from the unit matrix


def cross_matrix(vector: ArrayLike) -> Array:
    """The matrix [v] with [v] u = v x u, (3, 3).

    Args:
        vector: v, (3,).
    """
    x, y, z = np.asarray(vector, float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True, eq=False, slots=True)
class Pose:
    r"""A rigid motion: points of the body's frame to those of the frame it is seen from.

    .. math:: p = R\,q + t

    Small errors stand on the right, in the body's own frame, translation first: the true pose is
    T exp(xi), xi = (rho, phi) in m and rad, and a covariance is that of xi, (6, 6).

    Args:
        rotation: R, (3, 3), right-handed and orthonormal within 1e-6.
        translation: t [m], (3,).

    Raises:
        SettingError: Not finite, another shape, or no rotation.

    References:
        Barfoot (2017), State Estimation for Robotics, chapter 7; Sola, Deray & Atchuthan (2018), A micro Lie theory.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, float)
        translation = np.array(self.translation, float)
        if translation.shape != (3,) or not np.isfinite(translation).all():
            raise SettingError("translation", self.translation, "must be three finite numbers")
        if rotation.shape != (3, 3) or not np.isfinite(rotation).all():
            raise SettingError("rotation", self.rotation, "must be 3 x 3 finite numbers")
        if np.abs(rotation.T @ rotation - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(rotation) < 0.0:
            raise SettingError("rotation", self.rotation.tolist(), "must be orthonormal and right-handed")
        rotation.flags.writeable = translation.flags.writeable = False
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @classmethod
    def identity(cls) -> Pose:
        """The body's frame is the frame it is seen from."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_rotation_vector(cls, rotation_vector: ArrayLike, translation: ArrayLike) -> Pose:
        """The pose of an axis times an angle [rad], (3,), and a translation [m], (3,)."""
        from scipy.spatial.transform import Rotation

        matrix = Rotation.from_rotvec(np.asarray(rotation_vector, float)).as_matrix()
        return cls(matrix, np.asarray(translation, float))

    @classmethod
    def exp(cls, twist: ArrayLike) -> Pose:
        r"""The exponential of a twist (rho, phi), m and rad, (6,), with R the rotation by phi and t = V rho.

        .. math:: V = I + \frac{1-\cos\theta}{\theta^2}[\phi] + \frac{\theta-\sin\theta}{\theta^3}[\phi]^2
        """
        twist = np.asarray(twist, float)
        phi = twist[3:]
        angle = float(np.linalg.norm(phi))
        k = cross_matrix(phi)
        if angle < 1e-4:  # the next terms are below 1e-10 of these
            first, second = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
        else:
            first, second = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
        v = np.eye(3) + first * k + second * k @ k
        return cls.from_rotation_vector(phi, v @ twist[:3])

    def log(self) -> Array:
        """The twist (rho, phi) that `exp` makes this pose of, m and rad, (6,); the norm of phi is at most pi."""
        phi = self.rotation_vector()
        angle = float(np.linalg.norm(phi))
        k = cross_matrix(phi)
        if angle < 1e-4:
            second = 1.0 / 12.0 + angle**2 / 720.0
        else:
            second = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle**2  # the half angle keeps it good up to pi
        inverse_v = np.eye(3) - 0.5 * k + second * k @ k
        return np.concatenate([inverse_v @ self.translation, phi])

    def rotation_vector(self) -> Array:
        """Axis times angle [rad], (3,)."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())

    def __matmul__(self, other: Pose) -> Pose:
        """This pose after the other: a body seen from a body seen from here."""
        rotation = self.rotation @ other.rotation
        u, _, vt = np.linalg.svd(rotation)  # the nearest rotation: long chains stay orthonormal
        return Pose(u @ vt, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose:
        """The frame it is seen from, seen from the body."""
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: ArrayLike) -> Array:
        """Points of the body's frame [m], (3,) or (n, 3), in the frame it is seen from."""
        return np.asarray(points, float) @ self.rotation.T + self.translation

    def distance(self, other: Pose) -> tuple[float, float]:
        """Distance to the other pose: between the origins [m], and the angle between them [rad]."""
        between = self.inverse() @ other
        return float(np.linalg.norm(between.translation)), float(np.linalg.norm(between.rotation_vector()))

"""A pose in plain numbers, for loops in which an array for three numbers costs more than the arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

__all__ = ["RigidMotion", "Vector", "add", "dot", "norm", "scaled", "subtract", "unit"]

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


def unit(a: Vector, otherwise: Vector) -> Vector:
    """The first vector with length 1; the second where the first has next to none (1e-9)."""
    length = norm(a)
    return scaled(a, 1.0 / length) if length > 1e-9 else otherwise


class RigidMotion(NamedTuple):
    r"""Points of a body's frame to those of the frame it is seen from, :math:`p = R q + t`.

    Attributes:
        first: First row of R.
        second: Second row.
        third: Third row.
        translation: t [m].
    """

    first: Vector
    second: Vector
    third: Vector
    translation: Vector

    @classmethod
    def from_numbers(cls, numbers: Sequence[float]) -> RigidMotion:
        r"""Of a place [m] and a rotation vector [rad], six numbers below 1e100, by Rodrigues' formula.

        .. math:: R = I + \frac{\sin\theta}{\theta} [\phi] + \frac{1 - \cos\theta}{\theta^2} [\phi]^2
        """
        x, y, z, a, b, c = (float(number) for number in numbers)
        square = a * a + b * b + c * c
        angle = math.sqrt(square)
        small = angle < 1e-4  # the next terms are below 1e-16 of these
        s = 1.0 - square / 6.0 if small else math.sin(angle) / angle
        k = 0.5 - square / 24.0 if small else (1.0 - math.cos(angle)) / square
        return cls(
            (1.0 - k * (b * b + c * c), k * a * b - s * c, k * a * c + s * b),
            (k * a * b + s * c, 1.0 - k * (a * a + c * c), k * b * c - s * a),
            (k * a * c - s * b, k * b * c + s * a, 1.0 - k * (a * a + b * b)),
            (x, y, z),
        )

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

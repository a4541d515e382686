"""Turns as the viewer writes them: quaternions with the real part first."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["along", "wxyz_of"]

Quaternion = tuple[float, float, float, float]


def wxyz_of(vector: Sequence[float]) -> Quaternion:
    """Of a rotation vector [rad]."""
    x, y, z = (float(value) for value in vector)
    angle = math.sqrt(x * x + y * y + z * z)
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), share * x, share * y, share * z


def along(direction: Sequence[float]) -> Quaternion:
    """The shortest turn from the z axis into a direction; none where it has no length.

    Args:
        direction: Of any length.
    """
    x, y, z = (float(value) for value in direction)
    length = math.sqrt(x * x + y * y + z * z)
    if not 0.0 < length < math.inf:
        return 1.0, 0.0, 0.0, 0.0
    x, y, z = x / length, y / length, z / length
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    w = math.sqrt(0.5 * (1.0 + z))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0

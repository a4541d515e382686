"""A plane, in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.models.checks import require
from foretouch.rendering.surfaces.surface import NO_TRIANGLE, Array, Point, Surface, SurfaceContact

__all__ = ["Plane"]

_NO_MEMORY = np.zeros(0)


class Plane(Surface):
    r"""All that is below a plane is inside.

    .. math:: d = (o - p) \cdot n, \quad q = p + d\, n

    Args:
        origin: o, a point of it [m].
        normal: n, outwards, of any length but 0.
        size: Side of the square about the origin that is drawn [m], positive.

    Raises:
        SettingError: Not three finite numbers, or a normal without direction.
    """

    def __init__(
        self,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        normal: Sequence[float] = (0.0, 0.0, 1.0),
        size: float = 0.1,
    ) -> None:
        require("size", size, above=0.0)
        self.origin = _three("origin", origin)
        direction = _three("normal", normal)
        largest = max(map(abs, direction))
        if not largest > 0.0:
            raise SettingError("normal", tuple(normal), "has no direction: give one number at least that is not 0")
        direction = (direction[0] / largest, direction[1] / largest, direction[2] / largest)
        length = math.hypot(*direction)
        self.normal: Point = (direction[0] / length, direction[1] / length, direction[2] / length)
        self.size = size

    def initial_memory(self) -> Array:
        """Nothing: a plane has no other side to come from."""
        return _NO_MEMORY

    def follow(self, memory: Array, x: float, y: float, z: float) -> SurfaceContact:
        """See `Surface.follow`."""
        (ox, oy, oz), (nx, ny, nz) = self.origin, self.normal
        depth = (ox - x) * nx + (oy - y) * ny + (oz - z) * nz
        return SurfaceContact(depth, self.normal, (x + depth * nx, y + depth * ny, z + depth * nz), NO_TRIANGLE)

    def outline(self) -> tuple[Array, NDArray[np.int64]]:
        """A square about the origin; see `Surface.outline`."""
        normal = np.array(self.normal)
        along = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        along /= np.linalg.norm(along)
        across = np.cross(normal, along)
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (0.5 * self.size)
        return np.array(self.origin) + corners @ np.array([along, across]), np.array([(0, 1, 2), (0, 2, 3)])

    def relief(self) -> tuple[float, float]:
        """None; see `Surface.relief`."""
        return 0.0, 0.0


def _three(name: str, values: Sequence[float]) -> Point:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise SettingError(name, numbers, "must be three finite numbers")
    return numbers

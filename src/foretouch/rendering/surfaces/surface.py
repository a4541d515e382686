"""Surfaces, which map a position of the probe to its proxy; and a plane, in closed form."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require

Array: TypeAlias = NDArray[np.float64]
Memory: TypeAlias = NDArray[Any]  # of one contact: zeros at first, written by the surface
Point: TypeAlias = tuple[float, float, float]

FARTHEST = 1e3  # Largest distance of a probe from the origin [m]

FACES_ALL_WAYS = 0.1
"""Least length of a mean normal: a shorter one is the remainder of sides that face each other, or of a few missing
ones."""

NO_TRIANGLE = -1  # Index of the touched triangle where a surface has none


class SurfaceContact(NamedTuple):
    """Position of a probe relative to a surface.

    Attributes:
        depth: Distance from the probe to its proxy, positive inside [m]. Outside, minus the distance to the nearest
            point of the surface [m], 0 on it. Of a sphere, that of its centre and the radius, see `OffsetSurface`.
        normal: Outward, of length 1; inside it is the direction from the probe to the proxy, so that a force along it
            has a potential.
        point: The proxy, on the surface [m].
        triangle: Index of the triangle that the proxy is on, -1 where the surface has none.
    """

    depth: float
    normal: Point
    point: Point
    triangle: int


class Surface(ABC):
    """A surface in the frame of the fixture. Subclasses do not change; the caller keeps the memory of a contact.

    A probe that has pressed past an edge, or through the middle of a thin plate, is nearest to a side that it did not
    come through. So contact has a history: the proxy (god object) stays on the surface and moves only where it can
    slide towards the probe. `SurfaceProxy` keeps that history.

    Attributes:
        radius: Radius of the probe whose centre is followed [m]; 0 for a point.

    References:
        Zilles and Salisbury (1995), A constraint-based god-object method for haptic display, IEEE/RSJ IROS.
    """

    radius: float = 0.0

    @property
    def bare(self) -> Surface:
        """The surface as a point feels it."""
        return self

    @abstractmethod
    def initial_memory(self) -> Memory:
        """Memory of a contact that has not begun."""

    @abstractmethod
    def follow(self, memory: Memory, x: float, y: float, z: float) -> SurfaceContact:
        """Move the probe to a position [m] and the proxy after it, within a contact's memory; never raises."""

    @abstractmethod
    def outline(self) -> tuple[Array, NDArray[np.int64]]:
        """Vertices [m] of shape (n, 3) to draw the surface, and triangles of shape (m, 3) of their indices."""

    def facing(self) -> Point:
        """Mean outward normal over its area, of length 1; (0, 0, 0) for a closed body, which faces all ways."""
        vertices, triangles = self.outline()
        corners = vertices[triangles]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        mean = areas.sum(axis=0) / np.linalg.norm(areas, axis=1).sum()
        length = float(np.linalg.norm(mean))
        x, y, z = (mean / length).tolist() if length > FACES_ALL_WAYS else (0.0, 0.0, 0.0)
        return x, y, z

    def relief(self) -> tuple[float, float]:
        """Sine of the largest angle between its normal and `facing`, and its extent along `facing` [m].

        A plane has 0 and 0. A surface that turns by a right angle or more has 1; so has one that faces all ways, whose
        extent is the diagonal of its bounding box.
        """
        vertices, triangles = self.outline()
        corners, mean = vertices[triangles], np.array(self.facing())
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        if not mean.any() or (normals @ mean <= 0.0).any():
            return 1.0, float(np.linalg.norm(np.ptp(vertices, axis=0)))
        sines = np.linalg.norm(np.cross(normals, mean), axis=1) / np.linalg.norm(normals, axis=1)
        return float(sines.max()), float(np.ptp(vertices @ mean))

    def contact(self, place: Sequence[float]) -> SurfaceContact:
        """Contact of a probe at a position [m] without history: with the nearest point of the surface."""
        x, y, z = (float(value) for value in place)
        return self.follow(self.initial_memory(), x, y, z)


_FAR = SurfaceContact(-math.inf, (0.0, 0.0, 1.0), (math.nan, math.nan, math.nan), NO_TRIANGLE)


class SurfaceProxy:
    """The god object of one probe on one surface.

    Args:
        surface: The surface.

    Attributes:
        newest: Contact of the newest position; infinitely far outside before the first.
    """

    __slots__ = ("_memory", "newest", "surface")

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.restart()

    def restart(self) -> None:
        """Forget the history: the next position is met by the nearest point of the surface."""
        self._memory = self.surface.initial_memory()
        self.newest = _FAR

    def follow(self, place: Sequence[float]) -> SurfaceContact:
        """Follow the probe to a position.

        A position that is not finite, or beyond 1 km, changes nothing and gets the newest contact again. Call it in
        every tick, outside the surface too: the side from which the probe comes is seen before contact.

        Args:
            place: Position of the probe [m], three numbers.
        """
        x, y, z = place
        if -FARTHEST <= x <= FARTHEST and -FARTHEST <= y <= FARTHEST and -FARTHEST <= z <= FARTHEST:
            self.newest = self.surface.follow(self._memory, x, y, z)
        return self.newest


_NO_MEMORY = np.zeros(0)


class Plane(Surface):
    r"""A plane: all that is below it is inside.

    .. math:: d = (o - p) \cdot n, \quad q = p + d\, n

    Args:
        origin: o, a point of the plane [m].
        normal: n, outwards, of any length but 0.
        size: Side of the square about the origin that is drawn [m], positive.

    Raises:
        SettingError: Not three finite numbers, or a normal without direction.
    """

    def __init__(
        self, origin: Sequence[float] = (0.0, 0.0, 0.0), normal: Sequence[float] = (0.0, 0.0, 1.0), size: float = 0.1
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

    def initial_memory(self) -> Memory:
        """Empty memory: a plane has no other side to come from."""
        return _NO_MEMORY

    def follow(self, memory: Memory, x: float, y: float, z: float) -> SurfaceContact:
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
        """Zero; see `Surface.relief`."""
        return 0.0, 0.0


def _three(name: str, values: Sequence[float]) -> Point:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise SettingError(name, numbers, "must be three finite numbers")
    return numbers

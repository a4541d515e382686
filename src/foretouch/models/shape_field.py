"""The shape of a surface that nobody knew: heights over the fixture's plane, as they become known."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.models.scale_field import NodePacket

Array = NDArray[np.float64]

PITCH = 8e-3
"""Distance between two nodes [m]: what is narrower is smoothed, as by the tip of a finger."""

CELLS = 15
SIDE = CELLS + 3  # Nodes along each axis: a cubic spline has one beyond its domain before it, and one behind
LENGTH = CELLS * PITCH  # Side of the square over which there are heights [m]
CORNER = (0.075 - 0.5 * LENGTH, -0.5 * LENGTH)
"""Lowest x and y of that square, about the middle of specimens, in the fixture's frame [m]."""

HIGHEST = 0.1  # Largest height above or below the fixture's plane [m]
SPREAD = 0.01
"""Standard deviation of the height where nothing was touched [m]."""

_PACKET = NodePacket(b"SH", "shape of a surface")
UNIT = 1e-3
"""Of value and deviation in a message [m]: half precision holds 8 mm to 4 um."""


def basis(along: ArrayLike) -> Array:
    r"""Weights of the nodes along an axis, shape (n, `SIDE`), at distances from the square's lowest side [m].

    .. math:: b_0 = \frac{(1-u)^3}{6},\; b_1 = \frac{3u^3 - 6u^2 + 4}{6},\; b_2 = \frac{-3u^3 + 3u^2 + 3u + 1}{6},\;
        b_3 = \frac{u^3}{6}

    for the place u from 0 to 1 in its cell. A place beyond the square is taken for the nearest on its rim.
    """
    place = np.clip(np.asarray(along, np.float64) / PITCH, 0.0, CELLS)
    cell = np.minimum(place.astype(np.int64), CELLS - 1)
    u = place - cell
    four = (1.0 - u) ** 3, 3.0 * u**3 - 6.0 * u**2 + 4.0, -3.0 * u**3 + 3.0 * u**2 + 3.0 * u + 1.0, u**3
    weights = np.zeros((len(place), SIDE))
    for number, weight in enumerate(four):
        weights[np.arange(len(place)), cell + number] = weight / 6.0
    return weights


class ShapeField:
    r"""Heights of a surface over the fixture's plane, seen from above.

    .. math:: z(x, y) = \sum_{i, j} b_i(x)\, b_j(y)\, c_{ij}

    a cubic spline, whose normal and curvature do not leap, over a square of 120 mm about the middle of specimens, with
    nodes 8 mm apart. Before anything is touched all c are 0. Of the height at each node its standard deviation is
    known, and between nodes that is interpolated.

    Attributes:
        coefficients: c [m], shape (`SIDE`, `SIDE`).
        deviations: Standard deviations of the height at the nodes [m], the same shape.
        count: Number of nodes that were told of.
    """

    __slots__ = ("_told", "coefficients", "deviations")

    def __init__(self) -> None:
        self.coefficients = np.zeros((SIDE, SIDE))
        self.deviations = np.full((SIDE, SIDE), SPREAD)
        self._told = np.zeros((SIDE, SIDE), np.bool_)

    @property
    def count(self) -> int:
        """See above."""
        return int(self._told.sum())

    def take(self, content: bytes) -> None:
        """Take nodes from `packed_shape`; others stay as they are.

        Raises:
            DecodeError: Another version or length, or a number that is out of range; then nothing is taken.
        """
        i, j, *numbers = _PACKET.unpack(content)
        value, deviation = (UNIT * number for number in numbers)
        if not ((i < SIDE) & (j < SIDE)).all():
            _PACKET.refuse(f"a node beyond the {SIDE} of a side")
        if not ((np.abs(value) <= HIGHEST) & (deviation >= 0.0) & (deviation <= HIGHEST)).all():
            _PACKET.refuse(f"a height beyond {HIGHEST:g} m, or a deviation that is not 0 to that")
        self.coefficients[i, j], self.deviations[i, j] = value, deviation
        self._told[i, j] = True

    def heights_at(self, points: ArrayLike) -> tuple[Array, Array]:
        """Heights at points of shape (n, 2) or (n, 3) in the fixture's frame, and their standard deviations [m]."""
        x, y = (np.asarray(points, np.float64)[:, :2] - CORNER).T
        heights = np.einsum("ni,ij,nj->n", basis(x), self.coefficients, basis(y))
        return heights, np.einsum("ni,ij,nj->n", _linear(x), self.deviations, _linear(y))


def _linear(along: Array) -> Array:
    """Weights of linear interpolation between the nodes."""
    place = np.clip(along / PITCH, 0.0, CELLS)
    return np.maximum(1.0 - np.abs(place[:, None] + 1.0 - np.arange(SIDE)), 0.0)


def packed_shape(i: ArrayLike, j: ArrayLike, value: ArrayLike, deviation: ArrayLike) -> bytes:
    """Nodes by row and column, their coefficients and the deviations of the heights there [m]: 8 bytes, 6 for each."""
    return _PACKET.pack(i, j, np.asarray(value) / UNIT, np.asarray(deviation) / UNIT)

"""The file of a mesh as what a scene is touched on: it has to be where the hand can reach it, and face up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import TriangleMesh, first_hit_from_above, read_mesh

__all__ = ["LARGEST_SIDE", "SMALLEST_SIDE", "specimen_of"]

SMALLEST_SIDE, LARGEST_SIDE = 0.005, 0.5
"""Seen from above a specimen is at least and at most as wide as this [m]: others are in another unit."""

REACH = 0.04
"""Its middle, seen from above, and its top are so near to where specimens stand [m]."""

TRIED = (0.0, -0.25, 0.25)
"""Where it comes down, in shares of the sides: a hole in the middle is none everywhere."""

Array = NDArray[np.float64]


def specimen_of(path: Path, middle: Vector) -> TriangleMesh:
    """Read the mesh that a scene is touched on; an open sheet that faces down is turned.

    Args:
        path: Of the file: STL, OBJ or PLY, in metres.
        middle: Where specimens stand in the fixture's frame [m].

    Raises:
        InputError: No such file, no mesh, or one that no hand can touch there: too small, too large, elsewhere, or
            with nothing that faces up.
        MissingExtraError: What reads meshes is not installed.
    """
    mesh = read_mesh(path)
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    _check_size(path, high - low)
    _check_place(path, 0.5 * (low + high), float(high[2]), middle)
    if _is_met(mesh, low, high):
        return mesh
    turned = None if mesh.closed else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    if turned is None or not _is_met(turned, low, high):
        raise InputError(f"{path}: who comes down on it touches nothing: turn it so that its surface faces up (+z)")
    return turned


def _check_size(path: Path, sides: Array) -> None:
    wide, across, _ = (float(side) for side in sides)
    if not SMALLEST_SIDE <= min(wide, across) <= max(wide, across) <= LARGEST_SIDE:
        raise InputError(
            f"{path}: seen from above it is {wide:.3g} m by {across:.3g} m, but each side has to be "
            f"{SMALLEST_SIDE:g} to {LARGEST_SIDE:g} m: give it in metres (scale by 0.001 what is in millimetres)"
        )


def _check_place(path: Path, centre: Array, top: float, middle: Vector) -> None:
    x, y = float(centre[0]), float(centre[1])
    if max(abs(x - middle[0]), abs(y - middle[1]), abs(top - middle[2])) > REACH:
        raise InputError(
            f"{path}: it stands about ({x:.3g}, {y:.3g}) m with its top at {top:.3g} m, beyond the hand's reach: "
            f"move it to within {REACH:g} m of {middle} in the fixture's frame"
        )


def _is_met(mesh: TriangleMesh, low: Array, high: Array) -> bool:
    """Whether a probe that comes down somewhere about the middle touches it."""
    centre, sides = 0.5 * (low + high), high - low
    for right in TRIED:
        for back in TRIED:
            x, y = float(centre[0] + right * sides[0]), float(centre[1] + back * sides[1])
            hit = first_hit_from_above(mesh, x, y)
            if hit >= 0 and _faces_up(mesh, hit):
                return True
    return False


def _faces_up(mesh: TriangleMesh, triangle: int) -> bool:
    a, b, c = mesh.vertices[mesh.faces[triangle]]
    return bool(np.cross(b - a, c - a)[2] > 0.0)

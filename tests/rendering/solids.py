"""Bodies and paths for the tests of surfaces."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from foretouch.rendering.surfaces import Surface, SurfaceContact, SurfaceProxy, TriangleMesh

trimesh = pytest.importorskip("trimesh")
Array = NDArray[np.float64]


def surface_of(mesh: Any) -> TriangleMesh:
    return TriangleMesh(mesh.vertices, mesh.faces)


def box(x: float = 0.1, y: float = 0.1, z: float = 0.1) -> TriangleMesh:
    """With its middle at the origin."""
    return surface_of(trimesh.creation.box((x, y, z)))


def ball(radius: float = 0.05, subdivisions: int = 4) -> TriangleMesh:
    return surface_of(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius))


def room(side: float = 0.1) -> TriangleMesh:
    """A box that is felt from within: three planes meet in each of its corners."""
    mesh = trimesh.creation.box((side, side, side))
    mesh.invert()
    return surface_of(mesh)


def straight(*corners: Iterable[float], speed: float = 0.05) -> Array:
    """Places of every millisecond on the way from corner to corner, of shape (n, 3)."""
    points = [np.array(list(corner), dtype=float) for corner in corners]
    parts = [points[0][None]]
    for one, other in pairwise(points):
        count = max(int(np.ceil(np.linalg.norm(other - one) / (speed * 1e-3))), 1)
        parts.append(one + (other - one) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(parts)


def follow(surface: Surface, path: Array) -> list[SurfaceContact]:
    proxy = SurfaceProxy(surface)
    return [proxy.follow(place) for place in path.tolist()]


def spring_forces(contacts: list[SurfaceContact], stiffness: float = 1000.0) -> Array:
    """On the hand [N], of shape (n, 3)."""
    return np.array([[stiffness * max(c.depth, 0.0) * n for n in c.normal] for c in contacts])


def work_of(path: Array, forces: Array) -> Array:
    """Given to the hand so far [J], by the trapezoidal rule, of shape (n - 1,)."""
    return np.cumsum(0.5 * np.einsum("ij,ij->i", forces[1:] + forces[:-1], np.diff(path, axis=0)))

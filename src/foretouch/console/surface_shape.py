"""The touched surface as triangles to draw: fine enough to sink under a probe. Numbers only, no viewer."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from foretouch.console.window import Array

__all__ = ["Faces", "boundary", "compacted", "refined", "skirt", "sunk", "thinned"]

Faces = NDArray[np.int64]

LONGEST_EDGE = 4e-3
"""Triangles are divided until no edge is longer [m]."""
MOST_TRIANGLES = 6000
"""Or until there are so many."""
NARROW, REACH = 2.5e-3, 16e-3
"""Width of a shallow dent, and where every dent ends [m]."""
TIP_RADIUS = 2.25e-3
"""Of the probe as it is drawn [m]."""


def refined(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Divide every triangle into four, until they are fine enough to be bent; or join them where they are too many.

    Args:
        vertices: [m], shape (n, 3).
        faces: Indices, shape (m, 3).
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    if len(faces) > MOST_TRIANGLES:
        return thinned(vertices, faces, MOST_TRIANGLES)
    while _longest_edge(vertices, faces) > LONGEST_EDGE and 4 * len(faces) <= MOST_TRIANGLES:
        edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        middle = len(vertices) + index.reshape(-1, 3)
        vertices = np.vstack([vertices, vertices[unique].mean(axis=1)])
        (a, b, c), (ab, bc, ca) = faces.T, middle.T
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return vertices, faces


def thinned(vertices: Array, faces: Faces, most: int) -> tuple[Array, Faces]:
    """Fewer triangles: vertices in one cube become one, in cubes as large as it takes.

    A browser is sent what is drawn thirty times a second. What is felt is the whole mesh.

    Args:
        vertices: [m], shape (n, 3).
        faces: Indices, shape (m, 3).
        most: Triangles that are left.

    References:
        Rossignac and Borrel (1993), Multi-resolution 3D approximations for rendering complex scenes, in Modeling in
        Computer Graphics, Springer: vertex clustering.
    """
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    side = math.sqrt(float(np.linalg.norm(crosses, axis=1).sum()) / most)  # about two triangles a cube
    low = vertices.min(axis=0)
    while True:
        cubes, cube_of = np.unique(((vertices - low) / side).astype(np.int64), axis=0, return_inverse=True)
        joined = cube_of.reshape(-1)[faces]
        joined = joined[(joined != np.roll(joined, 1, axis=1)).all(axis=1)]
        _, first = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
        if len(first) <= most:
            break
        side *= 1.25
    counts = np.bincount(cube_of.reshape(-1), minlength=len(cubes))
    sums = [np.bincount(cube_of.reshape(-1), vertices[:, axis], len(cubes)) for axis in range(3)]
    return np.column_stack(sums) / counts[:, None], joined[np.sort(first)]


def sunk(vertices: Array, point: Sequence[float], normal: Sequence[float], depth: float) -> tuple[Array, Array]:
    r"""Vertices under a probe, and by how much each has sunk.

    .. math:: u(r) = d \left(1 + r^2 / w^2\right)^{-3/2} \left(1 - r^2 / W^2\right)^2, \quad w^2 = w_0^2 + 3 d R

    along the normal; r is the distance from the proxy. It is a picture, not a solution.

    Args:
        vertices: [m], shape (n, 3).
        point: The proxy [m].
        normal: Outward, of length 1.
        depth: d [m]; nothing sinks where it is not positive.
    """
    if not depth > 0.0:
        return vertices, np.zeros(len(vertices))
    square = ((vertices - np.asarray(point)) ** 2).sum(axis=1)
    edge = np.maximum(1.0 - square / REACH**2, 0.0) ** 2
    sinking = depth * edge * (1.0 + square / (NARROW**2 + 3.0 * depth * TIP_RADIUS)) ** -1.5
    return vertices - sinking[:, None] * np.asarray(normal), sinking


def boundary(faces: Faces) -> Faces:
    """Edges of one triangle alone, shape (k, 2): none where the surface is closed."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, index, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    alone: Faces = edges[count[index.reshape(-1)] == 1]
    return alone


def skirt(vertices: Array, faces: Faces, bottom: float) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Walls from a surface's rim down to a height [m]; None of them where it is closed."""
    rim = boundary(faces)
    low, high = vertices[rim].copy(), vertices[rim]
    low[..., 2] = bottom
    walls = np.concatenate([high, low], axis=1).reshape(-1, 3).astype(np.float32)
    start = 4 * np.arange(len(rim))[:, None]
    triangles = np.concatenate([start + np.array(corners) for corners in ((0, 1, 3), (0, 3, 2))]).astype(np.uint32)
    return walls, triangles


def compacted(faces: Faces) -> tuple[Faces, NDArray[np.uint32]]:
    """Which vertices some triangles have, and the triangles over these alone."""
    used, index = np.unique(faces, return_inverse=True)
    return used, index.reshape(-1, 3).astype(np.uint32)


def _longest_edge(vertices: Array, faces: Faces) -> float:
    corners = vertices[faces]
    return math.sqrt(float(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max()))

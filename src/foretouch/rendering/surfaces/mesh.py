"""A surface of triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.rendering.surfaces import god_object
from foretouch.rendering.surfaces.geometry import Array, Ints, Triangle, build_boxes
from foretouch.rendering.surfaces.surface import Memory, Surface, SurfaceContact

LARGEST_COORDINATE = 100.0
"""Coordinates beyond this [m] are refused: the file is in other units, and crossings are told to a nanometre."""


class TriangleMesh(Surface):
    """A surface of triangles, closed about a body or an open sheet, with the god object on it.

    Corners run anticlockwise, seen from outside. A closed mesh is a body. An open one is a sheet that is felt from its
    outward side only: what comes from behind or round its border passes, and contact ends where the probe goes beyond
    the border. The proxy stays on the piece of mesh that it came in through; pieces that reach into each other are not
    seen as one.

    Args:
        vertices: [m], of shape (n, 3).
        faces: Indices of the corners, of shape (m, 3).

    Attributes:
        vertices: As given, those of no face too.
        faces: As given.
        closed: Whether every edge has two triangles.
        shape: What compiled code walks on.

    Raises:
        SettingError: Not a surface: shapes, numbers, faces without area, edges with more than two triangles or with two
            that are wound against each other. `read_mesh` repairs what can be repaired.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        self.vertices = np.array(vertices, dtype=np.float64)
        self.faces = np.array(faces, dtype=np.int64)
        _check(self.vertices, self.faces)
        corners = self.vertices[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        if not areas.min() > 0.0:
            raise SettingError("faces", int(np.argmin(areas)), "this face has no area: leave it out, or merge vertices")
        normals /= areas[:, None]
        neighbours = _neighbours(self.faces, self.vertices)
        self.closed = bool((neighbours >= 0).all())
        fan_starts, fans = _fans(self.faces, len(self.vertices))
        triangles = Triangle.new(
            len(self.faces),
            corners=corners,
            normals=_normals(corners, normals, neighbours, self.faces, len(self.vertices)),
            vertices=self.faces,
            neighbours=neighbours,
            border=_border(self.faces, neighbours, len(self.vertices)),
        )
        self.shape = god_object.Mesh(triangles, fan_starts, fans, *build_boxes(corners), self.closed)

    def initial_memory(self) -> Memory:
        """See `Surface.initial_memory`."""
        return god_object.Proxy.new()

    def follow(self, memory: Memory, x: float, y: float, z: float) -> SurfaceContact:
        """See `Surface.follow`."""
        return SurfaceContact(*god_object.follow.entry(self.shape, memory, x, y, z))

    def outline(self) -> tuple[Array, NDArray[np.int64]]:
        """See `Surface.outline`."""
        return self.vertices, self.faces


def _check(vertices: Array, faces: NDArray[np.int64]) -> None:
    """Refuse what is no list of points and triangles."""
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise SettingError("vertices", vertices.shape, "must be of shape (n, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise SettingError("faces", faces.shape, "must be of shape (m, 3), one triangle at least")
    if not (np.abs(vertices) <= LARGEST_COORDINATE).all():
        raise SettingError(
            "vertices", float(np.abs(vertices).max()), f"must be finite and within {LARGEST_COORDINATE:g} m: scale them"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise SettingError("faces", int(faces.max()), f"must be indices of the {len(vertices)} vertices")


def _neighbours(faces: NDArray[np.int64], vertices: Array) -> NDArray[np.int64]:
    """The triangle beyond each edge, of shape (m, 3); -1 where there is none."""
    count = len(faces)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key = edges.max(axis=1) + 1
    width = int(key.max()) + 1
    codes = edges.min(axis=1) * width + edges.max(axis=1)
    order = np.argsort(codes, kind="stable")
    same = codes[order][1:] == codes[order][:-1]
    if (same[1:] & same[:-1]).any():
        edge = edges[order[np.flatnonzero(same[1:] & same[:-1])[0]]]
        rule = f"this edge, at {_middle(vertices[edge])} m, has more than two triangles: split the vertices"
        raise SettingError("faces", tuple(edge.tolist()), rule)
    one, other = order[:-1][same], order[1:][same]
    against = edges[one, 0] == edges[other, 0]
    if against.any():
        edge = edges[one[np.flatnonzero(against)[0]]]
        rule = f"the two triangles of this edge, at {_middle(vertices[edge])} m, are wound against each other: turn one"
        raise SettingError("faces", tuple(edge.tolist()), rule)
    result = np.full(3 * count, -1)
    result[one], result[other] = other // 3, one // 3
    return result.reshape(count, 3)


def _middle(ends: Array) -> str:
    """Of an edge, in words."""
    return "({:.4g}, {:.4g}, {:.4g})".format(*ends.mean(axis=0))


def _fans(faces: NDArray[np.int64], vertices: int) -> tuple[Ints, Ints]:
    """The triangles about each vertex, one after another, and where those of each begin."""
    order = np.argsort(faces.ravel(), kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(faces.ravel(), minlength=vertices))])
    return starts.astype(np.int32), (order // 3).astype(np.int32)


def _border(faces: NDArray[np.int64], neighbours: NDArray[np.int64], vertices: int) -> NDArray[np.bool_]:
    """Whether the features of each triangle are on a border, of shape (m, 7)."""
    on_border = np.zeros(vertices, dtype=bool)
    for edge in range(3):
        alone = neighbours[:, edge] < 0
        on_border[faces[alone, edge]] = True
        on_border[faces[alone, (edge + 1) % 3]] = True
    return np.concatenate([on_border[faces], neighbours < 0, np.zeros((len(faces), 1), bool)], axis=1)


def _normals(
    corners: Array, normals: Array, neighbours: NDArray[np.int64], faces: NDArray[np.int64], vertices: int
) -> Array:
    """Normals of the features of each triangle, of shape (m, 7, 3); those of the corners are weighted by angle."""
    beyond = np.where((neighbours >= 0)[:, :, None], normals[neighbours], 0.0)
    edges = _unit(normals[:, None, :] + beyond, normals)
    sums = np.zeros((vertices, 3))
    for corner in range(3):
        one = corners[:, (corner + 1) % 3] - corners[:, corner]
        other = corners[:, (corner + 2) % 3] - corners[:, corner]
        angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other))
        np.add.at(sums, faces[:, corner], angle[:, None] * normals)
    at_corners = _unit(sums[faces], normals)
    return np.concatenate([at_corners, edges, normals[:, None, :]], axis=1)


def _unit(sums: Array, normals: Array) -> Array:
    """Of length 1; the face's own normal where the sum has no direction."""
    lengths = np.linalg.norm(sums, axis=2, keepdims=True)
    return np.where(lengths > 1e-9, sums / np.maximum(lengths, 1e-9), normals[:, None, :])


class HeightField(Surface):
    """Heights z(x, y) on a regular grid, felt from above: two triangles a cell, with the god object of `TriangleMesh`.

    Between the nodes the surface is flat in each triangle: a bilinear one has no proxy in closed form, and its normal
    jumps at the cells' edges as well.

    Args:
        heights: z [m], of shape (n, m): n along x, m along y, at least 2 by 2.
        spacing: Between nodes [m], positive.
        origin: x and y of the first node [m].

    Attributes:
        mesh: Its triangles.

    Raises:
        SettingError: A grid that is none, or heights that are not finite.
    """

    def __init__(self, heights: ArrayLike, spacing: float, origin: Sequence[float] = (0.0, 0.0)) -> None:
        require("spacing", spacing, above=0.0)
        z = np.array(heights, dtype=np.float64)
        if z.ndim != 2 or min(z.shape) < 2:
            raise SettingError("heights", z.shape, "must be of shape (n, m), 2 by 2 at least")
        n, m = z.shape
        x, y = np.meshgrid(origin[0] + spacing * np.arange(n), origin[1] + spacing * np.arange(m), indexing="ij")
        node = np.arange(n * m).reshape(n, m)
        a, b, c, d = (part.ravel() for part in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
        even = (np.add.outer(np.arange(n - 1), np.arange(m - 1)) % 2 == 0).ravel()
        # the diagonals change direction from cell to cell: none is preferred
        first = np.where(even[:, None], np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
        second = np.where(even[:, None], np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
        self.mesh = TriangleMesh(np.stack([x, y, z], axis=2).reshape(-1, 3), np.concatenate([first, second]))

    def initial_memory(self) -> Memory:
        """See `Surface.initial_memory`."""
        return self.mesh.initial_memory()

    def follow(self, memory: Memory, x: float, y: float, z: float) -> SurfaceContact:
        """See `Surface.follow`."""
        return self.mesh.follow(memory, x, y, z)

    def outline(self) -> tuple[Array, NDArray[np.int64]]:
        """See `Surface.outline`."""
        return self.mesh.outline()

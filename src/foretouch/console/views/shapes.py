"""Meshes of the scene, and the material as a cut block whose surface sinks under the tip, darker the deeper.

Bodies of revolution and the cut block are in scene units; what is done with the triangles of any surface follows. Turns
are quaternions as the viewer writes them, with the real part first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.console.history import Array
from foretouch.quantities.colours import CUT, DENT

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices (V, 3) [scene units] and triangles (F, 3)."""

TIP_RADIUS = 0.45
EDGE = 3.9
"""Distance from the axis at which the material does not sink any more [scene units]."""
SHALLOW = math.sqrt(0.5)
"""Width of a shallow dent [scene units]."""
HANDLE_HEIGHT = 4.6
"""Height of the middle of the handle above the tip [scene units]."""


def lathe(profile: list[tuple[float, float]], segments: int = 24) -> Mesh:
    """Body of revolution about z, of radii and heights [scene units] from the bottom up; radii of 0 close the ends."""
    angle = np.linspace(0.0, 2.0 * math.pi, segments, endpoint=False)
    radius, height = np.array(profile).T
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.empty((len(profile), segments, 3), np.float32)
    vertices[..., :2] = radius[:, None, None] * ring
    vertices[..., 2] = height[:, None]
    i, j = np.meshgrid(np.arange(len(profile) - 1), np.arange(segments), indexing="ij")
    a, b = i * segments + j, i * segments + (j + 1) % segments
    c, d = a + segments, b + segments
    faces = np.stack([np.stack([a, b, d], -1), np.stack([a, d, c], -1)], axis=2).reshape(-1, 3)
    return vertices.reshape(-1, 3), faces.astype(np.uint32)


def probe(growth: float = 0.0) -> Mesh:
    """Round tip at the origin and the rod above it; `growth` [scene units] makes a shell around it."""
    radius = TIP_RADIUS
    tip = [
        (math.sin(a) * (radius + growth), radius - math.cos(a) * (radius + growth))
        for a in np.linspace(0.0, 0.8 * math.pi, 14)
    ]
    rod = 0.2 + growth
    return lathe([*tip, (rod, 1.8 * radius + 0.15), (rod, HANDLE_HEIGHT), (0.0, HANDLE_HEIGHT)])


def handle() -> Mesh:
    """A double arrow about the origin: what can be pulled up and pushed down."""
    neck, width, cone, end = 0.42, 0.95, 0.45, 1.25
    half = [(neck, 0.0), (neck, cone), (width, cone), (0.0, end)]
    return lathe([(r, -z) for r, z in reversed(half[1:])] + half, segments=32)


def ring() -> Mesh:
    """A thin collar around the rod, its lower rim at the origin: where the hand is."""
    inner, outer, height = 0.75, 0.9, 0.12
    return lathe([(inner, 0.0), (outer, 0.0), (outer, height), (inner, height), (inner, 0.0)], 32)


def arrow(length: float) -> Mesh:
    """Arrow from the origin upwards, `length` [scene units] long; a short one is small all over."""
    length = max(length, 1e-3)
    head = min(0.5, 0.7 * length)
    shaft, width = 0.2 * head, 0.48 * head
    return lathe([(0.0, 0.0), (shaft, 0.0), (shaft, length - head), (width, length - head), (0.0, length)], 16)


def uncertainty(low: float, high: float) -> Mesh:
    """A sleeve around an arrow's end, between two heights [scene units]: where the end may as well be."""
    low, high = max(low, 0.0), max(high, low + 1e-3, 1e-3)
    radius = 0.36
    return lathe([(0.0, low), (radius, low), (radius, high), (0.0, high)], 20)


def hint() -> Mesh:
    """An arrow downwards, its end at the origin: which way to pull."""
    neck, width, cone, length = 0.2, 0.5, 0.7, 1.9
    return lathe([(0.0, 0.0), (width, cone), (neck, cone), (neck, length), (0.0, length)], 20)


def rail(bottom: float, top: float) -> Mesh:
    """Flat strip behind the handle, between two heights of its middle [scene units]."""
    x, y, low, high = 1.15, 0.0, bottom - 1.3, top + 1.3
    vertices = np.array([(-x, y, low), (x, y, low), (x, y, high), (-x, y, high)], np.float32)
    return vertices, np.array([(0, 1, 2), (0, 2, 3)], np.uint32)


class Material:
    """A block that is cut through the middle, so that the dent shows in the cut as well as on top.

    The surface sinks as of `sinking`, to the block's nearest edge; below, that fades linearly to none at the bottom.
    """

    def __init__(self, width: float = 4.0, depth: float = 4.0, height: float = 3.0, layers: int = 6) -> None:
        radii = width * np.sinh(np.linspace(0.0, 2.2, 25)) / math.sinh(2.2)
        self._x = np.concatenate([-radii[:0:-1], radii])
        self._size = (width, depth, height)
        self._height = height
        angles = np.linspace(0.0, math.pi, 33)
        self._top = _rings(radii, angles, width, depth)
        self._levels = np.linspace(0.0, -height, layers + 1)
        self.top_faces = _grid(len(radii), len(angles))
        cut = _grid(len(self._x), layers + 1).reshape(len(self._x) - 1, layers, 2, 3)
        self.layer_faces = (cut[:, 0::2].reshape(-1, 3), cut[:, 1::2].reshape(-1, 3))
        """Triangles of every other layer of the cut, both over the vertices of `cut`."""

    def top(self, depth: float) -> NDArray[np.float32]:
        """Vertices of the upper surface with the tip at `depth` [scene units]."""
        x, y = self._top.T
        return np.stack([x, y, -self._sinking(np.hypot(x, y), depth)], axis=1).astype(np.float32)

    def levels(self, depth: float, steps: tuple[float, ...]) -> list[NDArray[np.uint32]]:
        """Triangles of the upper surface by how far they have sunk: less than the first step, the second, and so on."""
        corners = -self.top(depth)[:, 2][self.top_faces].reshape(-1, 6)  # the two triangles of a quad have one colour
        level = np.repeat(np.searchsorted(np.array(steps), corners.mean(axis=1), side="right"), 2)
        return [self.top_faces[level == index] for index in range(len(steps) + 1)]

    def cut(self, depth: float) -> NDArray[np.float32]:
        """Vertices of the cut face with the tip at `depth` [scene units]."""
        sunk = self._sinking(self._x, depth)[:, None] * (1.0 + self._levels / self._height)
        z = np.maximum(self._levels - sunk, -self._height)
        x = np.broadcast_to(self._x[:, None], z.shape)
        return np.stack([x, np.zeros_like(z), z], axis=-1).reshape(-1, 3).astype(np.float32)

    def _sinking(self, radius: Array, depth: float) -> Array:
        return sinking(radius**2, max(depth, 0.0), SHALLOW, EDGE, TIP_RADIUS)

    def sides(self) -> Mesh:
        """The block's other faces, which do not move."""
        w, d, h = self._size
        vertices = np.array([(x, y, z) for x in (-w, w) for y in (0.0, d) for z in (0.0, -h)], np.float32)
        quads = ((0, 1, 3, 2), (4, 6, 7, 5), (2, 3, 7, 6), (1, 5, 7, 3))
        faces = [triangle for a, b, c, e in quads for triangle in ((a, b, c), (a, c, e))]
        return vertices, np.array(faces, np.uint32)


def sinking(square: Array, depth: float, width: float, reach: float, tip: float) -> Array:
    r"""How far a surface sinks under a tip at a depth, all in one unit of length.

    .. math:: u(r) = d \left(1 + r^2 / w^2\right)^{-3/2} \left(1 - r^2 / W^2\right)^2, \quad w^2 = w_0^2 + 3 d R

    which follows the tip. It is a picture, not a solution.

    Args:
        square: Square of the distance r from the tip.
        depth: d, not negative.
        width: w_0, that of a shallow dent.
        reach: W, where every dent ends.
        tip: R, radius of the tip.
    """
    edge = np.maximum(1.0 - square / reach**2, 0.0) ** 2
    sunk: Array = depth * edge * (1.0 + square / (width**2 + 3.0 * depth * tip)) ** -1.5
    return sunk


def _rings(radii: Array, angles: Array, width: float, depth: float) -> Array:
    """Half rings about the axis, shape (radii * angles, 2): what sinks alike lies on one; the outermost is the edge."""
    x = radii[:, None] * np.cos(angles)
    y = radii[:, None] * np.sin(angles)
    reach = np.minimum(width / np.maximum(np.abs(np.cos(angles)), 1e-9), depth / np.maximum(np.sin(angles), 1e-9))
    x[-1], y[-1] = reach * np.cos(angles), reach * np.sin(angles)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _grid(rows: int, columns: int) -> NDArray[np.uint32]:
    """Triangles over a grid of vertices in row order."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = i * columns + j
    quads = np.stack([np.stack([a, a + columns, a + columns + 1], -1), np.stack([a, a + columns + 1, a + 1], -1)], 2)
    return quads.reshape(-1, 3).astype(np.uint32)


SMALLEST_CHANGE = 0.002
"""Changes below this [scene units], 0.01 mm, are not drawn."""
LARGEST_DEPTH = 2.9
"""The picture of the block goes no deeper [scene units]."""
STEPS = (0.1, 0.4, 0.9, 1.5)
"""Depths at which the dent's colour changes [scene units]: 0.5, 2, 4.5 and 7.5 mm."""


def add_body(scene: Any, name: str, mesh: Mesh, colour: tuple[int, int, int], opacity: float | None = None) -> Any:
    """One coloured mesh of the scene."""
    return scene.add_mesh_simple(name, *mesh, color=colour, opacity=opacity, side="double", material="toon5")


class MaterialView:
    """The block of `Material`; its upper surface has the colour of how far it has sunk."""

    def __init__(self, scene: Any) -> None:
        self._material = Material()
        self._drawn_depth = 0.0
        top, cut = self._material.top(0.0), self._material.cut(0.0)
        self._tops = [
            add_body(scene, f"/line/material/top_{i}", (top, self._material.top_faces), colour)
            for i, colour in enumerate(DENT)
        ]
        for node in self._tops[1:]:
            node.visible = False
        self._cut = [
            add_body(scene, f"/line/material/cut_{i}", (cut, faces), colour)
            for i, (faces, colour) in enumerate(zip(self._material.layer_faces, CUT, strict=True))
        ]
        add_body(scene, "/line/material/sides", self._material.sides(), CUT[1])

    def draw(self, depth: float) -> None:
        """Sink under the tip at a depth [scene units]."""
        depth = min(max(depth, 0.0), LARGEST_DEPTH)
        if abs(depth - self._drawn_depth) < SMALLEST_CHANGE:
            return
        self._drawn_depth = depth
        top = self._material.top(depth)
        for node, faces in zip(self._tops, self._material.levels(depth, STEPS), strict=True):
            node.visible = len(faces) > 0
            if len(faces):
                node.vertices, node.faces = top, faces
        for node in self._cut:
            node.vertices = self._material.cut(depth)


Quaternion = tuple[float, float, float, float]


def wxyz_of(vector: Sequence[float]) -> Quaternion:
    """Of a rotation vector [rad]."""
    x, y, z = (float(value) for value in vector)
    angle = math.sqrt(x * x + y * y + z * z)
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), share * x, share * y, share * z


def along(direction: Sequence[float]) -> Quaternion:
    """The shortest turn from the z axis into a direction; none where it has no length."""
    x, y, z = (float(value) for value in direction)
    length = math.sqrt(x * x + y * y + z * z)
    if not 0.0 < length < math.inf:
        return 1.0, 0.0, 0.0, 0.0
    x, y, z = x / length, y / length, z / length
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    w = math.sqrt(0.5 * (1.0 + z))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0


Faces = NDArray[np.int64]


LONGEST_EDGE = 4e-3
"""Triangles are divided until no edge is longer [m]."""


MOST_TRIANGLES = 6000
"""Largest number of triangles, at which the division ends."""


def refined(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Divide triangles [m] into four each, until they are fine enough to be bent; join them where they are too many."""
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

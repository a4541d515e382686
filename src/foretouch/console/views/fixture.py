"""The virtual fixture in the picture: its board, and its surface with its dent and the colours of what was learnt.

The surface is drawn as triangles, fine enough to sink under a probe. Turns are quaternions as the viewer writes them,
with the real part first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.console.panels.image import BOARD, MARKER, footprint
from foretouch.console.views.shapes import add_body
from foretouch.console.views.stiffness_colours import (
    COLOURS,
    LEAST_KNOWN,
    UNKNOWN,
    StiffnessScale,
    known_share,
    levels_of,
)
from foretouch.console.window import Array
from foretouch.models import MaterialField
from foretouch.quantities.colours import CUT, GREY, INK, VERMILLION
from foretouch.quantities.pose import RigidMotion
from foretouch.rendering import Surface

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


Faces = NDArray[np.int64]

LONGEST_EDGE = 4e-3
"""Triangles are divided until no edge is longer [m]."""
MOST_TRIANGLES = 6000
"""Largest number of triangles, at which the division ends."""
NARROW, REACH = 2.5e-3, 16e-3
"""Width of a shallow dent, and where every dent ends [m]."""
TIP_RADIUS = 2.25e-3
"""Radius of the probe as it is drawn [m]."""


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


THICKNESS = 0.012
"""Thickness of specimen and board as they are drawn [m]."""
SMALLEST_CHANGE = 2e-5
"""Smallest change of a dent that is drawn [m]."""
HALO = 2.0
"""Number of standard deviations that the halo shows."""
LARGEST_HALO = 0.02
"""The halo is no larger than this [m]."""


class FixtureView:
    """Board and specimen where the leader renders them, and an outline where the follower believes them.

    Args:
        scene: The viewer's.
        surface: In the fixture's frame.
        units: Scene units per metre.
    """

    def __init__(self, scene: Any, surface: Surface, units: float) -> None:
        self._units = units
        vertices, faces = surface.outline()
        self._vertices, self._faces = refined(vertices, faces)
        self._dent, self._normal = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        self._levels = np.zeros(len(self._faces), np.int64)
        self._touched = np.zeros(len(COLOURS) + 1, bool)
        self._parts: list[tuple[Any, Faces]] = []
        self._drawn: Any = None
        self.scale = StiffnessScale()
        self._root = scene.add_frame("/space/fixture", show_axes=False)
        self._believed = scene.add_frame("/space/believed", show_axes=False)
        nothing = (np.zeros((3, 3), np.float32), np.array([(0, 1, 2)], np.uint32))
        self._nodes = [
            scene.add_mesh_simple(f"/space/fixture/surface_{i}", *nothing, color=colour, side="double")
            for i, colour in enumerate((UNKNOWN, *COLOURS))
        ]
        bottom = float(self._vertices[:, 2].min()) - THICKNESS
        if len(boundary(faces)):
            walls, triangles = skirt(self._vertices, self._faces, bottom)
            add_body(scene, "/space/fixture/walls", (walls * units, triangles), CUT[0])
        self._add_board(scene)
        rim = footprint(self._vertices) * units
        self._outline = scene.add_line_segments(
            "/space/believed/outline", _ring(rim), VERMILLION, thickness=2.0, thickness_units="screen"
        )
        self._halo = add_body(scene, "/space/believed/halo", _halo(rim, 0.0), VERMILLION, opacity=0.18)
        self._halo_size = 0.0
        self._paint()

    def place(self, pose: Sequence[float]) -> None:
        """Put the fixture where the leader renders it: a position [m] and a rotation vector [rad]."""
        _place(self._root, pose, self._units)

    def believe(self, pose: Sequence[float] | None, deviation: float) -> None:
        """Draw the follower's estimate of its pose, with its uncertainty.

        Args:
            pose: A position [m] and a rotation vector [rad]; None where it is unknown.
            deviation: Standard deviation of its position [m]; NaN for none.
        """
        self._believed.visible = pose is not None
        if pose is None:
            return
        _place(self._believed, pose, self._units)
        size = min(HALO * deviation, LARGEST_HALO) if math.isfinite(deviation) else 0.0
        if abs(size - self._halo_size) > 0.1 * max(self._halo_size, 5e-4):
            self._halo_size = size
            self._halo.vertices = _halo(footprint(self._vertices) * self._units, size * self._units)[0]

    def learn(self, field: MaterialField | None) -> None:
        """Colour the surface by what was learnt; None for nothing."""
        if field is self._drawn:
            return
        self._drawn = field
        levels = np.zeros(len(self._faces), np.int64)
        if field is None:
            self.scale.forget()
        else:
            middles = self._vertices[self._faces].mean(axis=1)
            known = known_share(field, middles) >= LEAST_KNOWN
            stiffness, _ = field.stiffness_at(middles)
            self.scale.include(stiffness[known])
            levels = levels_of(self.scale.edges, stiffness, known)
        if not np.array_equal(levels, self._levels):
            self._levels = levels
            self._paint()

    def sink(self, pose: Sequence[float], point: Sequence[float], normal: Sequence[float], depth: float) -> None:
        """Dent the surface.

        Args:
            pose: Pose of the fixture as rendered.
            point: The proxy in the world [m].
            normal: Outward normal, in the world.
            depth: Depth of the probe [m].
        """
        depth = max(depth, 0.0) if math.isfinite(depth) else 0.0
        motion = RigidMotion.from_numbers(pose)
        x, y, z = motion.apply_back((point[0], point[1], point[2]))
        dent = (x, y, z, depth) if depth > 0.0 else (0.0, 0.0, 0.0, 0.0)
        if max(abs(a - b) for a, b in zip(dent, self._dent, strict=True)) < SMALLEST_CHANGE:
            return
        self._dent, self._normal = dent, motion.rotate_back((normal[0], normal[1], normal[2]))
        vertices, sinking = sunk(self._vertices, (x, y, z), self._normal, depth)
        self._bend(vertices, sinking > SMALLEST_CHANGE)

    def _bend(self, vertices: np.ndarray, sunk: np.ndarray) -> None:
        """Send those parts that are bent, or were."""
        for index, (node, used) in enumerate(self._parts):
            bent = bool(sunk[used].any()) if len(used) else False
            if bent or self._touched[index]:
                node.vertices = (vertices[used] * self._units).astype(np.float32)
            self._touched[index] = bent

    def _paint(self) -> None:
        """Give each colour its triangles."""
        x, y, z, depth = self._dent
        vertices, _ = sunk(self._vertices, (x, y, z), self._normal, depth)
        self._parts = []
        for level, node in enumerate(self._nodes):
            used, triangles = compacted(self._faces[self._levels == level])
            node.visible = len(triangles) > 0
            if len(triangles):
                node.vertices, node.faces = (vertices[used] * self._units).astype(np.float32), triangles
            self._parts.append((node, used))
        self._touched[:] = depth > 0.0

    def _add_board(self, scene: Any) -> None:
        units = self._units
        half = 0.5 * BOARD * units
        slab = _box((-half, -half, -THICKNESS * units), (half, half, 0.0))
        add_body(scene, "/space/fixture/board", slab, (250, 250, 250))
        offset, side = 0.002 * units, MARKER * units
        squares = [
            _box((x, y, 0.0), (x + side, y + side, 0.02))
            for x in (-offset - side, offset)
            for y in (-offset - side, offset)
        ]
        vertices = np.concatenate([square[0] for square in squares])
        faces = np.concatenate([square[1] + 8 * number for number, square in enumerate(squares)])
        add_body(scene, "/space/fixture/markers", (vertices, faces.astype(np.uint32)), INK)
        rim = _ring(footprint(self._vertices) * units)
        scene.add_line_segments("/space/fixture/rim", rim, GREY, thickness=1.5, thickness_units="screen")


def _place(node: Any, pose: Sequence[float], units: float) -> None:
    position = tuple(units * value for value in pose[:3])
    if tuple(node.position) != position:
        node.position = position
    turned = wxyz_of(pose[3:])
    if tuple(node.wxyz) != turned:
        node.wxyz = turned


def _ring(corners: np.ndarray) -> np.ndarray:
    """Lines around corners."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).astype(np.float32)


def _halo(corners: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """A flat band around an outline, as wide as the uncertainty: none within, where it would tint the colours."""
    middle = corners.mean(axis=0)
    way = np.sign(corners - middle) * max(size, 1e-3)
    vertices = np.concatenate([corners + way, corners]).astype(np.float32)
    quads = [(i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4)]
    return vertices, np.array([part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))], np.uint32)


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    vertices = np.array([(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return vertices.astype(np.float32), np.array(faces, np.uint32)

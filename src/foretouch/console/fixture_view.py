"""The virtual fixture in the picture: its board, and the surface with its dent and the colours of what was learnt."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from foretouch.console import surface_shape as shape
from foretouch.console.material_view import add_body
from foretouch.console.stiffness_colours import (
    COLOURS,
    LEAST_KNOWN,
    UNKNOWN,
    StiffnessScale,
    known_share,
    levels_of,
)
from foretouch.console.turning import wxyz_of
from foretouch.models import MaterialField
from foretouch.quantities.colours import CUT, GREY, INK, VERMILLION
from foretouch.quantities.pose import RigidMotion
from foretouch.rendering import Surface

__all__ = ["FixtureView", "footprint"]

THICKNESS = 0.012
"""Of specimen and board as they are drawn [m]."""
SMALLEST_CHANGE = 2e-5
"""Of a dent, that is drawn [m]."""
BOARD, MARKER = 0.060, 0.024
"""Sides of the board and of a marker as they are drawn [m]."""
MARGIN = 0.004
"""The outline stands so far from what it is about [m]."""
HALO = 2.0
"""The halo shows so many standard deviations."""
LARGEST_HALO = 0.02
"""And no more than this [m]."""


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
        self._vertices, self._faces = shape.refined(vertices, faces)
        self._dent, self._normal = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
        self._levels = np.zeros(len(self._faces), np.int64)
        self._touched = np.zeros(len(COLOURS) + 1, bool)
        self._parts: list[tuple[Any, shape.Faces]] = []
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
        if len(shape.boundary(faces)):
            walls, triangles = shape.skirt(self._vertices, self._faces, bottom)
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
        """Put the fixture where the leader renders it: a place [m] and a rotation vector [rad]."""
        _place(self._root, pose, self._units)

    def believe(self, pose: Sequence[float] | None, deviation: float) -> None:
        """Draw where the follower believes it, and how surely.

        Args:
            pose: A place [m] and a rotation vector [rad]; None where nobody has said.
            deviation: Standard deviation of its place [m]; NaN for none.
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
            pose: Of the fixture as rendered.
            point: The proxy in the world [m].
            normal: Outward, in the world.
            depth: Of the probe [m].
        """
        depth = max(depth, 0.0) if math.isfinite(depth) else 0.0
        motion = RigidMotion.from_numbers(pose)
        x, y, z = motion.apply_back((point[0], point[1], point[2]))
        dent = (x, y, z, depth) if depth > 0.0 else (0.0, 0.0, 0.0, 0.0)
        if max(abs(a - b) for a, b in zip(dent, self._dent, strict=True)) < SMALLEST_CHANGE:
            return
        self._dent, self._normal = dent, motion.rotate_back((normal[0], normal[1], normal[2]))
        vertices, sinking = shape.sunk(self._vertices, (x, y, z), self._normal, depth)
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
        vertices, _ = shape.sunk(self._vertices, (x, y, z), self._normal, depth)
        self._parts = []
        for level, node in enumerate(self._nodes):
            used, triangles = shape.compacted(self._faces[self._levels == level])
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


def footprint(vertices: np.ndarray) -> np.ndarray:
    """Corners of a rectangle about board and specimen, in the fixture's frame [m], shape (4, 3)."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    left, right = min(float(low[0]), -0.5 * BOARD) - MARGIN, max(float(high[0]), 0.5 * BOARD) + MARGIN
    near, far = min(float(low[1]), -0.5 * BOARD) - MARGIN, max(float(high[1]), 0.5 * BOARD) + MARGIN
    return np.array([(left, near, 0.0), (right, near, 0.0), (right, far, 0.0), (left, far, 0.0)])


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
    """A flat band around an outline, as wide as the doubt: none within, where it would tint what the colours say."""
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

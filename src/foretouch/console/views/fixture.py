"""The virtual fixture in the picture: its board, and its surface with its dent and the colours of what was learnt."""

from __future__ import annotations

import html
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.console.history import Array
from foretouch.console.panels.space import BOARD, MARKER, TIP_RADIUS, footprint
from foretouch.console.views.shapes import Faces, add_body, boundary, compacted, refined, sinking, skirt, wxyz_of
from foretouch.models import FIELD_DEPTH, MaterialField
from foretouch.quantities.colours import CUT, GREY, INK, VERMILLION, Colour, css
from foretouch.quantities.pose import RigidMotion
from foretouch.rendering import Surface

COLOURS: tuple[Colour, ...] = (
    (253, 231, 157), (247, 196, 108), (232, 155, 84), (205, 113, 79), (165, 78, 77), (116, 53, 71), (66, 30, 54)
)  # fmt: skip
"""From soft to stiff: lightness alone tells the steps apart, whichever colours an eye sees."""
UNKNOWN: Colour = (190, 190, 190)
"""Where nothing was learnt."""
LEAST_KNOWN = 0.5
"""Weight of learnt nodes in the law of a point from which its stiffness counts as known."""
STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""A step is one of these times a power of ten."""
SMALLEST, LARGEST = 1.0, 1e7
"""Steps stay within these [N/m]."""
LEAST_SHARE = 0.05
"""Least step as a fraction of the scale's stiff end: less is noise, and one material has few colours."""
CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
WIDE = np.int64(1 << 20)


class StiffnessScale:
    """Round numbers at equal steps. It grows when more is learnt and does not shrink, so that colours keep.

    Attributes:
        edges: Between the steps [N/m], one more than there are colours; empty before anything was learnt.
    """

    def __init__(self) -> None:
        self.edges: Array = np.empty(0)

    def include(self, stiffness: Array) -> bool:
        """Let the scale hold what was learnt [N/m]; whether it has changed."""
        if not len(stiffness):
            return False
        low, high = (float(value) for value in np.percentile(stiffness, (2.0, 98.0)))
        if len(self.edges):
            low, high = min(low, float(self.edges[0])), max(high, float(self.edges[-1]))
        edges = _round_edges(low, high)
        if np.array_equal(edges, self.edges):
            return False
        self.edges = edges
        return True

    def forget(self) -> None:
        """Another material: the scale begins anew."""
        self.edges = np.empty(0)


def levels_of(edges: Array, stiffness: Array, known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The step of each point, shape (n,): 0 where nothing was learnt, then 1 for the softest."""
    if not len(edges):
        return np.zeros(len(stiffness), np.int64)
    step = np.clip(np.searchsorted(edges, stiffness, side="right"), 1, len(edges) - 1)
    return np.where(known, step, 0).astype(np.int64)


def known_share(field: MaterialField, points: Array) -> Array:
    """Weight of the learnt nodes in the law at each point of the fixture's frame [m], shape (n, 3)."""
    if not len(field):
        return np.zeros(len(points))
    lattice = points / field.spacing
    base = np.floor(lattice).astype(np.int64)
    within = lattice - base
    codes = _codes(field.keys.astype(np.int64))
    share = np.zeros(len(points))
    for corner in CORNERS:
        weight = np.prod(np.where(corner == 1, within, 1.0 - within), axis=1)
        share += weight * np.isin(_codes(base + corner), codes)
    return share


def legend_html(edges: Array) -> str:
    """What the colours of the surface mean."""
    grey = f'{_swatch(css(UNKNOWN))}<td style="padding-left:6px">nothing learnt yet</td>'
    rows = [f"<tr>{grey}</tr>"]
    for colour, (low, high) in zip(COLOURS, itertools.pairwise(edges.tolist()), strict=False):
        rows.append(f'<tr>{_swatch(css(colour))}<td style="padding-left:6px">{low:,.0f} to {high:,.0f}</td></tr>')
    rows.reverse()
    title = html.escape(f"Local stiffness at {FIELD_DEPTH * 1e3:.0f} mm [N/m]")
    return f'<b>{title}</b><table style="border-spacing:0;line-height:1.25">{"".join(rows)}</table>'


def _swatch(colour: str) -> str:
    return f'<td><div style="width:26px;height:14px;background:{colour};border:1px solid #555"></div></td>'


def _codes(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    return (keys[:, 0] * WIDE + keys[:, 1]) * WIDE + keys[:, 2]


def _round_edges(low: float, high: float) -> Array:
    """Round numbers at equal steps, the smallest that reach from one stiffness to another."""
    count = len(COLOURS)
    least = min(max((high - low) / count, LEAST_SHARE * high, SMALLEST), LARGEST)
    power = 10.0 ** math.floor(math.log10(least))
    for step in (power * factor for factor in (*STEPS, *(10.0 * factor for factor in STEPS))):
        first = step * math.floor(low / step)
        last = first + count * step
        if last >= high and step >= LEAST_SHARE * last:
            break
    return np.asarray(first + step * np.arange(count + 1), dtype=np.float64)


NARROW, REACH = 2.5e-3, 16e-3
"""Width of a shallow dent, and where every dent ends [m]."""


def sunk(vertices: Array, point: Sequence[float], normal: Sequence[float], depth: float) -> tuple[Array, Array]:
    """Vertices under a probe, and by how much each has sunk along the normal: see `shapes.sinking`.

    Args:
        vertices: [m], shape (n, 3).
        point: The proxy [m].
        normal: Outward, of length 1.
        depth: d [m]; nothing sinks where it is not positive.
    """
    if not depth > 0.0:
        return vertices, np.zeros(len(vertices))
    square = ((vertices - np.asarray(point)) ** 2).sum(axis=1)
    sunken = sinking(square, depth, NARROW, REACH, TIP_RADIUS)
    return vertices - sunken[:, None] * np.asarray(normal), sunken


THICKNESS = 0.012
"""Thickness of specimen and board as they are drawn [m]."""
SMALLEST_CHANGE = 2e-5
"""Smallest change of a dent that is drawn [m]."""
HALO = 2.0
"""Number of standard deviations that the halo shows."""
LARGEST_HALO = 0.02
"""The halo is no larger than this [m]."""


class FixtureView:
    """Board and specimen where the leader renders them, and an outline where the follower believes them."""

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
        scene.add_line_segments(
            "/space/believed/outline", _ring(rim), VERMILLION, thickness=2.0, thickness_units="screen"
        )
        self._halo = add_body(scene, "/space/believed/halo", _halo(rim, 0.0), VERMILLION, opacity=0.18)
        self._halo_size = 0.0
        self._paint()

    def place(self, pose: Sequence[float]) -> None:
        """Put the fixture where the leader renders it: a position [m] and a rotation vector [rad]."""
        _place(self._root, pose, self._units)

    def believe(self, pose: Sequence[float] | None, deviation: float) -> None:
        """Draw the follower's estimate of its pose [m, rad], None where unknown, with the position's deviation [m]."""
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
        """Dent the rendered surface at the proxy [m], along the outward normal, both in the world, to a depth [m]."""
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

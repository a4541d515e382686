"""Meshes of the scene, and the colours of a surface by what was learnt of it.

Bodies of revolution are in scene units; what is done with the triangles of any surface follows. Turns are quaternions
as the viewer writes them, with the real part first.
"""

from __future__ import annotations

import html
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.console.history import Array
from foretouch.models import FIELD_DEPTH
from foretouch.quantities.colours import BLUE, GREEN, GREY, INK, VERMILLION, Colour, css
from foretouch.quantities.pose import Vector
from foretouch.robot import Tip

Mesh = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""Vertices (V, 3) [scene units] and triangles (F, 3)."""
Faces = NDArray[np.int64]
Quaternion = tuple[float, float, float, float]

TIP_RADIUS = 0.45
POINT = Tip.of(0.0, TIP_RADIUS)
NECK = math.sin(0.8 * math.pi)  # Width of the ball of a point where its rod begins, over its own
HANDLE_HEIGHT = 4.6  # Height of the middle of the handle above the tip of a point [scene units]


def lathe(profile: list[tuple[float, float]], segments: int = 24) -> Mesh:
    """Body of revolution about z, of radii and heights [scene units] from the bottom up; radii of 0 close the ends."""
    angle = np.linspace(0.0, 2.0 * math.pi, segments, endpoint=False)
    radius, height = np.array(profile).T[:, :, None]
    rings = np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), height)
    faces = grid(len(profile), segments + 1)[:, ::-1]  # seen from outside
    ring, spoke = np.divmod(faces, segments + 1)
    vertices = np.stack(rings, axis=-1).reshape(-1, 3).astype(np.float32)
    return vertices, (ring * segments + spoke % segments).astype(np.uint32)


def grid(rows: int, columns: int) -> NDArray[np.uint32]:
    """Triangles over a grid of vertices in row order."""
    first = (columns * np.arange(rows - 1)[:, None] + np.arange(columns - 1)).reshape(-1, 1, 1)
    triangles: NDArray[np.int64] = first + np.array([(0, columns, columns + 1), (0, columns + 1, 1)])
    return triangles.reshape(-1, 3).astype(np.uint32)


def triangles_of(quads: ArrayLike) -> NDArray[np.uint32]:
    """Two triangles for each quad, given by its corners in turn."""
    corners: NDArray[np.uint32] = np.asarray(quads, np.uint32)
    triangles = np.stack([corners[:, :3], corners[:, [0, 2, 3]]], axis=1)
    return triangles.reshape(-1, 3)


def probe(tip: Tip = POINT, growth: float = 0.0) -> Mesh:
    """The ball of a probe at the origin and the rod above it; `growth` [scene units] makes a shell around it."""
    radius, centre = tip
    neck = math.pi - math.asin(NECK * min(TIP_RADIUS / radius, 1.0))  # where the ball ends [rad]
    ball = [
        (math.sin(a) * (radius + growth), centre - math.cos(a) * (radius + growth))
        for a in np.linspace(0.0, neck, max(14, round(7.0 * radius)))
    ]
    rod, end = 0.2 * min(radius / TIP_RADIUS, 1.0) + growth, rod_end(tip)
    return lathe(
        [*ball, (rod, centre - math.cos(neck) * radius + 0.15), (rod, end), (0.0, end)], 24 + round(6.0 * radius)
    )


def rod_end(tip: Tip) -> float:
    """Height of the rod's end above the probe's position [scene units]: all rods stand out of their balls alike."""
    return HANDLE_HEIGHT + tip.centre + tip.radius - 2.0 * TIP_RADIUS


def handle() -> Mesh:
    """A double arrow about the origin: what can be pulled up and pushed down."""
    neck, width, cone, end = 0.42, 0.95, 0.45, 1.25
    half = [(neck, 0.0), (neck, cone), (width, cone), (0.0, end)]
    return lathe([(r, -z) for r, z in reversed(half[1:])] + half, segments=32)


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


RING = lathe([(0.75, 0.0), (0.9, 0.0), (0.9, 0.12), (0.75, 0.12), (0.75, 0.0)], 32)
"""A thin collar around the rod, its lower rim at the origin: where the hand is."""
DOWNWARDS = lathe([(0.0, 0.0), (0.5, 0.7), (0.2, 0.7), (0.2, 1.9), (0.0, 1.9)], 20)
"""An arrow, its end at the origin: which way to pull."""


def rail(bottom: float, top: float) -> Mesh:
    """Flat strip behind the handle, between two heights of its middle [scene units]."""
    x, y, low, high = 1.15, 0.0, bottom - 1.3, top + 1.3
    vertices = np.array([(-x, y, low), (x, y, low), (x, y, high), (-x, y, high)], np.float32)
    return vertices, triangles_of([(0, 1, 2, 3)])


def sinking(square: Array, depth: float, width: float, reach: float, tip: float) -> Array:
    r"""How far a surface sinks under a tip at a depth, all in one unit of length.

    .. math:: u(r) = d \left(1 + r^2 / w^2\right)^{-3/2} \left(1 - r^2 / W^2\right)^2, \quad w^2 = w_0^2 + 3 d R

    at distances r from the tip, whose radius is R, with the width w_0 of a shallow dent and the reach W of every dent.
    It follows the tip; it is a picture, not a solution.
    """
    edge = np.maximum(1.0 - square / reach**2, 0.0) ** 2
    sunk: Array = depth * edge * (1.0 + square / (width**2 + 3.0 * depth * tip)) ** -1.5
    return sunk


def add_body(scene: Any, name: str, mesh: Mesh, colour: Colour, opacity: float | None = None, **look: Any) -> Any:
    """One coloured mesh of the scene; `look` says how else it is to look, in the viewer's own words."""
    look = {"side": "double", "material": "toon5"} | look
    return scene.add_mesh_simple(name, *mesh, color=colour, opacity=opacity, **look)


def wxyz_of(vector: Sequence[float]) -> Quaternion:
    """The turn by a rotation vector [rad]."""
    angle = math.hypot(*vector)
    x, y, z = ((0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle) * float(value) for value in vector)
    return math.cos(0.5 * angle), x, y, z


def along(direction: Sequence[float]) -> Quaternion:
    """The shortest turn from the z axis into a direction; none where it has no length."""
    length = math.hypot(*direction)
    if not 0.0 < length < math.inf:
        return 1.0, 0.0, 0.0, 0.0
    x, y, z = (float(value) / length for value in direction)
    if z < -1.0 + 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    w = math.sqrt(0.5 * (1.0 + z))
    return w, -0.5 * y / w, 0.5 * x / w, 0.0


LONGEST_EDGE, MOST_TRIANGLES = 4e-3, 6000
"""Triangles are divided until no edge is longer [m], or there would be more of them."""


def refined(vertices: Array, faces: Faces) -> tuple[Array, Faces]:
    """Divide triangles [m] into four each, until they are fine enough to be bent; join them where they are too many."""
    from trimesh.remesh import subdivide  # the viewer needs it, too

    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    if len(faces) > MOST_TRIANGLES:
        return thinned(vertices, faces, MOST_TRIANGLES)
    while 4 * len(faces) <= MOST_TRIANGLES and _longest_edge(vertices[faces]) > LONGEST_EDGE:
        vertices, faces = subdivide(vertices, faces)
    return vertices, faces


def thinned(vertices: Array, faces: Faces, most: int) -> tuple[Array, Faces]:
    """Fewer triangles: vertices in one cube become one, in cubes as large as it takes (vertex clustering).

    Rossignac and Borrel (1993), Multi-resolution 3D approximations for rendering complex scenes, in Modeling in
    Computer Graphics, Springer. A browser is sent what is drawn 30 times a second; what is felt is the whole mesh.
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


def box(low: Vector, high: Vector) -> Mesh:
    """A box between two corners."""
    corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, 8).T
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners.astype(np.float32), triangles_of(quads)


def band(corners: Array, size: float) -> Mesh:
    """A flat band around an outline, of a width: none within, where it would tint the colours."""
    way = np.sign(corners - corners.mean(axis=0)) * max(size, 1e-3)
    quads = [(i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4)]
    return np.concatenate([corners + way, corners]).astype(np.float32), triangles_of(quads)


def boundary(faces: Faces) -> Faces:
    """Edges of one triangle alone, shape (k, 2): none where the surface is closed."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    alone: Faces = edges[np.sort(first[count == 1])]
    return alone


def skirt(vertices: Array, faces: Faces, bottom: float) -> Mesh:
    """Walls from a surface's rim down to a height [m]; None of them where it is closed."""
    rim = boundary(faces)
    low, high = vertices[rim].copy(), vertices[rim]
    low[..., 2] = bottom
    walls = np.concatenate([high, low], axis=1).reshape(-1, 3).astype(np.float32)
    corners = 4 * np.arange(len(rim))[:, None] + (0, 1, 3, 2)
    return walls, triangles_of(corners)


def compacted(faces: Faces) -> tuple[Faces, NDArray[np.uint32]]:
    """The vertices of some triangles, and the triangles over these alone."""
    used, index = np.unique(faces, return_inverse=True)
    return used, index.reshape(-1, 3).astype(np.uint32)


def _longest_edge(corners: Array) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


COLOURS: tuple[Colour, ...] = (
    (253, 231, 157), (247, 196, 108), (232, 155, 84), (205, 113, 79), (165, 78, 77), (116, 53, 71), (66, 30, 54)
)  # fmt: skip
"""From soft to stiff: lightness alone tells the steps apart, whichever colours an eye sees."""
UNKNOWN: Colour = (190, 190, 190)  # Colour of regions where no law was learnt
STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)  # A step is one of these times a power of ten
SMALLEST, LARGEST = 1.0, 1e7
"""Steps stay within these [N/m]."""
LEAST_SHARE = 0.05  # Least step as a fraction of the scale's stiff end: less is noise, and one material has few colours


def scale_edges(edges: Array, stiffness: Array) -> Array:
    """Round numbers at equal steps from 0 up [N/m], one more than there are colours, for what was learnt and these.

    Since a scale grows when more is learnt and does not shrink, colours keep; it has no edges before anything was.
    """
    if not len(stiffness):
        return edges
    low, high = np.maximum(np.percentile(stiffness, (2.0, 98.0)), 0.0).tolist()  # less is what a young law says
    if len(edges):
        low, high = min(low, float(edges[0])), max(high, float(edges[-1]))
    count = len(COLOURS)
    least = min(max((high - low) / count, LEAST_SHARE * high, SMALLEST), LARGEST)
    power = 10.0 ** math.floor(math.log10(least))
    for step in (power * factor for factor in (*STEPS, *(10.0 * factor for factor in STEPS))):
        first = step * math.floor(low / step)
        last = first + count * step
        if last >= high and step >= LEAST_SHARE * last:
            break
    return np.asarray(first + step * np.arange(count + 1), dtype=np.float64)


def levels_of(edges: Array, stiffness: Array, known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The step of each point, shape (n,): 0 where nothing was learnt, then 1 for the softest."""
    if not len(edges):
        return np.zeros(len(stiffness), np.int64)
    step = np.clip(np.searchsorted(edges, stiffness, side="right"), 1, len(edges) - 1)
    return np.where(known, step, 0).astype(np.int64)


LINES = (
    (GREY, "Probe, now: where your hand is"),
    (VERMILLION, "Robot, delayed; outline: the fixture as the robot knows it"),
    (BLUE, "Force on the hand, and its uncertainty"),
    (GREEN, "Normal of the surface"),
    (INK, "Ribbon: stiffness predicted ahead, wider where less sure"),
)
"""Legend of the lines and arrows of the picture."""
ARM_DELAYED, ARM_NOW = (236, 205, 182), (150, 160, 172)
"""Colours of an arm as its operator hears of it, and where it is now: pale, since map and probes are read."""
ARMS = ((ARM_DELAYED, "Arm, delayed"), (ARM_NOW, "Arm, now"))


def legend_html(edges: Array, *, arm: bool = False) -> str:
    """Legend of the colours of the surface, of the lines and of an arm, in a box over the picture."""
    steps = [f"{low:,.0f} to {high:,.0f}" for low, high in itertools.pairwise(edges.tolist())]
    cells = [
        f'<tr><td><div style="width:26px;height:14px;background:{css(colour)};border:1px solid #555"></div></td>'
        f'<td style="padding-left:6px">{text}</td></tr>'
        for colour, text in zip((UNKNOWN, *COLOURS), ("nothing learnt yet", *steps), strict=False)
    ]
    lines = [
        f'<div><span style="color:{css(colour)}">&#9632;</span> {html.escape(text)}</div>'
        for colour, text in (*LINES, *(ARMS if arm else ()))
    ]
    title = html.escape(f"Local stiffness at {FIELD_DEPTH * 1e3:.0f} mm [N/m]")
    return (
        "<div><style>@media (max-width:36em){.foretouch-legend{display:none}}</style></div>"  # it would hide the scene
        '<div class="foretouch-legend" style="position:fixed;left:12px;top:84px;z-index:50;pointer-events:none;'
        "background:rgba(255,255,255,0.9);"
        'color:#000;border:1px solid #999;border-radius:6px;padding:6px 10px;font-size:13px">'
        f'<b>{title}</b><table style="border-spacing:0;line-height:1.25">{"".join(cells[::-1])}</table>'
        f'<div style="padding-top:5px;line-height:1.3">{"".join(lines)}</div></div>'
    )

"""Scenes: the shape that both sides know, and the properties of a simulated one; also the file of a mesh."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import Keyframe
from foretouch.errors import InputError, UnknownNameError
from foretouch.models import FRICTIONS, BristleFriction
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import (
    HeightField,
    OffsetSurface,
    Plane,
    Surface,
    SurfaceProxy,
    TriangleMesh,
    first_hit_from_above,
    read_mesh,
)
from foretouch.rendering.surfaces.learnt import LearntSurface
from foretouch.settings import MESH_ENDINGS, SCENES, UNKNOWN, Declared

SMALLEST_SIDE, LARGEST_SIDE = 0.005, 0.5
"""Seen from above a specimen is at least and at most as wide as this [m]: others are in another unit."""

REACH = 0.04  # Largest distance of a mesh's middle, seen from above, and of its top from where specimens stand [m]

TRIED = (0.0, -0.25, 0.25)
"""Offsets tried for the hand's descent on a mesh, as fractions of its sides: the middle may be a hole."""

Array = NDArray[np.float64]


def specimen_of(path: Path, middle: Vector) -> TriangleMesh:
    """Read the mesh that a scene is touched on; an open sheet that faces down is turned.

    Args:
        path: File of the mesh: STL, OBJ or PLY, in metres.
        middle: Position of specimens in the fixture's frame [m].

    Raises:
        InputError: No such file, no mesh, or one that no hand can touch there: too small, too large, elsewhere, or
            with nothing that faces up.
        MissingExtraError: The package that reads meshes is not installed.
    """
    mesh = read_mesh(path)
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    wide, across, _ = (high - low).tolist()
    if not SMALLEST_SIDE <= min(wide, across) <= max(wide, across) <= LARGEST_SIDE:
        raise InputError(
            f"{path}: seen from above it is {wide:.3g} m by {across:.3g} m, but each side has to be "
            f"{SMALLEST_SIDE:g} to {LARGEST_SIDE:g} m: give it in metres (scale by 0.001 what is in millimetres)"
        )
    (x, y, _), top = (0.5 * (low + high)).tolist(), float(high[2])
    if max(abs(x - middle[0]), abs(y - middle[1]), abs(top - middle[2])) > REACH:
        raise InputError(
            f"{path}: it stands about ({x:.3g}, {y:.3g}) m with its top at {top:.3g} m, beyond the hand's reach: "
            f"move it to within {REACH:g} m of {middle} in the fixture's frame"
        )
    if _is_met(mesh, low, high):
        return mesh
    turned = None if mesh.closed else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
    if turned is None or not _is_met(turned, low, high):
        turn, close = "turn it so that its surface faces up (+z)", "close its holes about the middle"
        mended = f"{turn}, or {close}" if mesh.closed else f"{close}, or touch more of what it is a map of"
        raise InputError(f"{path}: who comes down on it touches nothing: {mended}")
    return turned


def _is_met(mesh: TriangleMesh, low: Array, high: Array) -> bool:
    """Whether a probe that comes down somewhere about the middle touches a side that faces up."""
    centre, sides = 0.5 * (low + high), high - low
    for right, back in itertools.product(TRIED, TRIED):
        hit = first_hit_from_above(mesh, float(centre[0] + right * sides[0]), float(centre[1] + back * sides[1]))
        a, b, c = mesh.vertices[mesh.faces[hit]]
        if hit >= 0 and np.cross(b - a, c - a)[2] > 0.0:
            return True
    return False


MIDDLE: Vector = (0.075, 0.0, 0.0)
"""Centre of the specimen, in the fixture's frame [m]; the origin is in the middle of the board."""

SIDE = 0.08  # Of the specimen [m]

NOMINAL = (-0.075, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Pose of the fixture where nobody has moved it: the specimen is above the world's origin."""

HILL_HEIGHT, HILL_WIDTH = 0.004, 0.018
GRID = 2e-3

HOVER, TALL = 0.010, 0.05
"""Height of the hand above the surface between presses, and from which the first one begins [m]."""

AWAY, DOWN = 0.7, 0.3
"""Time in which a hand that presses as measured goes to its next place, and down to where the motion begins [s]."""

SPECIMEN = "phantom"  # What stands there without a shape, where nothing else is said

FROM_ABOVE, STEP_DOWN = 0.1, 5e-4
"""Step of a probe that looks for the surface from above [m]."""


@dataclass(frozen=True, slots=True)
class Inclusion:
    r"""A stiff disc under a soft surface.

    .. math:: s(r) = 1 + (s_0 - 1) \left(1 - S\left(\frac{r - R + w}{2 w}\right)\right), \quad w = R / 4

    times the force of what is around it; S is the smooth step 3 u^2 - 2 u^3 of u within 0 and 1.

    Attributes:
        middle: In the fixture's frame [m].
        radius: R [m].
        ratio: s_0.
    """

    middle: Vector
    radius: float
    ratio: float

    def factor(self, point: Vector) -> float:
        """S at a point of the fixture's frame."""
        width = 0.25 * self.radius
        away = math.hypot(point[0] - self.middle[0], point[1] - self.middle[1])
        u = min(max((away - self.radius + width) / (2.0 * width), 0.0), 1.0)
        return 1.0 + (self.ratio - 1.0) * (1.0 - u * u * (3.0 - 2.0 * u))


@dataclass(frozen=True, slots=True)
class Scene:
    """Scene that is touched.

    Attributes:
        name: Name or file.
        surface: Its shape, in the fixture's frame; offset where the probe is a sphere.
        inclusion: Stiffer part of a simulated scene; None for none.
        friction: Friction of a simulated scene.
        nominal: Pose of the fixture as both sides believe it before anything is seen.
    """

    name: str
    surface: Surface
    inclusion: Inclusion | None = None
    friction: BristleFriction = field(default_factory=BristleFriction)
    nominal: tuple[float, ...] = NOMINAL

    def told_by(self, fusion: str) -> str:
        """What the pose of its fixture is estimated from: touches of a shape that nobody knows do not tell it."""
        return "image" if self.name == UNKNOWN and fusion == "full" else fusion


class KnownSurface:
    """A scene's surface as the fixture's filter asks for it; `relief` is its extent along its mean normal [m]."""

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self.relief = surface.relief()[1]

    def height(self, point: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Height of a point above the surface [m] and the outward normal there."""
        contact = self._surface.contact(point.tolist())
        return -contact.depth, np.array(contact.normal)

    def holds(self, point: NDArray[np.float64]) -> bool:
        """Whether a touch there can be one of the specimen: near enough to its middle."""
        return math.hypot(point[0] - MIDDLE[0], point[1] - MIDDLE[1]) <= SIDE


def _hilly() -> HeightField:
    count = round(SIDE / GRID) + 1
    along = GRID * np.arange(count) - 0.5 * SIDE
    x, y = np.meshgrid(along, along, indexing="ij")
    heights = HILL_HEIGHT * np.exp(-(x**2 + y**2) / (2.0 * HILL_WIDTH**2))
    return HeightField(heights, GRID, (MIDDLE[0] - 0.5 * SIDE, MIDDLE[1] - 0.5 * SIDE))


def make_scene(name: str, probe_radius: float = 0.0, friction: str = "dry") -> Scene:
    """A scene by name, or from the file of a mesh, as a probe feels it.

    Args:
        name: One of `SCENES`, or a path that ends as `MESH_ENDINGS` say: the mesh stands on the fixture as it is, in
            metres; its middle and its top are within 4 cm of (0.075, 0, 0).
        probe_radius: Radius of the sphere whose centre is the place of hand and robot [m]; 0 for a point.
        friction: One of `foretouch.models.FRICTIONS`.

    Raises:
        SettingError: A radius that is negative or not finite.
        UnknownNameError: Neither.
        InputError: A file that cannot be read as a mesh, or one that no hand can touch where it is.
        MissingExtraError: The package that reads meshes is not installed.
    """
    scene = replace(_touched_by_a_point(name), friction=FRICTIONS[friction])
    return replace(scene, surface=OffsetSurface(scene.surface, probe_radius)) if probe_radius else scene


def make_specimen(settings: Declared) -> Scene:
    """What stands on the simulated fixture of a session: its scene, or what is there in place of one without a shape.

    Only the simulated world, the hand that follows a script over it as an operator who sees it, and the report's truth
    are made of it.

    Raises:
        ForetouchError: See `make_scene`.
    """
    unknown = settings.scene == UNKNOWN
    there = (settings.specimen or SPECIMEN) if unknown else settings.scene
    return make_scene(there, settings.probe_radius, settings.friction)


def _touched_by_a_point(name: str) -> Scene:
    x, y, z = MIDDLE
    match name:
        case "plane":
            return Scene(name, Plane(MIDDLE, (0.0, 0.0, 1.0), SIDE))
        case "hill":
            return Scene(name, _hilly())
        case "phantom":
            return Scene(name, _hilly(), Inclusion((x + 0.010, y - 0.008, z), 0.012, 4.0))
        case _ if name == UNKNOWN:
            return Scene(name, LearntSurface())
    if name.lower().endswith(MESH_ENDINGS):
        return Scene(name, specimen_of(Path(name), MIDDLE))
    raise UnknownNameError("scene", name, (*SCENES, *(f"FILE{ending}" for ending in MESH_ENDINGS)))


class _Path:
    """Path of a hand over a scene, which begins where the simulated arm is and comes down to the first corner."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._x, self._y, self.reach = _middle(scene.surface)
        self.keyframes: list[Keyframe] = [(0.0, (MIDDLE[0], MIDDLE[1], TALL))]
        reach = self.reach
        self.corners = (-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)
        self.rows = np.linspace(-reach, reach, 7).tolist()
        self.go(2.5, *self.corners[0], HOVER)  # a robot that knows no surface comes slowly
        self.go(1.0, *self.corners[0], HOVER)

    def go(self, seconds: float, right: float, back: float, height: float) -> None:
        """Go on to a height above the surface [m], at a place relative to the middle [m]."""
        place = _above(self._scene, self._x + right, self._y + back, height)
        self.keyframes.append((self.keyframes[-1][0] + seconds, place))
        self._surface = place[2] - height

    def play(self, heights: Sequence[float], period: float) -> None:
        """Go through heights above the surface [m], one a period [s], where the hand is."""
        time, (x, y, _) = self.keyframes[-1]
        self.keyframes += [
            (time + period * number, (x, y, self._surface + height)) for number, height in enumerate(heights, 1)
        ]


def palpation(scene: Scene, depth: float, seed: int) -> list[Keyframe]:
    """Path of a palpating hand at this depth [m]: presses at the corners, then rows of presses that slide on."""
    random = np.random.default_rng(seed)
    path = _Path(scene)
    path.go(1.5, *path.corners[0], -0.5 * depth)
    path.go(0.5, *path.corners[0], HOVER)
    for right, back in path.corners:
        deep = depth * random.uniform(0.7, 1.0)
        for seconds, height in ((0.5, HOVER), (0.5, -deep), (0.25, -deep * 0.98), (0.4, HOVER)):
            path.go(seconds, right, back, height)
    rows = path.rows
    for number, back in enumerate(rows):
        ways = rows if number % 2 == 0 else rows[::-1]
        deep = depth * random.uniform(0.6, 1.0)
        path.go(0.5, ways[0], back, HOVER)
        path.go(0.5, ways[0], back, -deep)
        for before, way in itertools.pairwise(ways):
            for part in (0.5, 1.0):  # so that the hand follows the surface
                path.go(0.14, before + part * (way - before), back, -deep)
        path.go(0.4, ways[-1], back, HOVER)
    path.go(0.8, *path.corners[0], HOVER)
    return path.keyframes


def recorded_palpation(scene: Scene, heights: Sequence[float], period: float) -> list[Keyframe]:
    """Path of measured presses at the corners and where the rows begin, one after the other.

    A hand that is highest between two presses goes on to the next place before it goes on as measured.

    Args:
        scene: Scene that is touched.
        heights: Loop of the measured motion, as heights above the surface [m], negative inside, from the highest on.
        period: Time between two of them [s].
    """
    path = _Path(scene)
    places = [*path.corners, *((path.rows[0], back) for back in path.rows[1:-1])]
    apart = itertools.groupby(range(len(heights)), lambda number: heights[number] > 0.0)
    tops = [max(numbers, key=heights.__getitem__) for free, numbers in apart if free]
    presses = [heights[top : end + 1] for top, end in itertools.pairwise(tops)]
    for (right, back), press in zip(itertools.cycle(places), presses * math.ceil(len(places) / len(presses))):
        path.go(AWAY, right, back, HOVER)
        path.go(DOWN, right, back, press[0])
        path.play(press[1:], period)
        path.go(DOWN, right, back, HOVER)
    path.go(AWAY, *path.corners[0], HOVER)
    return path.keyframes


def _middle(surface: Surface) -> tuple[float, float, float]:
    """Middle of the drawn surface, and the reach of palpation about it, 30 % of its shorter side [m]."""
    vertices, _ = surface.outline()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    x, y, _ = (0.5 * (low + high)).tolist()
    return x, y, 0.3 * float((high - low)[:2].min())


def _above(scene: Scene, x: float, y: float, height: float) -> Vector:
    """A place where a probe straight over a place of the fixture is so high above the surface, or below it [m]."""
    proxy, radius = SurfaceProxy(scene.surface), scene.surface.radius
    for step in range(round(2.0 * FROM_ABOVE / STEP_DOWN)):  # a probe that comes down, until it is inside
        z = FROM_ABOVE - STEP_DOWN * step
        contact = proxy.follow((x, y, z))
        if contact.depth > 0.0:
            return x, y, contact.point[2] + radius * contact.normal[2] + height
    return x, y, MIDDLE[2] + radius + height  # nothing is below: as if the specimen were flat

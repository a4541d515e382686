"""A tick of a position that is followed against a surface on a fixture, compiled.

What it keeps is one record, and the surface's shape a `Mesh`, in which a plane has no triangles.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import Numbers3, Triangle, add, dot, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.god_object import MESH, NO_MESH, Mesh, Proxy, move
from foretouch.rendering.surfaces.mesh import HeightField, TriangleMesh
from foretouch.rendering.surfaces.offset import OffsetSurface
from foretouch.rendering.surfaces.surface import FARTHEST, Plane, Surface

ROUNDING = 1e-9  # Change of depth beyond the motion that is rounding [m]
NO_LENGTH = 1e-9  # Length below which a difference of two positions has no direction [m]

START: Vector = (0.0, 0.0, 0.1)  # Position in the fixture's frame in place of a first one without numbers [m]


class Closest(Record):
    """Closest point of the surface to a position, as a `ClosestPoint` in the world's frame; and that position.

    Of a sphere the position is the centre, the depth that of its deepest point, and the closest point the touched one.
    """

    depth: float  # d [m]
    along: float  # q [m]
    normal: Numbers3
    point: Numbers3  # [m]
    inner_point: Numbers3  # the same in the fixture's frame [m]
    place: Numbers3 = math.nan  # type: ignore[assignment]  # the position [m]; NaN before the first


class Line(Record):
    r"""State of a line: :math:`q = d + o`, as `foretouch.session.spatial.course.SurfaceLine` says.

    A plane through p with normal n is in the fixture's frame, as the proxy is; the fixture's pose maps
    points y of that frame to R y + t. The proxy is of the centre of a sphere of radius r, so that the depth d is r
    more than its own.
    """

    rotation: Annotated[NDArray[np.float64], float, (3, 3)]  # R
    translation: Numbers3  # t [m]
    origin: Numbers3  # p [m]
    normal: Numbers3  # n
    proxy: Proxy
    closest: Closest
    radius: float  # r [m], 0 for a point
    offset: float  # o [m]
    leads: bool  # whether the offset is its own
    compiled: bool  # whether compiled code knows the shape; else Python moves the proxy


def shape_of(surface: Surface) -> Mesh | None:
    """What compiled code walks on; None for a surface whose `follow` is Python of its own.

    A sphere's radius is no part of it, but of a `Line`.
    """
    match surface:
        case OffsetSurface():
            return shape_of(surface.bare)
        case Plane() if type(surface).follow is Plane.follow:
            return NO_MESH
        case TriangleMesh() if type(surface).follow is TriangleMesh.follow:
            return surface.shape
        case HeightField() if type(surface).follow is HeightField.follow:
            return surface.mesh.shape
    return None


@compiled
def rotate(line: Line, v: Vector) -> Vector:
    """R v: a direction of the fixture, seen from outside."""
    return dot(vector(line.rotation[0]), v), dot(vector(line.rotation[1]), v), dot(vector(line.rotation[2]), v)


@compiled
def rotate_back(line: Line, v: Vector) -> Vector:
    """R^T v: a direction from outside, in the fixture."""
    (a, b, c), (d, e, f) = vector(line.rotation[0]), vector(line.rotation[1])
    (g, h, i), (x, y, z) = vector(line.rotation[2]), v
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


@compiled
def is_known(line: Line) -> bool:
    """Whether it has followed a position."""
    return not math.isnan(line.closest.place[0])


@compiled
def _touch(line: Line, mesh: Mesh, inner: Vector) -> None:
    """Move the proxy after a position in the fixture's frame [m]; one beyond 1 km changes nothing."""
    x, y, z = inner
    if not (-FARTHEST <= x <= FARTHEST and -FARTHEST <= y <= FARTHEST and -FARTHEST <= z <= FARTHEST):
        return
    if mesh.triangles.shape[0] > 0:
        move(mesh, line.proxy, inner)
        return
    normal = vector(line.normal)
    depth = dot(subtract(vector(line.origin), inner), normal)
    line.proxy.depth = depth
    write(line.proxy.normal, normal)
    write(line.proxy.point, add(inner, scaled(normal, depth)))


@compiled(error_model="numpy")
def follow_line(line: Line, mesh: Mesh, x: float, y: float, z: float) -> None:
    """Follow a position [m]; one that is not finite is left out. See `Line.closest` for what it comes to."""
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        if is_known(line):
            return
        x, y, z = add(rotate(line, START), vector(line.translation))
    place, closest, proxy = (x, y, z), line.closest, line.proxy
    if line.compiled:
        _touch(line, mesh, rotate_back(line, subtract(place, vector(line.translation))))
    inner, depth = vector(proxy.point), float(proxy.depth)
    point, normal = add(rotate(line, inner), vector(line.translation)), rotate(line, vector(proxy.normal))
    if depth < 0.0:  # of the centre, which is outside of a surface that the sphere touches
        away = subtract(place, point)
        length = norm(away)
        normal = scaled(away, 1.0 / length) if length > NO_LENGTH else normal
    depth += line.radius
    # Before the first position this is NaN, and nothing is larger.
    moved = norm(subtract(place, vector(closest.place)))
    if line.leads and abs(depth - closest.depth) > moved + ROUNDING:
        line.offset += closest.depth - depth
    closest.depth, closest.along = depth, depth + line.offset
    write(closest.normal, normal)
    write(closest.point, point)
    write(closest.inner_point, inner)
    write(closest.place, place)


@compiled
def place_at(line: Line, along: float) -> Vector:
    """The place of the probe on the normal of the closest point with another coordinate [m]; of a sphere's centre."""
    closest = line.closest
    depth = along - closest.along + closest.depth
    return subtract(vector(closest.point), scaled(vector(closest.normal), depth - line.radius))


@compiled
def just_touching(line: Line) -> Vector:
    """Where the probe's centre would be if it just touched the closest point [m]; for a point, that itself.

    A sphere that does not roll slides as fast as this moves; over a crease the closest point itself stands or leaps.
    """
    return add(vector(line.closest.point), scaled(vector(line.closest.normal), line.radius))


@compiled
def just_touching_within(line: Line) -> Vector:
    """The same in the fixture's frame [m]."""
    return add(vector(line.closest.inner_point), scaled(vector(line.proxy.normal), line.radius))


PLACE_AT = Kernel(place_at, "(Line, f8)")


@kernel(f"void(Line[::1], {MESH}, f8, f8, f8)", Triangle)
def follow(lines: NDArray[np.void], mesh: Mesh, x: float, y: float, z: float) -> None:
    """`follow_line`, from Python."""
    follow_line(lines[0], mesh, x, y, z)


Places = tuple[Vector, Vector, Vector, Vector]
"""Place of the hand in the world, exact and intended position of the hand itself, NaN where unknown, and how far it is
apart from the world [m]."""

Coordinates = tuple[float, float, float]
"""Coordinates [m] of the hand, NaN where it is unknown, of its exact position and of its intended one."""


@compiled(error_model="numpy")
def _coordinate(line: Line, place: Vector, position: Vector, apart: Vector, scale: float) -> float:
    """Coordinate of another position of the hand along the normal of its closest point [m]; NaN where unknown."""
    if not math.isfinite(position[0]):
        return math.nan
    away = subtract(subtract(scaled(position, scale), apart), place)
    return float((line.closest.along - dot(away, vector(line.closest.normal))) / scale)


@compiled(error_model="numpy")
def arrive(line: Line, mesh: Mesh, places: Places, scale: float, known: bool, somewhere: bool) -> Coordinates:
    """Follow a hand, whose motion is multiplied by a scale, if it is somewhere; its coordinates."""
    place, exact, intended, apart = places
    x, y, z = place if somewhere else (math.nan, math.nan, math.nan)
    follow_line(line, mesh, x, y, z)
    along = line.closest.along / scale if known and math.isfinite(x) else math.nan
    at, meant = _coordinate(line, place, exact, apart, scale), _coordinate(line, place, intended, apart, scale)
    return along, at, meant

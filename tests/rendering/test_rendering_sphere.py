"""A sphere on a surface against SciPy's nearest neighbours on a fine sampling, and what it promises on its way."""

from __future__ import annotations

import functools
import math
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from solids import Array, ball, box, follow, spring_forces, straight, work_of

from foretouch.errors import SettingError
from foretouch.rendering.surfaces import HeightField, OffsetSurface, Plane, Surface, SurfaceProxy
from foretouch.rendering.surfaces.line import follow as follow_line
from foretouch.session.spatial.course import SurfaceLine

SPACING = 2.5e-4
"""Of the points of a sampled surface [m], at most; a nearest one is off by less along it, and by its square over twice
the distance in depth."""

SPHERE = 0.004


@functools.cache
def hill(spacing: float = 1e-3) -> HeightField:
    """That of the scene, of 4 mm height, about the origin."""
    along = np.arange(-0.04, 0.04 + 0.5 * spacing, spacing)
    return HeightField(height_of_hill(*np.meshgrid(along, along, indexing="ij")), spacing, (along[0], along[0]))


def height_of_hill(x: Array, y: Array) -> Array:
    return 0.004 * np.exp(-(x**2 + y**2) / (2.0 * 0.018**2))


def valley(half_angle: float) -> HeightField:
    """Two flat walls that meet in the line x = 0; half the angle between them [rad]."""
    along = 1e-3 * np.arange(-20.0, 21.0)
    return HeightField(np.repeat(np.abs(along)[:, None] / math.tan(half_angle), 41, axis=1), 1e-3, (-0.02, -0.02))


HILL = hill()
BUMPY = HeightField(
    0.004 * np.outer(np.sin(np.linspace(0.0, 7.0, 60)), np.cos(np.linspace(0.0, 5.0, 50))), 2e-3, (-0.059, -0.049)
)
SURFACES: dict[str, Surface] = {
    "plane": Plane((0.0, 0.0, 0.001), (1.0, -2.0, 5.0), 0.2),
    "hill": HILL,
    "bumpy": BUMPY,
    "ball": ball(0.02, 3),
    "box": box(0.04, 0.03, 0.02),
}


def sampled(surface: Surface) -> Array:
    """Points on all triangles of a surface, no further than `SPACING` from the next."""
    vertices, faces = surface.outline()
    parts = []
    for a, b, c in vertices[faces]:
        count = math.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b)) / SPACING) + 1
        u, v = (part.ravel() for part in np.meshgrid(*[np.linspace(0.0, 1.0, count)] * 2))
        within = u + v <= 1.0 + 1e-9
        parts.append(a + np.outer(u[within], b - a) + np.outer(v[within], c - a))
    return np.concatenate(parts)


@pytest.mark.parametrize("name", ["plane", "hill", "bumpy", "ball", "box"])
@pytest.mark.first
def test_depth_point_and_normal_are_those_of_the_nearest_of_many_points(name: str) -> None:
    bare = SURFACES[name]
    if isinstance(bare, Plane):
        bare = Plane(bare.origin, bare.normal, 0.06)
    surface, tree = OffsetSurface(bare, SPHERE), cKDTree(sampled(bare))
    pressed, centres = 0, np.random.default_rng(3).uniform(-0.02, 0.02, (400, 3))
    for centre in centres:
        contact = surface.contact(centre.tolist())
        if contact.depth > SPHERE - 5e-4:
            continue  # the centre is inside, or so near that a sample says no direction
        distance, index = tree.query(centre)
        pressed += contact.depth > 0.0
        nearest = tree.data[index]
        if np.abs(nearest[:2]).max() > 0.029:
            continue  # the drawn plane ends there
        assert contact.depth == pytest.approx(SPHERE - distance, abs=0.5 * SPACING**2 / distance + 1e-12)
        assert contact.depth >= SPHERE - distance - 1e-12  # no point is nearer
        away = centre - np.array(contact.point)
        np.testing.assert_allclose(away / np.linalg.norm(away), contact.normal, atol=1e-9)
        assert np.abs(tree.query(contact.point)[0]) < SPACING
    assert pressed > 5


@pytest.mark.parametrize("along", [0.0, 0.006, 0.012, 0.018, 0.027])
@pytest.mark.parametrize("radius", [0.001, 0.004, 0.02])
@pytest.mark.first
def test_on_the_flank_of_the_hill_it_touches_where_a_minimiser_says(along: float, radius: float) -> None:
    centre = np.array([0.8 * along, 0.6 * along, height_of_hill(np.float64(along), np.float64(0.0)) + 0.8 * radius])

    def squared(place: Array) -> float:
        return 1e6 * float(((np.array([*place, height_of_hill(*place)]) - centre) ** 2).sum())

    found = minimize(squared, centre[:2], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12})
    true = np.array([*found.x, height_of_hill(*found.x)])
    fine = OffsetSurface(hill(2.5e-4), radius).contact(centre.tolist())
    depth = radius - np.linalg.norm(centre - true)
    facets = 0.004 * 2.5e-4**2 / 0.018**2  # A chord leaves the arc by an eighth of its square over the radius
    assert fine.depth == pytest.approx(depth, abs=facets)
    assert np.linalg.norm(np.array(fine.point) - true) < 2.5e-4
    assert np.linalg.norm(np.array(fine.normal) - (centre - true) / np.linalg.norm(centre - true)) < 2e-3 + 2.5e-4 / (
        0.8 * radius
    )
    assert fine.depth >= 0.2 * radius - facets  # the flank is nearer than what is straight below


@pytest.mark.parametrize("half_angle", [0.3, 0.6, 1.0])
def test_in_a_valley_it_rests_on_both_walls_above_the_bottom(half_angle: float) -> None:
    proxy = SurfaceProxy(OffsetSurface(valley(half_angle), SPHERE))
    rests = SPHERE / math.sin(half_angle)  # Height of the centre of a ball that touches both walls
    for height in np.linspace(rests + 2e-3, 0.3 * rests, 50):
        contact = proxy.follow((0.0, 0.0, float(height)))
        assert contact.depth == pytest.approx(SPHERE - height * math.sin(half_angle), abs=1e-12)
        assert abs(contact.normal[0]) == pytest.approx(math.cos(half_angle), abs=1e-9)
    left, right = (proxy.follow((x, 0.0, rests - 1e-3)) for x in (-1e-6, 1e-6))
    assert left.normal[0] > 0.0 > right.normal[0]
    assert left.depth == pytest.approx(right.depth, abs=1e-9)


near = st.floats(-0.03, 0.03)


@pytest.mark.parametrize("name", SURFACES)
@given(path=st.lists(st.tuples(near, near, st.floats(0.0, 0.03)), min_size=2, max_size=6), radius=st.floats(1e-4, 0.02))
def test_outside_depth_changes_by_no_more_than_the_centre_moves(
    name: str, path: list[tuple[float, ...]], radius: float
) -> None:
    contacts, places = [], straight(*path, speed=1.0)
    for contact in follow(OffsetSurface(SURFACES[name], radius), places):
        assert math.hypot(*contact.normal) == pytest.approx(1.0, abs=1e-12)
        contacts.append(contact)
    for (one, other), (start, end) in zip(pairwise(contacts), pairwise(places), strict=True):
        if one.depth < radius and other.depth < radius:
            assert abs(other.depth - one.depth) <= np.linalg.norm(end - start) + 1e-12


@pytest.mark.parametrize("name", ["plane", "hill", "bumpy"])
@given(
    start=st.tuples(near, near), end=st.tuples(near, near), low=st.floats(-0.006, 0.01), radius=st.floats(1e-4, 0.006)
)
def test_depth_is_continuous_while_the_centre_goes_through_the_surface(
    name: str, start: tuple[float, float], end: tuple[float, float], low: float, radius: float
) -> None:
    places = straight((*start, 0.03), (*end, low), (*start, low), (*start, 0.03), speed=0.5)
    depths = np.array([contact.depth for contact in follow(OffsetSurface(SURFACES[name], radius), places)])
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert (np.abs(np.diff(depths)) <= moved + 1e-9).all()


@pytest.mark.parametrize("name", SURFACES)
@given(st.lists(st.tuples(near, near, near), min_size=1, max_size=8))
def test_a_sphere_without_radius_is_a_point(name: str, path: list[tuple[float, ...]]) -> None:
    surface = SURFACES[name]
    np.testing.assert_equal(follow(OffsetSurface(surface, 0.0), np.array(path)), follow(surface, np.array(path)))


def test_a_spring_on_a_sphere_gives_out_no_more_than_was_put_in() -> None:
    random = np.random.default_rng(1)
    corners = [(0.0, 0.0, 0.02), *random.uniform((-0.02, -0.02, -0.002), (0.02, 0.02, 0.008), (30, 3)), (0, 0, 0.02)]
    path = straight(*corners, speed=0.02)
    forces = spring_forces(follow(OffsetSurface(HILL, SPHERE), path))
    assert np.abs(forces).max() > 3.0
    assert work_of(path, forces)[-1] < 1e-6


def test_a_sphere_turns_no_normal_and_is_drawn_as_what_it_touches() -> None:
    surface = OffsetSurface(OffsetSurface(HILL, 0.001), 0.003)
    assert surface.bare is HILL
    assert surface.radius == 0.004
    assert surface.facing() == HILL.facing()
    assert surface.relief() == HILL.relief()
    np.testing.assert_equal(surface.outline(), HILL.outline())


@pytest.mark.long
@pytest.mark.parametrize("nodes", [41, 101, 225])
def test_in_a_cup_that_it_just_fits_the_cost_is_that_of_all_triangles(nodes: int) -> None:
    cup, along = 0.012, np.linspace(-0.02, 0.02, nodes)
    x, y = np.meshgrid(along, along, indexing="ij")
    bare = HeightField(-np.sqrt(np.maximum(cup**2 - x**2 - y**2, 0.0)), along[1] - along[0], (along[0], along[0]))
    line, times = SurfaceLine(OffsetSurface(bare, cup - 1e-4), (0.0,) * 6), []
    for turn in np.linspace(0.0, 6.0, 1000).tolist():
        place = 1e-4 * math.sin(turn), 1e-4 * math.cos(3.0 * turn), -2e-4
        began = time.perf_counter()
        follow_line.entry(line.records, line.shape, *place)
        times.append(time.perf_counter() - began)
        assert line.newest.depth > 0.0
    print(f"{2 * (nodes - 1) ** 2} triangles: {1e3 * np.median(times):.2f} ms")  # noqa: T201


@pytest.mark.parametrize("radius", [-1e-3, math.nan, math.inf])
def test_a_radius_that_is_none_is_refused(radius: float) -> None:
    with pytest.raises(SettingError, match="radius"):
        OffsetSurface(HILL, radius)

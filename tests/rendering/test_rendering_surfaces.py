"""Planes, height fields and meshes against closed forms, trimesh, and what a god object promises."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import Array, ball, box, follow, room, spring_forces, straight, surface_of, work_of

trimesh = pytest.importorskip("trimesh")

from foretouch.errors import SettingError  # noqa: E402
from foretouch.rendering.surfaces import HeightField, Plane, Surface, SurfaceProxy, TriangleMesh  # noqa: E402

BALL = ball()
BOX = box()
ROOM = room()
HILLS = HeightField(
    0.004 * np.outer(np.sin(np.linspace(0.0, 7.0, 60)), np.cos(np.linspace(0.0, 5.0, 50))), 2e-3, (-0.059, -0.049)
)
TWO = surface_of(
    trimesh.util.concatenate(
        [trimesh.creation.box((0.1, 0.1, 0.02)), trimesh.creation.torus(0.04, 0.01).apply_translation((0, 0, 0.05))]
    )
)
SURFACES: dict[str, Surface] = {
    "plane": Plane((0.0, 0.0, 0.01), (1.0, -2.0, 5.0)),
    "ball": BALL,
    "box": BOX,
    "room": ROOM,
    "hills": HILLS,
    "two bodies": TWO,
}
places = st.tuples(*[st.floats(-0.07, 0.07)] * 3)


def test_a_plane_is_a_plane() -> None:
    plane = Plane((0.0, 0.0, 0.01), (0.0, 3.0, 4.0))
    contact = SurfaceProxy(plane).follow((0.2, 0.0, 0.0))
    assert contact.depth == pytest.approx(0.008)
    assert contact.normal == pytest.approx((0.0, 0.6, 0.8))
    assert contact.point == pytest.approx((0.2, 0.0048, 0.0064))
    assert plane.contact((0.0, 0.0, 0.02)).depth == pytest.approx(-0.008)
    vertices, faces = plane.outline()
    offsets = (vertices - np.array(plane.origin)) @ np.array(plane.normal)
    np.testing.assert_allclose(offsets, 0.0, atol=1e-15)
    cross = np.cross(*(vertices[faces[0]][1:] - vertices[faces[0]][0]))
    assert cross @ np.array(plane.normal) > 0.0


@given(st.lists(places, min_size=2, max_size=30))
@settings(max_examples=20)
@pytest.mark.parametrize("name", SURFACES)
def test_the_proxy_is_on_the_surface_and_the_normal_has_length_1(name: str, path: list[tuple[float, ...]]) -> None:
    surface = SURFACES[name]
    proxy = SurfaceProxy(surface)
    vertices, faces = surface.outline()
    for place in path:
        contact = proxy.follow(place)
        assert math.hypot(*contact.normal) == pytest.approx(1.0, abs=1e-12)
        away = np.array(contact.point) - np.array(place)
        assert np.linalg.norm(away) == pytest.approx(abs(contact.depth), abs=1e-12)
        if abs(contact.depth) > 1e-6:
            np.testing.assert_allclose(away, contact.depth * np.array(contact.normal), atol=1e-9)
        if contact.triangle >= 0:
            corners = vertices[faces[contact.triangle]]
            shares, *_ = np.linalg.lstsq(np.vstack([corners.T, np.full(3, 0.05)]), (*contact.point, 0.05), rcond=None)
            assert shares.min() > -1e-9
            np.testing.assert_allclose(shares @ corners, contact.point, atol=1e-12)


@pytest.mark.parametrize("name", ["ball", "box", "room", "two bodies"])
def test_without_history_it_is_the_signed_distance_that_trimesh_finds(name: str) -> None:
    surface = SURFACES[name]
    vertices, faces = surface.outline()
    mesh = trimesh.Trimesh(1000.0 * vertices, faces, process=False)  # its tolerances are of squares of a unit
    points = np.random.default_rng(1).uniform(-0.07, 0.07, (400, 3))
    near, distance, _ = (1e-3 * part for part in trimesh.proximity.closest_point(mesh, 1000.0 * points))
    inside = trimesh.proximity.signed_distance(mesh, 1000.0 * points) > 0.0
    if name == "room":  # trimesh counts what is within the walls by rays, whichever way they face
        inside = np.abs(points).max(axis=1) > 0.05
    result = [surface.contact(point) for point in points]
    np.testing.assert_allclose([c.depth for c in result], np.where(inside, distance, -distance), atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(np.array([c.point for c in result]) - points, axis=1),
        np.linalg.norm(near - points, axis=1),
        atol=1e-12,
    )


@given(st.lists(places, min_size=2, max_size=20))
@settings(max_examples=30)
@pytest.mark.parametrize("name", ["ball", "box"])
def test_a_convex_body_is_felt_wherever_the_probe_is_inside(name: str, path: list[tuple[float, ...]]) -> None:
    surface = SURFACES[name]
    vertices, faces = surface.outline()
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    heights = np.einsum("ij,ij->i", normals, corners[:, 0])
    proxy = SurfaceProxy(surface)
    for place in path:
        contact = proxy.follow(place)
        signed = float(np.max(normals @ np.array(place) - heights))  # exact inside, a lower bound of it outside
        if signed < -1e-9:
            assert contact.depth >= -signed - 1e-12  # never nearer than the nearest side
        elif signed > 1e-9 and contact.depth > 0.0:  # passed through: still below the side that the proxy is on
            assert normals[contact.triangle] @ np.array(place) < heights[contact.triangle]
            assert contact.depth > 0.05


def test_a_ball_of_triangles_is_a_ball() -> None:
    path = straight((0, 0, 0.06), (0, 0, 0.045), (0.045, 0, 0), (0, 0.03, 0.034), (0, 0, 0.06), speed=0.2)
    contacts = follow(BALL, path)
    radii = np.linalg.norm(path, axis=1)
    sagitta = 0.05 - np.min(np.linalg.norm(BALL.vertices[BALL.faces].mean(axis=1), axis=1))
    depth = np.array([c.depth for c in contacts])
    true = 0.05 - radii
    assert (depth > 0.0).mean() > 0.5
    assert np.abs(depth - true).max() < 2.0 * sagitta < 3e-4
    pressed = depth > 1e-3
    along = np.einsum("ij,ij->i", np.array([c.normal for c in contacts]), path / radii[:, None])
    assert along[pressed].min() > math.cos(0.25)
    assert np.median(along[pressed]) > math.cos(0.05)


def test_a_fine_mesh_of_a_plane_is_the_plane() -> None:
    field = HeightField(np.zeros((50, 50)), 2e-3, (-0.049, -0.049))
    plane = Plane()
    random = np.random.default_rng(4)
    path = np.cumsum(random.normal(0.0, 3e-4, (3000, 3)), axis=0) * (1.0, 1.0, 0.4)
    path[:, :2] = 0.04 * np.sin(path[:, :2] / 0.04)
    contacts = follow(field, path)
    for place, contact in zip(path.tolist(), contacts, strict=True):
        expected = plane.contact(place)
        assert contact.depth == pytest.approx(expected.depth, abs=1e-12)
        assert contact.point == pytest.approx(expected.point, abs=1e-9)
        assert contact.normal == pytest.approx(expected.normal, abs=1e-5)


# --- edges, corners, plates ------------------------------------------------------------------------------------------


def test_a_probe_that_has_pressed_past_the_middle_still_feels_the_side_it_came_from() -> None:
    contacts = follow(BOX, straight((0, 0, 0.06), (0, 0, -0.045), (0.03, 0.02, -0.045)))
    assert contacts[-1].depth == pytest.approx(0.095)
    assert contacts[-1].normal == pytest.approx((0.0, 0.0, 1.0))
    assert BOX.contact((0.03, 0.02, -0.045)).normal == pytest.approx((0.0, 0.0, -1.0))  # who has no history


@pytest.mark.parametrize("speed", [0.01, 1.0, 100.0])
def test_a_thin_plate_is_not_passed(speed: float) -> None:
    plate = box(0.1, 0.1, 1e-4)
    path = straight((0.01, 0.02, 0.02), (0.01, 0.02, -0.02), (-0.02, 0.0, -0.03), (0.0, 0.0, 0.01), speed=speed)
    contacts = follow(plate, path)
    for place, contact in zip(path.tolist(), contacts, strict=True):
        assert contact.depth == pytest.approx(5e-5 - place[2], abs=1e-12)
        assert contact.normal[2] == pytest.approx(1.0)


def test_a_probe_leaves_over_an_edge() -> None:
    path = straight((0, 0, 0.06), (0, 0, 0.047), (0.06, 0, 0.047), (0.06, 0, 0.0), (0.04, 0, 0.0))
    contacts = follow(BOX, path)
    inside = np.abs(path).max(axis=1) < 0.05 - 1e-9
    outside = np.abs(path).max(axis=1) > 0.05 + 1e-9
    depth = np.array([c.depth for c in contacts])
    assert (depth[inside] > 0.0).all()
    assert (depth[outside] <= 0.0).all()
    assert contacts[-1].normal == pytest.approx((1.0, 0.0, 0.0))  # it came back in through the side
    assert contacts[-1].depth == pytest.approx(0.01)


def test_a_corner_cut_in_one_tick_is_no_contact() -> None:
    proxy = SurfaceProxy(BOX)
    proxy.follow((0.045, 0.0, 0.055))
    assert proxy.follow((0.055, 0.0, 0.045)).depth < 0.0
    assert proxy.follow((0.045, 0.0, 0.0)).normal == pytest.approx((1.0, 0.0, 0.0))


def test_out_of_one_body_and_into_another_in_one_tick() -> None:
    mesh = trimesh.util.concatenate(
        [trimesh.creation.box((0.02, 0.02, 0.02)).apply_translation((x, 0, 0)) for x in (-0.02, 0.02)]
    )
    proxy = SurfaceProxy(surface_of(mesh))
    proxy.follow((-0.02, 0.0, 0.02))
    assert proxy.follow((-0.011, 0.0, 0.009)).depth == pytest.approx(1e-3)
    contact = proxy.follow((0.015, 0.0, 0.005))
    assert contact.depth == pytest.approx(5e-3)
    assert contact.normal == pytest.approx((-1.0, 0.0, 0.0))


def test_a_concave_corner_holds_the_proxy_by_three_planes() -> None:
    path = straight((0, 0, 0), (0.06, 0.0, 0.0), (0.06, 0.07, 0.0), (0.06, 0.07, 0.08), (0.03, 0.07, 0.08))
    contacts = follow(ROOM, path)
    for place, contact in zip(path, contacts, strict=True):
        held = np.clip(place, -0.05, 0.05)
        if np.abs(place).max() > 0.05:
            np.testing.assert_allclose(contact.point, held, atol=1e-12)
            assert contact.depth == pytest.approx(float(np.linalg.norm(place - held)))


def test_a_groove_is_felt_on_both_sides() -> None:
    """A V of 90 degrees: in its bottom two planes hold the proxy."""
    x = np.arange(-20, 21) * 1e-3
    groove = HeightField(np.abs(x)[:, None] * np.ones(41), 1e-3, (-0.02, -0.02))
    contacts = follow(groove, straight((0.0, 0.003, 0.01), (0.0, 0.003, -0.004), (0.001, 0.006, -0.004)))
    assert contacts[-1].point == pytest.approx((0.0, 0.006, 0.0), abs=1e-12)
    assert contacts[-1].depth == pytest.approx(math.hypot(0.001, 0.004))


def test_an_open_sheet_is_felt_from_its_outward_side_only() -> None:
    sheet = HeightField(np.zeros((11, 11)), 0.01, (-0.05, -0.05))
    below = follow(sheet, straight((0.0, 0.0, -0.01), (0.0, 0.0, 0.01), (0.0, 0.0, -0.005)))
    assert SurfaceProxy(sheet).follow((0.0, 0.0, -0.01)).depth == pytest.approx(0.01)  # who begins there is inside
    assert below[-1].depth == pytest.approx(0.005)
    round_the_border = straight((0.08, 0.0, 0.01), (0.08, 0.0, -0.01), (0.0, 0.0, -0.01), (0.0, 0.0, 0.01))
    assert all(contact.depth <= 0.0 for contact in follow(sheet, round_the_border))
    out = follow(sheet, straight((0.0, 0.0, 0.01), (0.0, 0.0, -0.01), (0.06, 0.0, -0.01), (0.0, 0.0, -0.01)))
    assert out[300].depth > 0.0
    assert out[-1].depth <= 0.0


def test_a_place_that_is_no_number_changes_nothing() -> None:
    proxy = SurfaceProxy(BOX)
    assert proxy.follow((math.nan, 0.0, 0.0)).depth == -math.inf
    proxy.follow((0.0, 0.0, 0.06))
    before = proxy.follow((0.0, 0.0, 0.04))
    for bad in (math.nan, math.inf, -math.inf, 1e200):
        assert proxy.follow((0.0, bad, 0.0)) == before
    assert proxy.follow((0.0, 0.0, -0.04)).normal == pytest.approx((0.0, 0.0, 1.0))
    proxy.restart()
    assert proxy.follow((0.0, 0.0, -0.04)).normal == pytest.approx((0.0, 0.0, -1.0))


def test_a_proxy_with_too_far_to_go_stays_in_contact_and_comes_after() -> None:
    """A very fine field, and a probe that goes 50 mm in one tick: 500 triangles and more."""
    fine = HeightField(np.zeros((1001, 11)), 1e-4, (-0.05, -0.0005))
    proxy = SurfaceProxy(fine)
    proxy.follow((-0.04, 0.0, 0.001))
    proxy.follow((-0.04, 0.0, -0.001))
    seen = [proxy.follow((0.04, 0.0, -0.001)) for _ in range(20)]
    assert all(contact.depth > 0.0 for contact in seen)
    assert seen[0].depth > 0.02  # not there yet
    depths = [contact.depth for contact in seen]
    assert depths == sorted(depths, reverse=True)
    assert seen[-1].depth == pytest.approx(0.001)


# --- energy ----------------------------------------------------------------------------------------------------------


def wander(seed: int, size: float, steps: int = 4000) -> Array:
    """A smooth closed path, through the same places again and again, 20 um a step at most."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0 * np.pi, steps * 10)
    waves = np.arange(1, 5)[:, None]
    amplitude, phase = random.normal(0.0, 1.0, (3, 4, 1)), random.uniform(0.0, 2.0 * np.pi, (3, 4, 1))
    path = (amplitude * np.sin(waves * t + phase)).sum(axis=1).T
    path[-1] = path[0]
    return size * path / np.abs(path).max()


@pytest.mark.parametrize(
    "name",
    [
        name if name in ("room", "hills", "two bodies") else pytest.param(name, marks=pytest.mark.long)
        for name in SURFACES
    ],
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_a_spring_makes_no_energy_over_edges(name: str, seed: int) -> None:
    """What the hand gets back of a linear spring is never more than it put in, but for the slices of the integral."""
    path = wander(seed, 0.06)
    surface = SURFACES[name]
    contacts = follow(surface, path)
    stored = np.array([500.0 * max(c.depth, 0.0) ** 2 for c in contacts])
    work = work_of(path, spring_forces(contacts))
    rounding = 1e-3 * float(stored.max())
    assert (stored > 1e-4).mean() > 0.04
    assert (work + stored[1:] - stored[0]).max() < rounding  # given back and still stored: at most what was put in


# --- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (np.zeros((3, 2)), [(0, 1, 2)], "shape"),
        (np.eye(3), [(0, 1)], "shape"),
        (np.eye(3), np.zeros((0, 3)), "one triangle"),
        (np.eye(3) * np.nan, [(0, 1, 2)], "finite"),
        (np.eye(3) * 1000.0, [(0, 1, 2)], "scale"),
        (np.eye(3), [(0, 1, 3)], "indices"),
        (np.eye(3), [(0, 1, 1)], "no area"),
        (np.eye(4, 3), [(0, 1, 2), (0, 1, 3)], "wound against"),
        (np.vstack([np.eye(4, 3), (1, 1, 1)]), [(0, 1, 2), (1, 0, 3), (0, 1, 4)], "more than two"),
    ],
)
def test_what_is_no_surface_is_refused_in_one_line(vertices: Array, faces: Array, said: str) -> None:
    with pytest.raises(SettingError, match=said) as error:
        TriangleMesh(vertices, faces)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Plane(normal=(0.0, 0.0, 0.0)),
        lambda: Plane(origin=(math.inf, 0.0, 0.0)),
        lambda: Plane(size=0.0),
        lambda: HeightField(np.zeros((1, 5)), 1e-3),
        lambda: HeightField(np.full((3, 3), np.nan), 1e-3),
        lambda: HeightField(np.zeros((3, 3)), 0.0),
    ],
)
def test_a_plane_or_field_that_is_none_is_refused(make: object) -> None:
    with pytest.raises(SettingError):
        make()  # type: ignore[operator]

"""A probe that is a sphere, in what the world, the follower and the leader make of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from foretouch.cli.commands.sides import _operator
from foretouch.errors import LinkError, SettingError
from foretouch.messages import SessionLog
from foretouch.quantities.pose import RigidMotion
from foretouch.rendering.surfaces import SurfaceProxy
from foretouch.rendering.surfaces.line import PLACE_AT, just_touching, just_touching_within
from foretouch.robot import make_material
from foretouch.session import SessionSettings, simulate
from foretouch.session.spatial import make_scene
from foretouch.session.spatial.course import SurfaceLine
from foretouch.session.spatial.making import SpatialWorld
from foretouch.session.spatial.scenes import MIDDLE, NOMINAL, KnownSurface, _above

RADIUS, MS = 0.004, 1e-3
STILL = {"fusion": "none", "displacement": 0.0, "turn": 0.0}
FIXTURE = RigidMotion.from_numbers(NOMINAL)


def points_of_hill() -> NDArray[np.float64]:
    """Points of the scene's hill, 0.25 mm apart, in the fixture's frame."""
    surface = make_scene("hill").surface
    vertices, faces = surface.outline()
    u, v = (part.ravel() for part in np.meshgrid(*[np.linspace(0.0, 1.0, 9)] * 2))
    within = u + v <= 1.0
    a, b, c = (vertices[faces[:, corner]][:, None] for corner in range(3))
    u, v = u[within][None, :, None], v[within][None, :, None]
    return (a + u * (b - a) + v * (c - a)).reshape(-1, 3)


@pytest.fixture(scope="module")
def pressed() -> SessionLog:
    return simulate(SessionSettings(scene="hill", probe_radius=RADIUS, **STILL), duration=16.0).log


def places(rows: Any, prefix: str) -> NDArray[np.float64]:
    return np.stack([rows[f"{prefix}_{axis}"] for axis in "xyz"], axis=1)


@pytest.mark.long
def test_the_follower_knows_the_overlap_that_the_nearest_of_many_points_says(pressed: SessionLog) -> None:
    rows = pressed.follower_space
    centres, depth = places(rows, "place") - NOMINAL[:3], rows["depth"]
    distance, index = (tree := cKDTree(points_of_hill())).query(centres)
    outside = (depth > 0.0) & (depth < RADIUS - 1e-3)  # of the centre, whose distance counts
    assert outside.sum() > 500
    np.testing.assert_allclose(depth[outside], RADIUS - distance[outside], atol=0.5 * 2.5e-4**2 / 1e-3)
    away = (centres - tree.data[index])[outside] / distance[outside, None]
    assert np.abs(away - places(rows, "normal")[outside]).max() < 0.25
    assert depth.max() > RADIUS  # the centre went through the surface too
    assert np.abs(np.diff(depth)).max() < 2e-4


def test_the_force_is_the_laws_at_that_overlap_and_the_leader_predicts_it(pressed: SessionLog) -> None:
    rows, law = pressed.rows(), make_material("hunt-crossley").model
    depth = pressed.follower_space["depth"]
    held = (depth > 1e-3) & (np.abs(np.gradient(depth, MS)) < 2e-3)
    forces = [law.advance(law.initial_state(), float(x), 0.0, MS)[1] for x in depth[held]]
    assert held.sum() > 200
    np.testing.assert_allclose(pressed.follower["exact_force"][held], forces, rtol=0.2)
    felt = rows.follower["in_contact"] & (rows.follower["time_ns"] > 9e9)
    true = rows.follower["exact_force"][felt]

    def error(name: str) -> float:
        return float(np.sqrt(((rows.leader[name][felt] - true) ** 2).mean() / (true**2).mean()))

    assert error("predicted_force") < 0.45
    assert error("predicted_force") < 0.75 * error("delayed_force")
    newest = next(model for model in reversed(pressed.models) if model.valid)
    assert abs(newest.surface) < 1e-3  # it is felt where the sphere touches, and not its radius above


def test_the_leader_touches_the_surface_one_radius_from_its_hand(pressed: SessionLog) -> None:
    rows = pressed.leader_space
    free = (rows["depth"] < 0.0) & np.isfinite(rows["hand_x"])
    points, hands = places(rows, "point"), places(rows, "hand")
    assert cKDTree(points_of_hill()).query(points[free] - NOMINAL[:3])[0].max() < 2e-4
    away = np.linalg.norm(hands - points, axis=1)
    newest = next(model for model in reversed(pressed.models) if model.valid)
    np.testing.assert_allclose(away[free] - RADIUS, -rows["depth"][free], atol=2.0 * abs(newest.surface) + 1e-3)


@pytest.mark.parametrize("scene", ["plane", "hill"])
def test_world_follower_and_tracker_agree_on_every_place(scene: str) -> None:
    touched, random = make_scene(scene, RADIUS), np.random.default_rng(2)
    material = make_material("kelvin-voigt")
    world = SpatialWorld(touched, material, displacement=0.0, turn=0.0, bump=0.0, seed=0)
    line, known, proxy = (
        SurfaceLine(touched.surface, NOMINAL),
        KnownSurface(touched.surface),
        SurfaceProxy(touched.surface),
    )
    for x, y, height in random.uniform((-0.02, -0.02, -0.004), (0.02, 0.02, 0.003), (60, 3)).tolist():
        for high in (0.02, height):
            above = _above(touched, MIDDLE[0] + x, MIDDLE[1] + y, high)
            place = FIXTURE.apply(above)
            force, closest = world.touch(place, (0.0, 0.0, 0.0), MS), line.follow(place)
            assert world.depth == pytest.approx(closest.depth, abs=1e-12)
            assert proxy.follow(above).depth == pytest.approx(closest.depth, abs=1e-12)
            np.testing.assert_allclose(proxy.newest.point, closest.inner_point, atol=1e-12)
            if closest.depth < RADIUS:  # else the centre is inside, where contact has a history
                assert known.height(np.array(above))[0] == pytest.approx(-closest.depth, abs=1e-12)
            size = material.model.advance((), closest.depth, 0.0, MS)[1]
            np.testing.assert_allclose(force, size * np.array(closest.normal), atol=1e-9)


@pytest.mark.parametrize("height", [0.02, 0.001, -0.001, -0.0045])
def test_the_place_on_the_normal_is_that_of_the_centre(height: float) -> None:
    scene = make_scene("hill", RADIUS)
    line = SurfaceLine(scene.surface, NOMINAL)
    place = FIXTURE.apply(_above(scene, MIDDLE[0] + 0.012, MIDDLE[1] + 0.006, height))
    closest = line.follow(place)
    np.testing.assert_allclose(PLACE_AT.entry(line.records[0], closest.along), place, atol=1e-12)
    resting = PLACE_AT.entry(line.records[0], line.offset)
    assert SurfaceLine(scene.surface, NOMINAL).follow(resting).depth == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(just_touching.py_func(line.records[0]), resting, atol=1e-12)
    np.testing.assert_allclose(FIXTURE.apply(just_touching_within.py_func(line.records[0])), resting, atol=1e-12)


@pytest.mark.parametrize(("radius", "largest"), [(0.0, 0.01), (0.004, 0.03), (0.02, 0.1)])
@pytest.mark.first
def test_the_force_of_a_phantom_leaps_little_where_the_touched_facet_is_another(radius: float, largest: float) -> None:
    scene, leaps = make_scene("phantom", radius), []
    for x in np.linspace(-0.02, 0.03, 11).tolist():
        world = SpatialWorld(scene, make_material("kelvin-voigt"), displacement=0.0, turn=0.0, bump=0.0, seed=0)
        sizes = []
        for y in np.arange(-0.025, 0.017, 1.4e-5).tolist():
            height = radius - 0.003 + 0.004 * math.exp(-(x * x + y * y) / (2.0 * 0.018**2))
            sizes.append(np.linalg.norm(world.touch((x, y, height), (0.0, 0.0, 0.0), MS)))
        leaps.append((np.abs(np.diff(sizes[1:])) / sizes[2:]).max())
    print(f"radius {1e3 * radius:g} mm: the force leaps by {100.0 * max(leaps):.1f} % at most")  # noqa: T201
    assert max(leaps) < largest  # the normal turns at an edge, and the sphere's deepest point with it


@pytest.mark.parametrize("radius", [-1e-6, 0.0201, math.nan])
def test_a_radius_out_of_range_is_refused(radius: float) -> None:
    with pytest.raises(SettingError, match="probe_radius"):
        SessionSettings(scene="hill", probe_radius=radius)


def test_a_leader_with_another_probe_than_the_followers_is_refused() -> None:
    settings = SessionSettings(scene="hill", probe_radius=RADIUS)
    assert settings.as_text()["probe_radius"] == "0.004"
    assert _operator(settings, settings.as_text()) is not None
    whole = SessionSettings(scene="hill", probe_radius=0)  # said as "0", and by another follower as "0.0" or not at all
    for point in (whole.as_text(), SessionSettings(scene="hill").as_text(), {"scene": "hill"}):
        assert _operator(whole, point) is not None
    for said in ({"scene": "hill"}, *({"scene": "hill", "probe_radius": text} for text in ("0.006", "nan", "large"))):
        with pytest.raises(LinkError, match="radius"):
            _operator(settings, said)

"""The view of a session in three dimensions where something is missing: a shape, a camera, a library."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from foretouch.console import Console
from foretouch.console.panels.figures import numbers_html
from foretouch.console.panels.space import NO_IMAGE, can_draw, missing_image
from foretouch.console.plots import number
from foretouch.console.views import shapes as shape
from foretouch.console.views.hold import HOME
from foretouch.console.views.probes import ANCHORS, UNITS
from foretouch.console.views.shapes import scale_edges
from foretouch.console.watched import Watched
from foretouch.errors import install_command
from foretouch.messages import (
    VERSION,
    CameraImage,
    FieldUpdate,
    FollowerSpace,
    Hello,
    LeaderSpace,
    LeaderState,
    Telemetry,
)
from foretouch.models import ShapeField
from foretouch.models.scale_field import packed
from foretouch.models.shape_field import packed_shape
from foretouch.session.spatial import make_scene

pytest.importorskip("viser")


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Console]:
    made = Console(0, lambda message: None, recordings=tmp_path)
    yield made
    made.close()


def say(console: Console, scene: str, **settings: str) -> None:
    """A leader in a scene, at the origin."""
    texts = {"operator": "browser", "scene": scene, **settings}
    console.watch(Hello(VERSION, 1, 1, "leader", tuple(texts), tuple(texts.values())))
    line = (VERSION, 1, 1_000_000, 0.0, 0.0, 0.0, 0.0, 0.0, 1, 0, math.nan, False, 1, 1)
    console.watch(LeaderState(*line, space=LeaderSpace(*(0.0,) * 28)))


def draw(console: Console, pictures: int = 4) -> None:
    """Some pictures: more than one of each kind."""
    left = [pictures]

    def should_stop() -> bool:
        left[0] -= 1
        return left[0] < 0

    console.run(should_stop)
    time.sleep(0.1)


def shown(console: Console) -> str:
    """All that stands in the panel."""
    handles = console._server.gui._gui_input_handle_from_uuid.values()
    return " ".join(str(getattr(handle, "content", "")) for handle in (*handles, console._panel.forces._text))


def test_a_shape_that_is_not_here_is_said_and_no_other_is_drawn(console: Console) -> None:
    say(console, "hill")
    draw(console)
    assert console._space._scene is not None
    say(console, "only-there.stl")
    draw(console)
    assert console._space._scene is None
    text = shown(console)
    assert "The scene cannot be drawn here: only-there.stl: no such file" in text
    assert not console._line._root.visible  # nor that of a session along a line
    say(console, "plane")
    draw(console)
    assert console._space._scene is not None
    assert "cannot be drawn" not in shown(console)


def test_keys_move_no_hand_while_a_recording_along_a_line_is_looked_at(console: Console) -> None:
    moved: list[tuple[float, ...]] = []
    say(console, "plane")
    draw(console)
    console._space.hold.stroke = lambda way: moved.append(way)  # type: ignore[method-assign]
    console._space._key_stroke((1e-3, 0.0, 0.0))
    assert len(moved) == 1
    console._draw_scene(Watched(), live=True)
    assert console._line._root.visible
    assert not console._space._scene.root.visible
    console._space._key_stroke((1e-3, 0.0, 0.0))
    assert len(moved) == 1


def test_a_broken_opencv_ends_nothing(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)  # as where it is installed without a library that it needs
    assert not can_draw()
    say(console, "plane")
    line = (VERSION, 1000, 1_000_000, 0, *(0.0,) * 6, False, False, 0, 1, 1)
    console.watch(Telemetry(*line, space=FollowerSpace(*(0.0,) * 19)))
    console.watch(CameraImage(VERSION, 1, 1, 0, b"no image", (), (), 0, "", (0.0,) * 15))
    console.watch(msgspec.structs.replace(state(console), telemetry_sequence=1000))
    draw(console)
    console._space._image.toggle_overlay()
    draw(console)
    assert console._space._image._over.disabled
    assert escape(install_command("vision")) in console._space._image._text.content


def state(console: Console) -> LeaderState:
    leader = console._watched.leader
    assert leader is not None
    return leader


def test_why_there_is_no_image_is_one_sentence() -> None:
    line = "camera: no camera image can be drawn: apt-get install libegl1; the session goes on without it"
    assert missing_image({"camera": "there is none", "camera_missing": line}) == f"C{line[1:]}."
    assert missing_image({"camera": "there is one", "camera_missing": "", "fusion": "full"}) == NO_IMAGE
    for fusion in ("contact", "none"):
        assert f"--fusion {fusion}" in missing_image({"fusion": fusion, "camera": "there is none"})
    assert missing_image({}) == NO_IMAGE


def test_labels_stand_on_the_outer_sides(console: Console) -> None:
    say(console, "plane")
    draw(console)
    scene = console._space._scene
    assert scene is not None
    for probe, robot, left in ((0.0, 0.01, True), (0.0, -0.01, False), (0.0, 0.0005, False), (0.0, math.nan, False)):
        position = {"place_x": robot, "place_y": 0.0, "place_z": 0.0}
        felt = SimpleNamespace(**position, force_x=0.0, force_y=0.0, force_z=1.0)
        scene.draw_probes((probe, 0.0, 0.0), (0.0, 0.0, 1.0), math.nan, felt)  # type: ignore[arg-type]
        shown = scene.probes
        assert tuple(label.anchor for label in shown.labels) == (ANCHORS if left else ANCHORS[::-1])
        assert (shown.labels[0].position[0] < shown.probe.position[0]) == left
        assert (shown.labels[1].position[0] > shown.robot.position[0]) == left


def test_what_is_ahead_is_a_row_in_a_scene_alone(console: Console) -> None:
    say(console, "plane")
    draw(console)
    assert "Ahead 10 mm" in shown(console)
    console._draw_scene(Watched(), live=True)
    assert console._picture.ahead is None


def test_a_sphere_is_drawn_as_a_sphere_about_the_hand(console: Console) -> None:
    lowest = []
    for radius in ("0.004", "0", "0.02", "nonsense", "-1"):
        say(console, "plane", probe_radius=radius)
        draw(console)
        scene = console._space._scene
        assert scene is not None
        robot, probe = (np.asarray(node.vertices) for node in (scene.probes.robot, scene.probes.probe))
        assert robot[:, 2].min() == pytest.approx(probe[:, 2].min() - 0.12, abs=1e-5)
        lowest.append(probe[:, 2].min() / UNITS)
    assert lowest == pytest.approx([-0.004, 0.0, -0.02, 0.0, 0.0], abs=1e-7)


def test_a_surface_whose_shape_is_learnt_is_drawn_as_high_as_it_is_known(console: Console) -> None:
    say(console, "unknown")
    console.watch(Telemetry(VERSION, 1, 1, 0, *(0.0,) * 6, False, False, 0, 1, 1, space=FollowerSpace(*(0.0,) * 19)))
    console.watch(msgspec.structs.replace(state(console), telemetry_sequence=1))
    draw(console)
    scene = console._space._scene
    assert scene is not None
    node = scene.fixture._nodes[0]  # of what is touched nowhere
    assert np.ptp(node.vertices[:, 2]) == 0.0
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(8, 12), np.arange(8, 12)))
    news = packed_shape(i, j, np.full(i.size, 0.004), np.full(i.size, 1e-4))
    for sequence, content in enumerate((news, b"no shape", news), 1):
        console.watch(FieldUpdate(VERSION, sequence, 1, packed([1], [1], [0.0], [0.01]), shape=content))
    draw(console)
    known = ShapeField()
    known.take(news)
    vertices = np.asarray(node.vertices) / UNITS
    assert vertices[:, 2].max() > 3e-3
    np.testing.assert_allclose(vertices[:, 2], known.heights_at(vertices)[0], atol=1e-6)
    top = vertices[vertices[:, 2].argmax()]
    assert scene.fixture.raised(np.array([(*top[:2], 0.0)]))[0] == pytest.approx(top, abs=1e-6)
    say(console, "plane")
    draw(console)
    assert console._space._scene is not scene


def test_the_handle_of_a_sphere_is_above_it_and_moves_the_hand_alike(console: Console) -> None:
    say(console, "plane", probe_radius="0.02")
    draw(console)
    scene = console._space._scene
    assert scene is not None
    assert scene._handle.position[2] / UNITS == pytest.approx(HOME[2] + 0.02)
    hold, dragged = console._space.hold, []
    hold.drag_to = lambda position, phase: dragged.append(position)  # type: ignore[method-assign]
    asyncio.run(scene._dragged(SimpleNamespace(target=scene._handle, phase="update")))
    assert dragged == [pytest.approx(HOME)]


def test_nothing_is_not_negative(console: Console) -> None:
    assert number(-0.001, "N") == "0.00 N"
    assert number(-0.006, "N") == "-0.01 N"
    assert number(-2e6, "N") == "over -1000000 N"
    say(console, "plane")
    watched = console._watched
    console.watch(msgspec.structs.replace(state(console), delayed_force=-1e-4))
    assert "-0.00" not in numbers_html(watched, watched.window(6.0), None, depth=-1e-4, status="", warnings=())


@pytest.mark.parametrize(("low", "high"), [(344.0, 400.0), (1.0, 1.0), (4990.0, 5010.0), (300.0, 1750.0)])
def test_one_material_has_few_colours_and_the_scale_rests(low: float, high: float) -> None:
    stiffness = np.linspace(low, high, 60)
    edges = scale_edges(np.empty(0), stiffness)
    assert edges[1] - edges[0] >= 0.05 * edges[-1] * (1.0 - 1e-9)
    for again in (stiffness, stiffness[::-1]):
        np.testing.assert_array_equal(scale_edges(edges, again), edges)


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 2e-3 * np.sin(150.0 * x) * np.cos(150.0 * y)


@pytest.mark.parametrize("height", [lambda x, y: 0.0 * x, waves])
def test_a_large_mesh_is_drawn_with_fewer_triangles(height: Callable[[Any, Any], Any]) -> None:
    along = np.linspace(-0.04, 0.04, 151)
    x, y = np.meshgrid(along, along, indexing="ij")
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    node = np.arange(151 * 151).reshape(151, 151)
    a, b, c, d = (part.ravel() for part in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    fewer, triangles = shape.refined(vertices, faces)
    assert 0.3 * shape.MOST_TRIANGLES < len(triangles) <= shape.MOST_TRIANGLES
    corners = fewer[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0.0).all()  # wound as they were
    assert np.ptp(fewer, axis=0)[:2] == pytest.approx((0.08, 0.08), abs=3e-3)
    assert np.abs(fewer[:, 2] - height(fewer[:, 0], fewer[:, 1])).max() < 2e-4
    area = 0.5 * np.abs(normals[:, 2]).sum()
    assert area == pytest.approx(0.08**2, rel=0.05)


def test_small_scenes_are_drawn_as_they_are() -> None:
    surface = make_scene("hill").surface
    assert len(surface.outline()[1]) <= shape.MOST_TRIANGLES
    assert len(shape.refined(*surface.outline())[1]) >= len(surface.outline()[1])


def test_the_camera_goes_where_what_is_looked_at_is_seen(console: Console) -> None:
    """Sessions along a line and in space take turns where a recording of the other kind is looked at."""
    from foretouch.console.views.line import CAMERA
    from foretouch.console.views.space import SPACE_CAMERA

    camera = console._server.initial_camera
    for other in (False, True, True, False):
        if other:
            say(console, "plane")
            draw(console)
        else:
            console._draw_scene(Watched(), live=True)
        seen, target = SPACE_CAMERA if other else CAMERA
        assert tuple(camera.position) == pytest.approx(seen)
        assert tuple(camera.look_at) == pytest.approx(target)

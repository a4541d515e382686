"""Sessions in three dimensions in the console: what is shown at a moment, in which colours, and where the hand goes."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from foretouch.console.panels.session import Publisher
from foretouch.console.panels.space import MARKERS, draw_over, pose_sentence
from foretouch.console.playback import Playback
from foretouch.console.space_state import MOST_FIELDS, SpaceState, newest_image
from foretouch.console.views import shapes as shape
from foretouch.console.views.hold import HOME, REACH, SpaceHold
from foretouch.console.views.shapes import COLOURS, along, legend_html, levels_of, scale_edges, wxyz_of
from foretouch.console.views.space import REACH as DENT_ENDS
from foretouch.console.views.space import sunk
from foretouch.console.watched import NOWHERE, Watched
from foretouch.messages import (
    VERSION,
    CameraImage,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    Handle,
    LeaderSpace,
    LeaderState,
    SessionLog,
    Telemetry,
)
from foretouch.models.scale_field import packed
from foretouch.recordings import SessionWriter, read_session
from foretouch.session import SessionSettings
from foretouch.session.runners.simulated import run_session
from foretouch.session.spatial import make_camera, make_scene, make_spatial_operator, make_spatial_robot

pytest.importorskip("mujoco")
FORCE_DELAY, CAMERA_DELAY = 0.2, 0.05
SHORT, LONG = 1.2, 7.5
"""A hand that approaches [s], and one that has pressed, so that something was learnt [s]."""


@functools.cache
def recorded(seconds: float) -> SessionLog:
    """A short session in simulated time, over the plane, with its camera where one can be had."""
    settings = SessionSettings(
        scene="plane", material="hunt-crossley", seed=4, force_delay=FORCE_DELAY, camera_delay=CAMERA_DELAY
    )
    scene = make_scene(settings.scene)
    camera = make_camera(settings, scene, say=lambda line: None)
    operator = make_spatial_operator(settings, scene, scene.nominal)
    robot = make_spatial_robot(settings, scene)
    return run_session(settings, operator, robot, camera, duration=seconds).log


def heard_until(log: SessionLog, second: float) -> Watched:
    """What a console would have heard of it live."""
    watched = Watched()
    for message in log.messages():
        if message.time_ns <= second * 1e9:
            watched.take(message, message.time_ns * 1e-9)
    watched.settings = log.settings
    return watched


def assert_same(one: LeaderSpace | FollowerSpace | None, other: LeaderSpace | FollowerSpace | None) -> None:
    """The same message; of numbers that are not known neither is."""
    assert one is not None
    assert other is not None
    np.testing.assert_array_equal(msgspec.structs.astuple(one), msgspec.structs.astuple(other))


# --- what is shown ----------------------------------------------------------------------------------------------------


def test_a_session_along_a_line_has_nothing_in_space() -> None:
    watched = Watched()
    watched.take(LeaderState(VERSION, 1, 1, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, False, 1, 1), 0.0)
    assert watched.leader_space is NOWHERE
    assert watched.space.follower_at(1) is None


@pytest.mark.long
@pytest.mark.parametrize("moment", [0.5, 2.0, 4.321, 5.9])
def test_a_recording_shows_the_places_of_its_moment(moment: float) -> None:
    log = recorded(LONG)
    shown = Playback(log)
    shown.go_to(moment)
    row = log.leader_space[round(moment * 1000)]
    leader = shown.leader_space
    assert shown.leader.sequence == row["sequence"]
    assert (leader.place_x, leader.point_z, leader.fixture_ry) == (row["place_x"], row["point_z"], row["fixture_ry"])
    assert leader.depth == row["depth"]
    telemetry = shown.telemetry
    assert telemetry is not None
    robot = telemetry.space
    assert robot is not None
    known = log.follower_space[log.follower_space["sequence"] == shown.telemetry_sequence][0]
    assert (robot.place_x, robot.force_z) == (known["place_x"], known["force_z"])
    # what is shown of the robot is as old as the network
    assert moment - telemetry.time_ns * 1e-9 == pytest.approx(FORCE_DELAY, abs=2e-3)
    trace = shown.space.pose_trace(2.0)
    assert trace.time[-1] == pytest.approx(0.0, abs=0.05)
    assert len(trace.time) == pytest.approx(min(moment, 2.0) / 0.05, abs=2)


@pytest.mark.long
def test_a_recording_shows_what_the_live_console_showed() -> None:
    log, moment = recorded(LONG), 7.2
    live, shown = heard_until(log, moment), Playback(log)
    shown.go_to(moment)
    assert live.leader_space is not NOWHERE
    assert live.telemetry_sequence == shown.telemetry_sequence
    assert_same(live.leader_space, shown.leader_space)
    sequence = live.telemetry_sequence
    assert_same(live.space.follower_at(sequence), shown.space.follower_at(sequence))
    field = live.space.field(sequence)
    assert field is not None
    other = shown.space.field(sequence)
    assert other is not None
    assert field.records.tobytes() == other.records.tobytes()
    for ours, theirs in zip(live.space.pose_trace(3.0), shown.space.pose_trace(3.0), strict=True):
        assert len(ours) == pytest.approx(len(theirs), abs=1)
    if log.images:
        image = live.space.image(sequence, CAMERA_DELAY)
        assert image is not None
        assert image == shown.space.image(sequence, CAMERA_DELAY)
        assert 0.0 <= sequence - CAMERA_DELAY * 1000 - image.tick <= 34.0  # the newest of those that had come


def test_an_image_is_shown_late_and_the_one_of_another_process_never() -> None:
    images = [CameraImage(VERSION, n, 0, 10 * n, b"", (), (), 0, "", (), run=1) for n in range(1, 9)]
    images.append(CameraImage(VERSION, 9, 0, 1, b"", (), (), 0, "", (), run=2))
    for sequence in range(0, 120, 7):
        image = newest_image(images, sequence, 0.02, run=1)
        due = [one.tick for one in images[:-1] if one.tick <= sequence - 20]
        assert (image.tick if image else None) == (max(due) if due else None)


def ticked(sequence: int, run: int) -> Telemetry:
    numbers, robot = (0.0,) * 6, FollowerSpace(*(0.0,) * 19)
    return Telemetry(VERSION, sequence, sequence, 0, *numbers, False, False, 0, 1, 1, run=run, space=robot)


def test_what_was_felt_long_ago_stays_in_every_picture() -> None:
    seen, count = Watched(), MOST_FIELDS + 50
    for k in range(1, count):
        seen.take(ticked(k, 1), 0.0)
        content = packed([k // 100], [k % 100], [0.0], [0.01])
        seen.take(FieldUpdate(VERSION, k, k, content, run=1), 0.0)
        field = seen.at_once().space.field(k)
        assert field is not None
        assert field.count == k


def test_a_robot_that_begins_anew_is_not_mixed_with_the_one_before() -> None:
    space = SpaceState()
    for sequence in (5, 6):
        space.take(ticked(sequence, 1), 0.0)
    space.take(FieldUpdate(VERSION, 1, 5, packed([1], [1], [0.0], [0.01]), run=1), 0.0)
    assert space.field(6) is not None
    space.take(ticked(1, 2), 1.0)
    assert space.follower_at(6) is None
    assert space.follower_at(1) is not None
    assert space.field(1) is None


@pytest.mark.long
def test_what_ages_the_pose_is_said() -> None:
    log = recorded(LONG)
    watched = heard_until(log, 5.0)
    belief, leader = watched.space.belief, watched.leader_space
    assert belief is not None
    assert leader is not None
    received = watched.space._belief_received
    assert pose_sentence(watched, received).lower().rstrip(".") == belief.reason.lower().rstrip(".")
    assert "silent for 2.5 s" in pose_sentence(watched, received + 2.5)
    watched.settings = {**log.settings, "fusion": "none"}
    assert "nothing is tracked" in pose_sentence(watched, received)
    watched.settings = {**log.settings, "camera": "there is none"}
    assert pose_sentence(watched, received).startswith("No camera")


# --- colours and shapes -----------------------------------------------------------------------------------------------


@given(st.lists(st.floats(1.0, 1e5), min_size=1, max_size=40))
def test_a_scale_holds_what_was_learnt_in_round_steps_and_never_shrinks(values: list[float]) -> None:
    edges = np.empty(0)
    before = (math.inf, -math.inf)
    for count in range(1, len(values) + 1):
        edges = scale_edges(edges, np.array(values[:count]))
        low, high = np.percentile(values[:count], (2.0, 98.0))
        assert edges[0] <= low * (1.0 + 1e-9)
        assert edges[-1] >= high * (1.0 - 1e-9)
        assert edges[0] <= before[0]
        assert edges[-1] >= before[1]
        np.testing.assert_allclose(np.diff(edges), edges[1] - edges[0], rtol=1e-9)
        before = (edges[0], edges[-1])
    assert len(edges) == len(COLOURS) + 1


def test_the_colours_get_darker_with_stiffness() -> None:
    lightness = [0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in COLOURS]
    assert (np.diff(lightness) < -15.0).all()


def test_levels_follow_stiffness_and_what_is_not_known_is_grey() -> None:
    edges = np.linspace(100.0, 800.0, 8)
    stiffness = np.array([50.0, 100.0, 199.0, 201.0, 799.0, 5000.0, 400.0])
    known = np.array([True, True, True, True, True, True, False])
    np.testing.assert_array_equal(levels_of(edges, stiffness, known), [1, 1, 1, 2, 7, 7, 0])
    assert not levels_of(np.empty(0), stiffness, known).any()
    legend = legend_html(edges)
    assert legend.index("700 to 800") < legend.index("100 to 200") < legend.index("nothing learnt")


@pytest.mark.parametrize("name", ["plane", "hill"])
def test_the_surface_is_fine_enough_and_still_the_same(name: str) -> None:
    surface = make_scene(name).surface
    vertices, faces = shape.refined(*surface.outline())
    corners = vertices[faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= shape.LONGEST_EDGE
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    rough, old = surface.outline()
    corners = rough[old]
    whole = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert area == pytest.approx(whole, rel=1e-9)
    walls, triangles = shape.skirt(vertices, faces, -0.02)
    assert len(triangles) == 2 * len(shape.boundary(faces))
    assert walls[:, 2].min() == pytest.approx(-0.02)
    used, few = shape.compacted(faces[:7])
    np.testing.assert_array_equal(vertices[used][few], vertices[faces[:7]])


def test_the_dent_is_as_deep_as_the_probe_and_ends() -> None:
    vertices, _ = shape.refined(*make_scene("plane").surface.outline())
    middle = vertices[np.argmin(((vertices - vertices.mean(axis=0)) ** 2).sum(axis=1))]
    bent, sinking = sunk(vertices, middle, (0.0, 0.0, 1.0), 0.004)
    assert sinking.max() == pytest.approx(0.004)
    far = np.linalg.norm(vertices - middle, axis=1) >= DENT_ENDS
    np.testing.assert_array_equal(bent[far], vertices[far])
    assert not sunk(vertices, middle, (0.0, 0.0, 1.0), -0.01)[1].any()


@pytest.mark.parametrize(("radius", "depth"), [(0.001, 0.001), (0.004, 0.002), (0.004, 0.005), (0.02, 0.004)])
def test_a_sphere_is_nowhere_under_the_dent_that_it_makes(radius: float, depth: float) -> None:
    along = np.linspace(0.0, 0.05, 2001)
    vertices = np.column_stack([along, 0.0 * along, 0.0 * along])
    bent, _ = sunk(vertices, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), depth, radius)
    under = along < radius
    ball = radius - depth - np.sqrt(np.maximum(radius**2 - along**2, 0.0))  # its lower side
    assert (bent[under, 2] <= np.minimum(ball[under], 0.0) + 2e-4).all()
    assert bent[0, 2] == pytest.approx(-depth)
    np.testing.assert_array_equal(bent[along >= DENT_ENDS + radius], vertices[along >= DENT_ENDS + radius])


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_turns_are_those_of_scipy(vector: tuple[float, float, float]) -> None:
    w, x, y, z = wxyz_of(vector)
    ours, theirs = Rotation.from_quat((x, y, z, w)), Rotation.from_rotvec(vector)
    assert (ours.inv() * theirs).magnitude() < 1e-7
    length = math.hypot(*vector)
    if length > 1e-3:
        w, x, y, z = along(vector)
        turned = Rotation.from_quat((x, y, z, w)).apply((0.0, 0.0, 1.0))
        np.testing.assert_allclose(turned, np.array(vector) / length, atol=1e-4)


@pytest.mark.long
def test_the_virtual_probe_is_drawn_where_the_camera_sees_the_real_one() -> None:
    """In a picture without delay both are at one place: the tip's red ball is painted over."""
    cv2 = pytest.importorskip("cv2")
    log = recorded(SHORT)
    image = next((one for one in log.images if one.tick > 1000 and one.markers == MARKERS), None)
    if image is None:
        pytest.skip("nothing here draws images")
    tick = log.follower_space[log.follower_space["sequence"] == image.tick][0]
    probe = tuple(float(tick[f"place_{axis}"]) for axis in "xyz")
    corners = np.array([(-0.03, -0.03, 0.0), (0.03, -0.03, 0.0), (0.03, 0.03, 0.0), (-0.03, 0.03, 0.0)])
    drawn = draw_over(image.jpeg, image.camera, probe, image.pose, corners)
    assert drawn is not None

    def red(jpeg: bytes) -> int:
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
        return int(((picture[..., 2] > 120) & (picture[..., 1] < 90) & (picture[..., 0] < 90)).sum())

    assert red(image.jpeg) > 60
    assert red(drawn) < 0.5 * red(image.jpeg)
    assert draw_over(b"no image", image.camera, probe, image.pose, corners) is None


# --- the hand ---------------------------------------------------------------------------------------------------------


def held() -> tuple[SpaceHold, list[Handle], LeaderSpace]:
    watched = heard_until(recorded(SHORT), 1.0)
    messages: list[Any] = []
    return SpaceHold(watched, Publisher(messages.append)), messages, watched.leader_space


@pytest.mark.long
def test_a_drag_moves_the_hand_by_as_much_from_where_it_was() -> None:
    hold, messages, leader = held()
    hand = np.array([leader.hand_x, leader.hand_y, leader.hand_z])
    hold.drag_to(HOME, "start")
    way = np.array([0.004, -0.003, 0.002])
    hold.drag_to(tuple(np.array(HOME) + way), "update")
    hold.drag_to(tuple(np.array(HOME) + way), "end")
    np.testing.assert_allclose([message.place for message in messages], [hand, hand + way, hand + way], atol=1e-12)
    assert [message.held for message in messages] == [True, True, False]
    hold.follow()
    np.testing.assert_allclose(hold.handle, np.array(HOME) + way)  # it stays a while where it was let go


def test_a_hand_goes_no_further_than_it_may() -> None:
    hold, messages, leader = held()
    hold.drag_to(HOME, "start")
    hold.drag_to((5.0, -5.0, -5.0), "update")
    x, y, z = messages[-1].place
    assert (x, y) == (REACH, -REACH)
    assert leader.point_z - 0.02 < z < leader.point_z


def test_strokes_move_the_hand_and_let_go() -> None:
    hold, messages, _ = held()
    hold.stroke((0.0005, 0.0, 0.0))
    before = messages[-1].place
    hold.stroke((0.0, 0.0, 0.0005))
    np.testing.assert_allclose(np.subtract(messages[-1].place, before), (0.0, 0.0, 0.0005), atol=1e-12)
    assert hold.held
    assert not hold.dragged
    hold.keep_alive(time.monotonic() + 1.1)
    assert not messages[-1].held
    hold.toggle_clutch(7)
    assert messages[-1].clutched
    assert hold.browser_gone(7)
    assert not messages[-1].clutched


def test_beliefs_are_told_by_the_clock_of_the_robot() -> None:
    log = recorded(SHORT)
    shown = Playback(log)
    shown.go_to(1.0)
    belief, robot = shown.space.belief, shown.telemetry
    assert isinstance(belief, FixtureBelief)
    assert robot is not None
    assert 0 <= robot.time_ns - belief.time_ns < 100_000_000


@pytest.mark.long
def test_recordings_on_disk_hold_it_all(tmp_path: Path) -> None:
    log, path = recorded(SHORT), tmp_path / "scene.mcap"
    field = FieldUpdate(VERSION, 1, 1_000_000, packed([1], [1], [0.5], [0.01]), run=int(log.follower_space["run"][0]))
    log = dataclasses.replace(log, fields=(field,))
    with SessionWriter(path) as writer:
        for message in log.messages():
            writer.write(message, message.time_ns)
        writer.close(log.counts)
    ours, theirs = Playback(read_session(path)), Playback(log)
    for one in (ours, theirs):
        one.go_to(1.0)
    assert_same(ours.leader_space, theirs.leader_space)
    learnt = [one.space.field(one.telemetry_sequence) for one in (ours, theirs)]
    assert [one.count for one in learnt if one is not None] == [1, 1]

"""The report of sessions in three dimensions against closed forms, and against what keeps the account itself."""

from __future__ import annotations

import base64
import dataclasses
import re
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from report_sessions import make_session
from scene_sessions import NOMINAL, POSITION_DELAY, field_update, make_scene_session, model, put

from foretouch.messages import FixtureBelief, SessionLog
from foretouch.models import ScaleField
from foretouch.models.scale_field import packed
from foretouch.models.scale_field_kernel import SIDE, SPACING
from foretouch.quantities import Pose
from foretouch.rendering import SpatialEnergyAccount
from foretouch.report import pair, render_text, session_figures, write_page
from foretouch.report.scene import look_at_scene
from foretouch.report.scene.map import StiffnessMap, height_of, map_figures, touched_places
from foretouch.report.scene.pose import NEAR_FOR, NEAR_MM, PoseError, pose_figures
from foretouch.session import SessionSettings
from foretouch.session.runners.simulated import run_session
from foretouch.session.spatial import make_scene, make_spatial_operator, make_spatial_robot

SHIFT = Pose.from_rotation_vector((0.01, -0.02, 0.015), (0.001, 0.002, -0.0005))
"""By which the rendered fixture is wrong at first."""


def numbers(pose: Pose) -> tuple[float, ...]:
    return (*pose.translation.tolist(), *pose.rotation_vector().tolist())


def scene_of(log: SessionLog) -> dict:
    return session_figures(log)["scene"]


# --- pose -------------------------------------------------------------------------------------------------------------


def with_pose(log: SessionLog, bumped: int, seen: int) -> tuple[SessionLog, Pose]:
    """The fixture is rendered where it is from tick 500 on, is bumped in a tick, and rendered there from another on."""
    first = Pose.from_rotation_vector(NOMINAL[3:], NOMINAL[:3]) @ SHIFT
    second = first @ Pose.from_rotation_vector((0.0, 0.03, 0.0), (0.004, 0.0, 0.0))
    exact, shown = np.tile(numbers(first), (log.leader.size, 1)), np.tile(NOMINAL, (log.leader.size, 1))
    exact[bumped:] = numbers(second)
    shown[500:] = numbers(first)
    shown[seen:] = numbers(second)
    put(log.follower_space, "exact", exact)
    put(log.leader_space, "fixture", shown)
    for number, tick in enumerate((600, 700, 800, 900)):
        log.follower_space["touch_tick"][tick:] = tick
        put(log.follower_space[tick:], "touch", (float(number), 0.0, 0.0))
    log.leader_space["fixture_deviation"], log.leader_space["fixture_turn"] = 2e-4, np.radians(0.1)
    return log, first


@pytest.mark.parametrize("apart_ns", [0, 10_000_000_000])
def test_the_error_of_the_pose_is_that_of_the_newest_tick(apart_ns: int) -> None:
    """Also where both clocks have nothing to do with each other."""
    log, first = with_pose(make_scene_session(apart_ns=apart_ns), 2000, 2450)
    result = look_at_scene(log, pair(log)).pose
    far, turn = Pose.from_rotation_vector(NOMINAL[3:], NOMINAL[:3]).distance(first)
    assert result.distance[10:499] == pytest.approx(1e3 * far, rel=1e-12)
    assert result.turn[10:499] == pytest.approx(np.degrees(turn), rel=1e-9)
    assert result.distance[500:2000].max() < 1e-9
    assert result.distance[2000:2450] == pytest.approx(4.0, rel=1e-9)
    assert result.distance[2450:].max() < 1e-9


def test_a_bump_is_found_and_so_is_when_it_is_over() -> None:
    log, _ = with_pose(make_scene_session(), 2000, 2450)
    pose = scene_of(log)["pose"]
    assert (pose["touches"], pose["after_touches"]) == (4, 4)
    (bump,) = pose["bumps"]
    zero = POSITION_DELAY * 1e-3  # the first command is applied then
    assert bump["at_s"] == pytest.approx(1.999 - zero, abs=1e-9)
    assert bump["recovered_s"] == pytest.approx(0.450, abs=2e-3)
    assert pose["place_mm"]["median"] == pytest.approx(0.0, abs=1e-9)
    assert pose["place_mm"]["p95"] == pytest.approx(0.0, abs=1e-9)  # the bump is told apart
    assert pose["place_mm"]["deviation"] == pytest.approx(0.2)
    assert pose["turn_degrees"]["deviation"] == pytest.approx(0.1)


def test_a_fixture_that_is_never_found_again_is_said() -> None:
    log, _ = with_pose(make_scene_session(), 2000, 4000)
    report = session_figures(log)
    assert report["scene"]["pose"]["bumps"][0]["recovered_s"] is None
    assert report["scene"]["pose"]["place_mm"]["p95"] == pytest.approx(4.0)
    assert "the fixture was never again where it is shown" in render_text(report)


def test_what_the_tracker_counted_is_told_and_a_real_robot_has_no_truth() -> None:
    log = make_scene_session()
    put(log.follower_space, "exact", (np.nan,) * 6)
    log.follower["exact_force"] = np.nan
    belief = FixtureBelief(1, 9, 0, NOMINAL, tuple((1e-8 * np.eye(6)).ravel().tolist()), 0.1, 70, 5, 2, "")
    scene = scene_of(dataclasses.replace(log, beliefs=(belief,)))
    assert (scene["pose"]["images_used"], scene["pose"]["contacts_used"], scene["pose"]["refused"]) == (70, 5, 2)
    assert scene["pose"]["place_mm"]["median"] is None
    assert scene["contacts"]["false"]["percent"] is None
    assert scene["friction"]["true_coefficient"] is None


# --- contacts, friction, forces ---------------------------------------------------------------------------------------


def test_false_and_missed_contacts_are_counted_at_equal_command() -> None:
    log = make_scene_session(4000)
    true, predicted = np.zeros(4000), np.zeros(4000)
    true[500:600] = true[1000:1200] = true[2000:2010] = 1.0  # by the command's number
    predicted[1050:1300] = predicted[3000:3015] = 2.0
    log.leader["predicted_force"] = predicted
    log.leader["model_sequence"][800:] = 1
    log.follower["exact_force"][POSITION_DELAY:] = true[: 4000 - POSITION_DELAY]
    contacts = scene_of(dataclasses.replace(log, models=(model(1, 700),)))["contacts"]
    rows = 4000 - POSITION_DELAY
    assert contacts["false"]["percent"] == pytest.approx(100.0 * (100 + 15) / rows)
    assert (contacts["false"]["episodes"], contacts["false"]["longest_s"]) == (1, pytest.approx(0.099))
    assert contacts["missed"]["percent"] == pytest.approx(100.0 * (50 + 10) / rows)
    assert (contacts["missed"]["episodes"], contacts["missed"]["longest_s"]) == (1, pytest.approx(0.049))
    assert contacts["before_model"]["percent"] == pytest.approx(100.0 * 100 / rows)


LEARNT = 0.31, 0.4, 0.02, 0.05, 2500.0, 400.0, 0.1, 0.03


def test_friction_and_forces_in_space() -> None:
    log = make_scene_session()
    put(log.leader_space, "normal", (0.6, 0.0, 0.8))
    put(log.leader_space[100:101], "force", (3.0 * 0.6 - 0.8, 0.5, 3.0 * 0.8 + 0.6))
    models = (model(1, 700, friction=(0.5, 0.1, 0.2, 0.3, *4 * (0.0,))), model(2, 800, friction=LEARNT))
    scene = scene_of(dataclasses.replace(log, models=(*models, model(3, 900))))
    assert scene["forces"]["tangential_hand_N"] == pytest.approx(np.sqrt(1.25))
    assert scene["forces"]["total_hand_N"] == pytest.approx(np.sqrt(9.0 + 1.25))
    assert scene["forces"]["total_robot_N"] == 0.0
    assert (scene["friction"]["coefficient"], scene["friction"]["deviation"]) == (0.31, 0.02)
    assert (scene["friction"]["true_coefficient"], scene["friction"]["true_viscous_N_s_per_m"]) == (0.3, 0.5)
    assert (scene["friction"]["stiffness_N_per_m"], scene["friction"]["excess_at_rest"]) == (2500.0, 0.1)


# --- energy -----------------------------------------------------------------------------------------------------------


LATE = {"device_delay": "0.0", "device_watchdog": "0.0"}


def with_account(
    log: SessionLog, seed: int, *, scale: float = 1.0, resolution: float = 0.0, rubs_on: bool = False
) -> SessionLog:
    """A hand that wanders, and forces of no law that the account itself holds in bounds.

    Where it rubs on, friction is held where nothing is pressed any more.
    """
    random = np.random.default_rng(seed)
    account = SpatialEnergyAccount(resolution)
    position, hand, leader = np.zeros(3), log.leader_space, log.leader
    touching = np.repeat(random.random(-(-hand.size // 100)) < 0.7, 100)
    for row in range(hand.size):
        position = position + random.normal(0.0, 1e-4, 3)
        account.observe(tuple(position / scale))
        hand["energy"][row], hand["energy_bound"][row] = account.energy, account.bound
        pressed = 2.0 if touching[row] else 0.0
        if not touching[row]:
            account.close()
        x, y, z = random.normal(0.0, 0.5, 3).tolist() if touching[row] or rubs_on else (0.0, 0.0, 0.0)
        force = account.hold((x, y, z + pressed if touching[row] else 0.0))
        put(hand[row : row + 1], "hand", position)
        put(hand[row : row + 1], "force", force)
        leader["rendered_force"][row] = pressed
    return log


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.5, 1.0, 2.0]), st.sampled_from([0.0, 1e-5]))
def test_the_account_is_that_of_who_keeps_it(seed: int, scale: float, resolution: float) -> None:
    grip = "none" if resolution == 0.0 else "normal"
    log = make_scene_session(600, position_scale=str(scale), grip=grip, device_resolution=str(resolution), **LATE)
    energy = scene_of(with_account(log, seed, scale=scale, resolution=resolution))["energy"]
    assert energy["energy_agrees"]
    assert energy["certificate_holds"]
    assert energy["energy_margin_J"] >= 0.0
    assert energy["net_energy_J"] == pytest.approx(min(log.leader_space["energy"].min(), 0.0), abs=1e-12)


def test_friction_that_outlasts_the_contact_is_no_other_account() -> None:
    """The leader forgives a surplus where nothing presses, whatever rubs."""
    report = session_figures(with_account(make_scene_session(600, **LATE), 4, rubs_on=True))
    assert report["scene"]["energy"]["energy_agrees"]
    assert report["stable"] is True


def test_a_broken_bound_is_said_and_so_is_an_account_that_does_not_agree() -> None:
    log = with_account(make_scene_session(1500), 4)
    put(log.leader_space[700:720], "force", (0.0, 0.0, 60.0))
    assert not scene_of(log)["energy"]["energy_agrees"]
    log.leader_space["hand_z"] = 1e-4 * np.arange(1500)  # the hand leaves, and is pushed
    log.leader["rendered_force"] = 1.0
    report = session_figures(log)
    assert report["stable"] is False
    assert report["scene"]["energy"]["certificate_holds"] is False
    assert "Unstable: the hand was given" in render_text(report)


# --- the map ----------------------------------------------------------------------------------------------------------


def nodes_about(scene: str, factor: float = 1.0) -> bytes:
    """Nodes that have the inclusion's factor everywhere, times another one, as they are sent."""
    made = make_scene(scene)
    i, j = (part.ravel() for part in np.meshgrid(np.arange(14, 37), np.arange(-11, 12), indexing="ij"))
    scale = np.full(i.size, factor)
    if made.inclusion is not None:
        scale *= [made.inclusion.factor((SPACING * x, SPACING * y, 0.0)) for x, y in zip(i, j, strict=True)]
    return packed(i + SIDE // 2, j + SIDE // 2, np.log(scale), np.full(i.size, 1e-4))


def palpated(scene: str, field: bytes) -> SessionLog:
    """The probe goes over the specimen in rows 3 mm apart, in contact all the way."""
    log = make_scene_session(17 * 200, scene=scene)
    along, rows = np.linspace(-0.024, 0.024, 200), np.linspace(-0.024, 0.024, 17)
    position = np.array([(x, y, 0.0) for y in rows for x in along])
    put(log.follower_space, "place", position)
    log.follower["in_contact"], log.follower["force"], log.follower["exact_force"] = True, 1.0, 1.0
    return dataclasses.replace(log, fields=(field_update(field),), models=(model(1, 100),))


def test_a_field_that_is_right_has_no_error() -> None:
    result = scene_of(palpated("plane", nodes_about("plane")))["map"]
    assert result["median_error_percent"] < 0.1
    assert result["within_two_deviations_percent"] == 100.0
    assert result["learnt_N_per_m"] == pytest.approx([6000.0] * 3, rel=1e-3)
    assert result["touched_cm2"] == pytest.approx(5.4**2, rel=0.08)  # 48 mm and 3 mm about it, in whole cells
    assert result["inclusion"] is None


def test_a_field_that_is_too_stiff_is_wrong_by_as_much() -> None:
    result = scene_of(palpated("plane", nodes_about("plane", 1.25)))["map"]
    assert result["median_error_percent"] == pytest.approx(25.0, rel=5e-3)
    assert result["within_two_deviations_percent"] == 0.0


def test_an_inclusion_is_found_where_it_is() -> None:
    field = nodes_about("phantom")
    result = scene_of(palpated("phantom", field))["map"]["inclusion"]
    assert result["centre_error_mm"] < 0.5
    assert result["radius_mm"] == pytest.approx(12.0, abs=1.0)
    assert result["ratio"] == pytest.approx(4.0, rel=0.05)


def test_a_sphere_touches_with_its_deepest_point_and_the_truth_is_that_there() -> None:
    """Its centre is elsewhere, seen from above, and the surface is below its centre by more than on its own."""
    radius, scene = 0.015, make_scene("hill")
    log = palpated("hill", nodes_about("hill"))
    places = np.stack([log.follower_space[f"place_{axis}"] for axis in "xyz"], axis=1)
    touched = np.array([(x, y, height_of(scene, x, y)) for x, y, _ in places - NOMINAL[:3]])
    normals = np.array([scene.surface.contact(point).normal for point in touched])
    put(log.follower_space, "place", touched + radius * normals + NOMINAL[:3])
    put(log.follower_space, "normal", normals)
    log.settings["probe_radius"] = str(radius)
    found = look_at_scene(log, pair(log))
    assert found.scene is not None
    assert found.scene.surface.radius == radius
    np.testing.assert_allclose(touched_places(found.rows, radius), touched[::10, :2], atol=1e-9)
    assert np.abs(touched_places(found.rows)[:, 0] - touched[::10, 0]).max() > 1e-3
    for x, y, height in touched[::400].tolist():
        assert height_of(found.scene, x, y) == pytest.approx(height, abs=1e-6)
    result = scene_of(log)["map"]
    assert result["median_error_percent"] < 0.1
    assert result["touched_cm2"] == pytest.approx(5.4**2, rel=0.08)


def test_a_mesh_that_is_gone_leaves_the_rest_of_the_report(tmp_path: Path) -> None:
    log = palpated("plane", nodes_about("plane"))
    log.settings["scene"] = str(tmp_path / "gone.stl")
    report = session_figures(log)
    assert report["scene"]["map"] is None
    assert report["scene"]["friction"]["true_coefficient"] is None
    assert report["scene"]["pose"]["place_mm"]["median"] == pytest.approx(0.0, abs=1e-9)


# --- the whole --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated() -> SessionLog:
    """Three touches of a plane that stands a little off, found by touch alone."""
    chosen = SessionSettings(scene="plane", fusion="contact", displacement=0.003, turn=0.02, force_delay=0.1, seed=2)
    scene = make_scene("plane")
    return run_session(
        chosen,
        make_spatial_operator(chosen, scene, scene.nominal),
        make_spatial_robot(chosen, scene),
        None,
        duration=7.0,
    ).log


@pytest.fixture(scope="module")
def told(simulated: SessionLog) -> dict[str, Any]:
    return session_figures(simulated)


def test_a_simulated_scene_is_reported_and_its_account_agrees(simulated: SessionLog, told: dict[str, Any]) -> None:
    report = told
    scene = report["scene"]
    assert (scene["name"], scene["fusion"]) == ("plane", "contact")
    assert scene["energy"]["energy_agrees"]
    assert scene["energy"]["certificate_holds"]
    assert report["stable"] is True
    assert report["equal_position"]["prediction_error_percent"] < report["prediction_error_percent"]
    assert scene["contacts"]["before_model"]["episodes"] == 1
    assert scene["pose"]["contacts_used"] == simulated.counts["contacts_used"] >= 2
    # Until it has felt the surface the robot comes to it slowly, behind the commands; where it has, as fast as they.
    assert report["tracking_error"]["rms_mm"] < 6.0
    text = render_text(report)
    assert "Scene plane, the fixture's pose from touches" in text
    assert "predicted at follower's position" in text
    assert all(len(line) < 150 for line in text.splitlines())


@pytest.mark.long
def test_the_page_of_a_scene_shows_its_figures(simulated: SessionLog, told: dict[str, Any], tmp_path: Path) -> None:
    page = write_page(tmp_path, simulated, told).read_text()
    images = re.findall(r'alt="([^"]+)" src="data:image/svg\+xml;base64,([^"]+)"', page)
    captions = [text for text, _ in images]
    for text, data in images:
        assert ElementTree.fromstring(base64.b64decode(data)).tag.endswith("svg"), text
    assert any("pose" in text for text in captions)
    assert any("False and missed contacts" in text for text in captions)
    assert any("Local stiffness over the surface" in text for text in captions)
    assert not any("depth, true" in text or "tracking error" in text for text in captions)


def test_a_session_along_a_line_says_nothing_of_scenes() -> None:
    report = session_figures(make_session(2.0))
    assert "scene" not in report
    assert report["equal_position"]["prediction_error_percent"] is not None
    assert "predicted at follower's position" in render_text(report)


TICK = 0.1
FIELD = ScaleField()


def error_of(far: np.ndarray, end: float, tick: float = TICK) -> PoseError:
    """A bump from 0.05 s on, and ticks that are far off or not."""
    ticks = tick * np.arange(far.size)
    none = np.zeros(0)
    return PoseError(ticks, np.where(far, 2.0 * NEAR_MM, 0.0), 0.0 * ticks, none, none, none, ((0.05, end),))


def recovered(error: PoseError) -> float | None:
    deviation = np.full(error.time.size, np.nan)
    whole = PoseError(error.time, error.distance, error.turn, deviation, deviation, np.zeros(0), error.bumps)
    result: float | None = pose_figures(make_session(1.0), whole)["bumps"][0]["recovered_s"]
    return result


@given(st.lists(st.booleans(), min_size=2, max_size=60), st.integers(0, 8))
def test_a_pose_is_right_again_behind_the_last_tick_before_a_long_enough_rest(far: list[bool], end_tick: int) -> None:
    end = end_tick * TICK + 0.05
    error = error_of(np.array(far), end)
    expected = None
    for start in [end, *(t for t, wrong in zip(error.time.tolist(), far, strict=True) if wrong and t >= end)]:
        until = min(
            (t for t, wrong in zip(error.time.tolist(), far, strict=True) if wrong and t > start),
            default=max(error.time[-1], end),
        )
        if until - start >= NEAR_FOR:
            expected = start - 0.05
            break
    result = recovered(error)
    assert result == (None if expected is None else pytest.approx(expected))


def test_a_quarter_of_an_hour_that_is_never_right_again_is_judged_at_once() -> None:
    error = error_of(np.ones(1_000_000, dtype=bool), 0.5, 1e-3)
    begun = time.monotonic()
    assert recovered(error) is None
    assert time.monotonic() - begun < 20.0  # going over all ticks for each took hours


def test_a_phantom_that_is_felt_all_alike_has_no_inclusion() -> None:
    axis = np.linspace(-0.03, 0.03, 7)
    alike = np.full((7, 7), 400.0)
    result = StiffnessMap(0.075 + axis, axis, alike, 0.1 * alike, alike, np.ones((7, 7), dtype=bool))
    with np.errstate(all="raise"):
        figures = map_figures(result, FIELD, make_scene("phantom"))
    assert figures["inclusion"] is None
    assert figures["median_error_percent"] == 0.0

"""Sessions in three dimensions, in simulated time."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from commanded import MS, CommandedInSpace
from hypothesis import given
from hypothesis import strategies as st

from foretouch.devices import RecordedOperator, SpatialDevice
from foretouch.errors import MissingExtraError, SettingError, UnknownNameError
from foretouch.messages import (
    VERSION,
    CameraImage,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    ModelUpdate,
    SessionLog,
    Status,
    Telemetry,
)
from foretouch.models import make_model
from foretouch.quantities import Pose
from foretouch.recordings import excerpt, read_leader_motion
from foretouch.rendering.surfaces import Plane, SurfaceProxy
from foretouch.rendering.surfaces.line import PLACE_AT
from foretouch.report import session_report
from foretouch.robot import GantryArm, MissingGraphicsError, graphics_library, make_material
from foretouch.session import SessionSettings, simulate
from foretouch.session.runners.driven import Tick, drive_leader
from foretouch.session.runners.simulated import run_session
from foretouch.session.spatial import make_camera, make_scene, make_spatial_operator, make_spatial_robot, tracker
from foretouch.session.spatial.course import SurfaceLine
from foretouch.session.spatial.hand import HandInSpace
from foretouch.session.spatial.making import SpatialWorld
from foretouch.session.spatial.scenes import NOMINAL, KnownSurface
from foretouch.session.steps import leader

BUMP = 11.5
UNKNOWN = (math.nan,) * 3
SPREAD = tuple((1e-6 * np.eye(6)).ravel().tolist())
"""Covariance of a pose that is known within 1 mm and 1 mrad."""


def draws() -> bool:
    try:
        graphics_library()
    except MissingGraphicsError:
        return False
    return True


sees = pytest.mark.skipif(not draws(), reason="no library here draws without a display")


def run(duration: float, *, camera: bool = True, **changes: Any) -> SessionLog:
    settings = SessionSettings(**({"scene": "hill"} | changes))
    scene = make_scene(settings.scene)
    drawn = make_camera(settings, scene, say=print) if camera and settings.fusion in ("full", "image") else None
    return run_session(
        settings,
        make_spatial_operator(settings, scene, scene.nominal),
        make_spatial_robot(settings, scene),
        drawn,
        duration=duration,
    ).log


def pose(row: np.void, prefix: str) -> Pose:
    x, y, z, a, b, c = (float(row[f"{prefix}_{name}"]) for name in ("x", "y", "z", "rx", "ry", "rz"))
    return Pose.from_rotation_vector((a, b, c), (x, y, z))


def errors(log: SessionLog, time: float) -> tuple[float, float]:
    row = round(time * 1e3)
    far, turned = pose(log.follower_space[row], "exact").distance(pose(log.leader_space[row], "fixture"))
    return 1e3 * far, math.degrees(turned)


@pytest.fixture(scope="module")
def seen() -> SessionLog:
    return run(14.0, bump=BUMP)


@sees
@pytest.mark.long
def test_after_the_first_touches_and_after_a_bump_the_fixture_is_where_it_is_rendered(seen: SessionLog) -> None:
    assert errors(seen, 0.01)[0] > 10.0  # it stands elsewhere than both sides believed
    for time in (10.5, 11.4, 12.7, 13.9):
        far, turned = errors(seen, time)
        assert far < 0.5, time
        assert turned < 0.5, time
    moved = pose(seen.follower_space[11_400], "exact").distance(pose(seen.follower_space[13_000], "exact"))
    assert moved[0] > 2e-3


def turned_where_felt(log: SessionLog, begin: float, end: float) -> float:
    """Root mean square of the angle between the believed and the true normal under a probe in contact [degrees]."""
    surface, angles = KnownSurface(make_scene("hill").surface), []
    for row in range(round(begin * 1e3), round(end * 1e3), 20):
        if log.follower["in_contact"][row]:
            place = [float(log.follower_space[f"place_{axis}"][row]) for axis in "xyz"]
            poses = [pose(log.follower_space[row], name) for name in ("fixture", "exact")]
            one, other = (at.rotation @ surface.height(at.inverse().apply(place))[1] for at in poses)
            angles.append(math.degrees(math.acos(min(1.0, one @ other))))
    return float(np.sqrt(np.mean(np.square(angles))))


@sees
@pytest.mark.long
def test_a_bump_that_no_image_shows_is_felt_by_how_the_force_leans() -> None:
    log = run(22.0, seed=1, bump=11.0, image_fault="dropped:10.5:30", displacement=0.0125, turn=0.131)
    assert turned_where_felt(log, 11.2, 13.0) > 1.5
    assert turned_where_felt(log, 17.0, 22.0) < 1.2
    opened = [belief for belief in log.beliefs if belief.time_ns > 11.2e9]
    deviations = [math.sqrt(np.reshape(belief.covariance, (6, 6))[3:, 3:].trace()) for belief in opened]
    assert max(deviations) > math.radians(2.0)  # and says that it was moved


@sees
@pytest.mark.long
def test_a_bump_on_the_way_in_spoils_nothing_that_was_learnt_of_the_material() -> None:
    log = run(16.0, scene="phantom", seed=3, bump=13.0)  # the probe comes to where the surface was, and misses it

    def force(time: float) -> float:
        """Of the newest law then, 3 mm deep."""
        known = [update for update in log.models if update.valid and update.time_ns < time * 1e9][-1]
        law = make_model(known.law, known.parameters, known.map)
        return law.advance(law.initial_state(), 3e-3, 0.0, 1e-3)[1]

    assert force(12.9) > 0.5
    assert force(15.9) == pytest.approx(force(12.9), rel=0.1)
    missed = (log.follower_space["depth"][13_000:13_300] > 1e-3).any()
    assert missed


@sees
@pytest.mark.long
def test_forces_are_predicted_where_the_delayed_ones_are_wrong(seen: SessionLog) -> None:
    rows = seen.rows()
    pressed = rows.follower["in_contact"] & (rows.follower["time_ns"] > 8e9)
    true = rows.follower["exact_force"][pressed]

    def error(name: str) -> float:
        return float(np.sqrt(((rows.leader[name][pressed] - true) ** 2).mean() / (true**2).mean()))

    assert error("predicted_force") < 0.55 * error("delayed_force")


@sees
@pytest.mark.long
def test_a_rendered_force_has_its_uncertainty_which_shrinks_where_the_hand_has_been(seen: SessionLog) -> None:
    leader = seen.leader
    assert within_its_bound(seen)
    pressed = leader["predicted_force"] > 0.3
    uncertainty = leader["standard_deviation"][pressed] / leader["predicted_force"][pressed]
    assert np.isfinite(uncertainty).all()
    assert (uncertainty > 0.0).all()
    time = leader["time_ns"][pressed] * 1e-9
    assert np.median(uncertainty[time > 9.0]) < 0.7 * np.median(uncertainty[time < 6.0])


def within_its_bound(log: SessionLog) -> bool:
    return bool((log.leader_space["energy"] >= -log.leader_space["energy_bound"] - 1e-12).all())


@sees
@pytest.mark.long
def test_a_hidden_board_ages_and_nothing_jumps() -> None:
    log = run(5.0, image_fault="hand:1.5:4")
    age = log.leader_space["fixture_age"]
    assert age[1400] < 0.3
    assert age[4200] > 2.2
    assert age[4900] < 0.5
    uncertainty = log.leader_space["fixture_deviation"]
    assert uncertainty[4200] > uncertainty[1700]
    steps = [
        pose(a, "fixture").distance(pose(b, "fixture"))
        for a, b in zip(log.leader_space[1400:], log.leader_space[1401:], strict=False)
    ]
    assert max(far for far, _ in steps) < 1e-3
    assert any("hidden" in image.reason or image.markers < 4 for image in log.images)


@pytest.mark.long
def test_a_stiff_world_that_is_nearer_than_believed_is_met_below_the_ceiling() -> None:
    for seed in (1, 2, 3):
        log = run(6.0, camera=False, fusion="none", material="kelvin-voigt", seed=seed, turn=0.1, scene="plane")
        assert 5.0 < log.follower["exact_force"].max() < 15.0, seed


# --- the follower's step ----------------------------------------------------------------------------------------------


class Bench(CommandedInSpace):
    """A follower over a plane at the world's z = 0, with a robot in a world of the test's own."""

    def __init__(self, world: Any, start: tuple = (0.0, 0.0, 0.01), force_limit: float = 15.0) -> None:
        robot = GantryArm(world, seed=0, start=start, force_limit=force_limit)
        super().__init__(robot, SessionSettings(scene="plane", approach_speed=0.1), Plane(), (0.0,) * 6)
        self.felt: list[tuple[float, float, float]] = []

    def go(self, path: np.ndarray, **asked: Any) -> None:
        """Follow commands, one a tick; rows of NaN are ticks without one."""
        for place in path.tolist():
            acted = self.tick(place if np.isfinite(place).all() else None, **asked)
            space, self.status = acted.telemetry.space, acted.telemetry.status
            self.felt.append((space.force_x, space.force_y, space.force_z))


def line(start: tuple, end: tuple, ticks: int) -> np.ndarray:
    return np.linspace(start, end, ticks)


NOTHING = np.full((1, 3), math.nan)


def test_in_free_air_the_robot_goes_where_the_commands_go() -> None:
    bench = Bench(lambda *_: (0.0, 0.0, 0.0), start=(0.0, 0.0, 0.05))
    bench.go(line((0.0, 0.0, 0.05), (0.02, -0.01, 0.04), 800))
    bench.go(line((0.02, -0.01, 0.04), (0.02, -0.01, 0.04), 200))
    np.testing.assert_allclose(bench.sample.exact_place, (0.02, -0.01, 0.04), atol=1e-4)


def meet_sideways(stiffness: float, speed: float, far: float = 0.01, force_limit: float = 15.0) -> np.ndarray:
    """What a wall that nobody knew, so far away, is pressed with in each tick [N], by commands of this speed [m/s]."""

    def wall(place: tuple, velocity: tuple, elapsed: float) -> tuple:
        return -stiffness * max(place[0] - far, 0.0), 0.0, 0.0

    bench, end = Bench(wall, start=(0.0, 0.0, 0.02), force_limit=force_limit), far + 0.05
    bench.go(line((0.0, 0.0, 0.02), (end, 0.0, 0.02), round(end / speed / 1e-3)))
    bench.go(line((end, 0.0, 0.02), (end, 0.0, 0.02), 500))
    return -np.array(bench.felt)[:, 0]


STIFF_WALL = 23.0
"""The impact sideways on 100 kN/m passes the ceiling by half of it [N]: in 600 such impacts 22.0 was the largest."""


@pytest.mark.parametrize(
    ("wall", "most"), [((2e4, 0.06), 15.0), ((1e5, 0.1, 0.0101, 1000.0), STIFF_WALL)], ids=["20 kN/m", "100 kN/m"]
)
def test_a_wall_that_nobody_knew_is_met_sideways_below_the_ceiling_but_for_an_instant(
    wall: tuple[float, ...], most: float
) -> None:
    force = meet_sideways(*wall)
    assert 5.0 < force.max() < most
    met = int(np.argmax(force > 1.0))
    assert force[met + 50 :].max() < 15.0
    assert force[-1] > 5.0


@pytest.mark.long
@pytest.mark.parametrize(("stiffness", "most"), [(2e4, 15.0), (5e4, 15.0), (1e5, STIFF_WALL)])
def test_walls_are_met_so_at_any_speed_and_in_any_phase_of_a_tick(stiffness: float, most: float) -> None:
    for speed in (0.02, 0.06, 0.1, 0.15, 0.2, 0.25):
        forces = [
            meet_sideways(stiffness, speed, 0.01 + 1e-3 * speed * phase, 1000.0) for phase in np.arange(0, 1, 0.1)
        ]
        assert all(5.0 < force[-1] < 15.0 for force in forces)
        assert 5.0 < max(float(force.max()) for force in forces) < most, speed


@pytest.mark.parametrize(
    "angle", [10.0, 135.0, *(pytest.param(angle, marks=pytest.mark.long) for angle in (60.0, 90.0, 180.0))]
)
def test_whatever_is_believed_of_the_normal_the_force_stays_below_its_ceiling(angle: float) -> None:
    turned = math.radians(angle)
    normal = np.array([math.sin(turned), 0.0, math.cos(turned)])

    def world(place: tuple, velocity: tuple, elapsed: float) -> tuple:
        return tuple((5000.0 * max(-float(normal @ place), 0.0) * normal).tolist())

    start = 0.012 * normal
    bench = Bench(world, start=tuple(start.tolist()), force_limit=100.0)
    into = start - 0.03 * normal
    bench.go(line(tuple(start), tuple(into), 1500))
    along = into + np.array([0.03, 0.0, 0.0])
    bench.go(line(tuple(into), tuple(along), 600))
    largest = np.linalg.norm(bench.felt, axis=1).max()
    assert largest < 15.0
    if angle < 100.0:
        assert largest > 3.0


def test_a_force_that_is_no_number_for_a_tick_stops_nothing_for_good() -> None:
    bench = Bench(lambda *_: (0.0, 0.0, 0.0), start=(0.0, 0.0, 0.03))
    bench.go(line((0.0, 0.0, 0.03), (0.01, 0.0, 0.03), 400))
    bench.sample = bench.sample._replace(force=(math.nan, 0.0, 0.0))
    bench.go(line((0.01, 0.0, 0.03), (0.03, 0.0, 0.03), 800))
    bench.go(line((0.03, 0.0, 0.03), (0.03, 0.0, 0.03), 400))
    assert bench.sample.exact_place[0] == pytest.approx(0.03, abs=1e-4)


def floor(place: tuple, velocity: tuple, elapsed: float) -> tuple:
    return 0.0, 0.0, 400.0 * max(-place[2], 0.0)


@pytest.mark.parametrize("stops", [False, True])
def test_silence_and_an_emergency_stop_hold_in_all_directions_and_unload(stops: bool) -> None:
    bench, deep = Bench(floor), (0.0, 0.0, -0.006)
    bench.go(line((0.0, 0.0, 0.01), deep, 1500))
    assert bench.sample.exact_force[2] > 1.5
    if stops:
        bench.go(line(deep, deep, 1), stop="pressed")
    before = bench.sample.exact_place
    bench.go(line(deep, (0.02, 0.0, -0.006), 400) if stops else np.repeat(NOTHING, 400, axis=0))
    assert bench.status == (Status.STOPPED if stops else Status.HOLDING)
    assert math.dist(before[:2], bench.sample.exact_place[:2]) < 2e-3
    bench.go(line(deep, (0.02, 0.0, -0.006), 400) if stops else np.repeat(NOTHING, 1000, axis=0))
    assert bench.status == (Status.STOPPED if stops else Status.UNLOADING)
    assert bench.sample.exact_force[2] < 1.0
    assert math.dist(before[:2], bench.sample.exact_place[:2]) < 2e-3


@pytest.mark.parametrize("wrong", [(), (1.0,), (math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), (1e9, 0.0, 0.0)])
def test_a_command_whose_place_is_none_moves_nothing(wrong: tuple) -> None:
    bench = Bench(floor)
    for _ in range(29):
        bench.tick(wrong)
    # It stays where its encoders showed it at the start, which is where it is but for their noise.
    np.testing.assert_allclose(bench.sample.exact_place, (0.0, 0.0, 0.01), atol=1e-4)


# --- the line and the tracker -----------------------------------------------------------------------------------------

small = st.floats(-0.02, 0.02)
poses = st.tuples(small, small, small, *(st.floats(-0.2, 0.2) for _ in range(3)))


@given(st.lists(poses, min_size=1, max_size=8), st.tuples(small, small, small))
def test_a_belief_moves_no_coordinate_and_a_place_comes_back(beliefs: list, place: tuple) -> None:
    along = SurfaceLine(Plane(), (0.0,) * 6)
    first = along.follow(place)
    for belief in beliefs:
        along.believe(belief)
        closest = along.follow(place)
        assert closest.along == pytest.approx(first.along, abs=1e-12)
        np.testing.assert_allclose(PLACE_AT(along.records[0], closest.along), place, atol=1e-12)
        exact = Pose.from_rotation_vector(belief[3:], belief[:3]).inverse().apply(place)[2]
        assert closest.depth == pytest.approx(-exact, abs=1e-12)
        deeper = along.follow(PLACE_AT(along.records[0], closest.along + 1e-3))
        assert deeper.depth == pytest.approx(closest.depth + 1e-3, abs=1e-9)
        along.follow(place)


@pytest.mark.parametrize("wrong", [(), (0.0,) * 5, (math.nan, *(0.0,) * 5)])
def test_a_belief_that_is_none_is_left_out(wrong: tuple) -> None:
    along = SurfaceLine(Plane(), (0.0,) * 6)
    assert not along.believe(wrong)
    assert not along.believe((0.0,) * 6)  # no news
    assert along.believe((0.0, 0.0, 1e-3, 0.0, 0.0, 0.0))


def ticked(tick: int, run: int = 1, **changes: float) -> Telemetry:
    space = msgspec.structs.replace(FollowerSpace(*(0.0,) * 19), **changes)
    return Telemetry(VERSION, tick, tick * MS, 0, *(0.0,) * 6, False, False, 0, 1, 1, run=run, space=space)


def image(tick: int, place: tuple, run: int = 1) -> CameraImage:
    spread = tuple(np.diag([1e-8] * 6).ravel().tolist())
    return CameraImage(VERSION, tick, tick * MS, tick, b"", (*place, 0.0, 0.0, 0.0), spread, 4, "", (), run)


@pytest.mark.parametrize(
    ("fusion", "images", "contacts"), [("full", 9, 1), ("image", 9, 0), ("contact", 0, 1), ("none", 0, 0)]
)
def test_the_tracker_uses_what_it_is_told_to(fusion: str, images: int, contacts: int) -> None:
    state = tracker.start(KnownSurface(make_scene("plane").surface), NOMINAL, fusion)
    there = (-0.073, 0.001, 0.0)
    for tick in range(1, 10):
        seen = (there[0] + 1e-7 * tick, *there[1:])  # no two images are alike
        tracker.step(state, [ticked(tick)], [image(tick, seen)], tick * MS)
    belief = tracker.step(state, [ticked(10, touch_x=0.0, touch_y=0.0, touch_z=0.0, touch_tick=5)], [], 60 * MS)
    assert belief is not None
    assert (belief.images, belief.contacts) == (images, contacts)
    np.testing.assert_allclose(belief.pose[:2], there[:2] if images else NOMINAL[:2], atol=2e-3)
    assert math.isinf(belief.image_age) is not bool(images)


def test_a_touch_elsewhere_while_nothing_is_seen_means_that_the_fixture_was_moved() -> None:
    state = tracker.start(KnownSurface(make_scene("plane").surface), NOMINAL)
    for tick in range(1, 20):
        tracker.step(state, [ticked(tick)], [image(tick, (-0.075, 0.0, 1e-6 * tick))], tick * MS)
    before = tracker.step(state, [ticked(60)], [], 60 * MS)
    late = ticked(3000, touch_x=0.0, touch_y=0.0, touch_z=-0.006, touch_tick=3000)
    after = tracker.step(state, [late], [], 3000 * MS)
    assert before is not None
    assert after is not None
    assert after.pose[2] < -0.003
    assert max(after.deviation[:2]) > 10.0 * max(before.deviation[:2])


def test_an_image_of_no_known_tick_is_left_out_and_the_same_pose_to_the_last_bit_is_a_stream_that_stands_still() -> (
    None
):
    state = tracker.start(KnownSurface(make_scene("plane").surface), NOMINAL)
    tracker.step(state, [ticked(1)], [image(77, (0.0, 0.0, 0.0))], MS)
    assert state.images == state.refused == 0
    for tick in range(2, 11):
        tracker.step(state, [ticked(tick)], [image(tick, (-0.073, 0.0, 0.0))], tick * MS)
    assert (state.images, state.refused) == (1, 8)


def test_a_tracker_that_begins_late_takes_no_touch_of_before() -> None:
    state = tracker.start(KnownSurface(make_scene("plane").surface), NOMINAL, "contact")
    tracker.step(state, [ticked(5000, touch_x=0.0, touch_y=0.0, touch_z=0.01, touch_tick=1000)], [], 5000 * MS)
    assert state.contacts == 0
    tracker.step(state, [ticked(5001, touch_x=0.0, touch_y=0.0, touch_z=0.001, touch_tick=5001)], [], 5001 * MS)
    assert state.contacts == 1
    tracker.step(state, [ticked(1, run=2)], [], 5002 * MS)
    tracker.step(state, [ticked(5003, touch_x=0.0, touch_y=0.0, touch_z=0.01, touch_tick=5003)], [], 5003 * MS)  # late
    assert state.contacts == 1
    assert state.run == 2


def test_beliefs_that_are_late_or_of_another_process_are_left_out() -> None:
    bench = Bench(floor)

    def believe(sequence: int, z: float, run: int = 1, epoch: int = 1) -> float:
        belief = FixtureBelief(VERSION, sequence, 0, (0.0, 0.0, z, 0.0, 0.0, 0.0), SPREAD, 0.1, 1, 0, 0, "", run, epoch)
        bench.tick(None, beliefs=[belief])
        return bench.state.probe.line.pose[2]

    assert believe(500, 0.001) == 0.001
    assert believe(499, 0.002) == 0.001
    assert believe(501, 0.003, run=2) == 0.001
    assert believe(1, 0.004, epoch=2) == 0.004
    assert believe(900, 0.005) == 0.004


# --- what is refused, and what is missing -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": "moon"}, "unknown scene 'moon'"),
        ({"operator": "gamepad"}, "operator = 'gamepad': moves along one axis, and the scene hill is touched in three"),
        ({"follower_frame": "0.1,-1"}, "follower_frame = '0.1,-1': is of a line; with a scene give six numbers"),
        ({"leader_frame": "0,0,0,1"}, "leader_frame = '0,0,0,1': must be X,Y,Z,RX,RY,RZ"),
        ({"leader_frame": "11,0,0,0,0,0"}, "leader_frame = '11,0,0,0,0,0': must be X,Y,Z,RX,RY,RZ: metres within 10"),
        (
            {"scene": "", "leader_frame": "0,0,0,0,0,1"},
            "leader_frame = '0,0,0,0,0,1': is of a scene; along a line give",
        ),
        ({"fusion": "magic"}, "unknown fusion"),
        ({"displacement": 1.0}, "displacement = 1.0"),
        ({"image_fault": "hand"}, "KIND:BEGIN:END"),
        ({"image_fault": "dirt:1:2"}, "unknown image fault 'dirt'"),
    ],
)
def test_what_a_scene_cannot_have_is_refused_in_one_line(changes: dict, message: str) -> None:
    with pytest.raises((SettingError, UnknownNameError), match=message) as caught:
        SessionSettings(**({"scene": "hill"} | changes))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["foam-measured", "sponge", "adhesive"])
def test_a_material_remembers_one_contact_as_along_a_line_wherever_it_is_pressed(name: str) -> None:
    scene, material, step = make_scene("plane"), make_material(name), 5e-4
    world = SpatialWorld(scene, material, displacement=0.0, turn=0.0, bump=0.0, seed=0)
    x, state, smallest = 0.0, material.model.initial_state(), 0.0
    for tick in range(4000):  # pressed twice, the second time elsewhere: it slides there in free air, and in contact
        speed = 0.008 * math.pi * math.cos(math.pi * tick * step)
        depth = 0.008 * math.sin(math.pi * tick * step) - 0.001
        x += 5e-6 if 1000 < tick < 1500 else 0.0
        force = world.touch((x, 0.0, -depth), (0.0, 0.0, -speed), step)
        state, expected, _ = material.model.advance(state, depth, speed, step)
        assert force[2] == pytest.approx(expected, rel=1e-9, abs=1e-9)
        smallest = min(smallest, force[2])
    assert -1.0 < smallest < -0.9 if material.pulls else state != material.model.initial_state()


def test_the_force_of_a_phantom_leaps_nowhere_under_a_deep_probe() -> None:
    scene, step = make_scene("phantom"), 1e-5
    world = SpatialWorld(scene, make_material("hunt-crossley"), displacement=0.0, turn=0.0, bump=0.0, seed=0)
    forces = [
        np.linalg.norm(world.touch((0.0032, step * at - 0.01, -0.0113), (0.0, 0.0, 0.0), MS)) for at in range(2000)
    ]
    leaps = np.abs(np.diff(forces[1:])) / np.array(forces[2:])
    assert leaps.max() < 0.02  # the nearest point of its surface leaps from facet to facet, here by 0.3 mm


@pytest.mark.long
def test_the_recorded_operator_presses_as_deep_as_measured_at_the_places_of_the_script() -> None:
    scene, settings = make_scene("hill"), SessionSettings(scene="hill", operator="recorded")
    operator = make_spatial_operator(settings, scene, NOMINAL)
    assert operator.name == "recorded"
    proxy, depths = SurfaceProxy(scene.surface), []
    for tick in range(26_000):
        x, y, z = operator.read(tick * MS)
        depths.append((proxy.follow((x - NOMINAL[0], y, z)).depth, x, y))
    pressed = np.array([row for row in depths if row[0] > 0.0])
    assert 0.0045 < pressed[:, 0].max() < 0.0051  # straight down, and a hill's slope is a little nearer
    places = {(round(x, 3), round(y, 3)) for _, x, y in pressed.tolist()}
    assert len(places) == 9  # at each it stays where it is
    measured = RecordedOperator(*read_leader_motion(excerpt("tue/b-foam")), 0.01, 0.005)
    assert max(measured.loop) == pytest.approx(0.015, abs=1e-4)


def test_what_is_chosen_with_a_scene_is_taken_and_what_is_not_is_the_scenes_own() -> None:
    settings = SessionSettings(scene="hill")
    assert (settings.model, settings.estimator, settings.material) == ("contact-map", "bank", "hunt-crossley")
    settings = SessionSettings(scene="hill", model="kelvin-voigt", material="foam-measured")
    assert (settings.model, settings.estimator, settings.material) == ("kelvin-voigt", "rls", "foam-measured")
    settings = SessionSettings()
    assert (settings.model, settings.estimator, settings.material) == ("contact-map", "bank", "foam-measured")


def test_a_probe_meets_the_most_damped_of_scenes_and_stays_on_it() -> None:
    """With physics steps of half a millisecond its damper would turn the probe around in one, and swing it up."""
    still = {"displacement": 0.0, "turn": 0.0, "fusion": "none"}
    settings = SessionSettings(scene="phantom", material="kelvin-voigt", most_damped=2000.0, **still)
    scene = make_scene("phantom")
    arm = make_spatial_robot(settings, scene)
    assert scene.inclusion is not None
    (x, y, _), speed = scene.inclusion.middle, 0.004
    place, forces = arm.read().exact_place, []
    aside = x + scene.nominal[0], y + scene.nominal[1]
    for tick in range(3000):
        share = min(tick / 1000, 1.0)
        height = max(place[2] + (0.005 - place[2]) * tick / 1000, 0.005 - speed * 1e-3 * (tick - 1000))
        sample = arm.exchange((aside[0] * share, aside[1] * share, height))
        if len(forces) > 20:
            break
        if forces or sample.exact_force[2] > 0.0:
            forces.append(math.hypot(*sample.exact_force))
    assert len(forces) > 20
    assert min(forces) > 0.0, "it stays in touch"
    assert max(forces) < 1.5 * 2000.0 * speed, "and nothing swings up"


@pytest.mark.parametrize(
    "error", [MissingGraphicsError("neither EGL nor OSMesa is installed"), MissingExtraError("cv2", "vision")]
)
def test_without_graphics_the_session_runs_without_the_camera_and_says_so_once(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise error

    output: list[str] = []
    monkeypatch.setattr("foretouch.session.spatial.making.SimulatedCamera", fails)
    settings = SessionSettings(scene="plane")
    assert make_camera(settings, make_scene("plane"), say=output.append) is None
    assert len(output) == 1
    assert "install" in output[0]
    assert "\n" not in output[0]
    assert run(0.1).follower_space.size == 100


# --- what comes over the network --------------------------------------------------------------------------------------


def said(run: int, sequence: int, fixture: tuple, **changes: Any) -> ModelUpdate:
    made = ModelUpdate(VERSION, sequence, 0, 0, "kelvin-voigt", (300.0, 0.0), (), 0.0, True, "", "x", b"", 0, run)
    return msgspec.structs.replace(made, fixture=fixture, **changes)


def inputs_of(place: tuple, *arrived: Any) -> leader.Inputs:
    return leader.Inputs(place, arrived, MS, 0, exact_position=UNKNOWN, intended_position=UNKNOWN)


def force_of(outputs: leader.Outputs) -> tuple[float, float, float]:
    space = outputs.record.space
    return space.force_x, space.force_y, space.force_z


def told(leading: leader.State, tick: int, *models: ModelUpdate, telemetry: tuple = ()) -> leader.Outputs:
    inputs = inputs_of((0.0, 0.0, 0.02 - 1e-5 * tick), *telemetry, *models)
    return leader.step(leading, inputs, tick * MS)[1]


HERE, THERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.005, 0.0, 0.0, 0.0)


def fresh_leader(**changes: Any) -> leader.State:
    settings = SessionSettings(**({"scene": "plane"} | changes))
    return leader.start(settings, hand=HandInSpace(Plane(), HERE, settings.position_scale))


def met(leading: leader.State, tick: int, place: tuple, model: ModelUpdate) -> leader.Outputs:
    """A tick of a leader that is told at first where the follower is, and meets it 2 mm over the surface."""
    inputs = inputs_of(place, ticked(tick, run=0, desired_z=2e-3), *([] if tick < 3 else [model]))
    return leader.step(leading, inputs, tick * MS)[1]


def test_a_late_message_of_a_process_that_is_gone_moves_no_fixture() -> None:
    leading = fresh_leader()
    told(leading, 1, said(1, 1, HERE), telemetry=(Telemetry(VERSION, 1, 0, *(0,) * 7, False, False, 0, 1, 1, run=1),))
    told(leading, 2, telemetry=(Telemetry(VERSION, 1, 0, *(0,) * 7, False, False, 0, 1, 1, run=2),))
    told(leading, 3, said(2, 1, THERE))
    assert leading.hand.line.pose == THERE
    told(leading, 4, said(1, 900, HERE))
    assert leading.hand.line.pose == THERE


@pytest.mark.parametrize(
    "wrong", [(), (1.0,) * 5, (math.nan,) * 6, (1e9, *(0.0,) * 5), (0.0, 0.0, 0.0, 1e300, 0.0, 0.0)]
)
def test_a_fixture_that_is_none_moves_nothing_and_raises_nothing(wrong: tuple) -> None:
    leading = fresh_leader(grip="normal")
    for tick in range(1, 20):
        outputs = told(leading, tick, said(0, tick, wrong, friction=(1e300, 1e300, *6 * (0.0,))))
        assert all(map(math.isfinite, force_of(outputs)))
    assert leading.hand.line.pose == HERE


@given(st.binary(max_size=200))
def test_a_field_that_is_none_is_counted_and_raises_nothing(content: bytes) -> None:
    leading = fresh_leader()
    inputs = inputs_of((0.0, 0.0, -1e-3), FieldUpdate(VERSION, 1, 0, content))
    leader.step(leading, inputs, MS)
    assert leading.hand.material.refused == 1


def test_a_fixture_that_turns_up_nearer_does_not_jerk_the_hand_that_is_in_it() -> None:
    leading = fresh_leader(grip="normal", force_delay=0.0)
    forces = []
    for tick in range(1, 3000):
        model = said(0, tick, THERE if tick > 2500 else HERE)
        forces.append(met(leading, tick, (0.0, 0.0, 2e-3 - 2e-6 * min(tick, 2000)), model).record.space.force_z)
    assert forces[2400] > 0.3
    assert np.abs(np.diff(forces[2400:])).max() < 0.1
    assert leading.renderer.account.energy >= -leading.renderer.account.bound


@pytest.mark.long
@pytest.mark.parametrize("changes", [{"position_scale": 2.0}, {"force_scale": 0.5}, {"clutch": "6:7,8:9"}])
def test_scales_and_clutch_work_in_space(changes: dict) -> None:
    log = run(10.0, camera=False, fusion="none", displacement=0.0, turn=0.0, grip="normal", **changes)
    # The command may jump where a surface turns up that the hand is beyond; what the robot is told does not.
    place = np.stack([log.follower_space[f"desired_{axis}"] for axis in "xyz"], axis=1)
    assert np.linalg.norm(np.diff(place, axis=0), axis=1).max() < 1e-3
    assert within_its_bound(log)
    if "clutch" in changes:
        clutched = ~log.leader["engaged"]
        assert 1500 < clutched[5000:].sum() < 2500
    else:
        assert log.follower["exact_force"].max() > 0.3


@pytest.mark.long
@sees
def test_a_stream_that_stands_still_is_noticed() -> None:
    log = run(2.0, image_fault="frozen:0.8:1.6")
    still = [image for image in log.images if "stands still" in image.reason]
    assert len(still) >= 20
    assert not any(image.pose for image in still)
    assert log.leader_space["fixture_age"].max() > 0.7


def test_a_tracker_that_says_no_more_lets_the_pose_age() -> None:
    bench = Bench(floor)
    belief = FixtureBelief(VERSION, 1, 0, HERE, SPREAD, 0.1, 1, 0, 0, "", 1)
    ages = []
    for tick in range(1, 1000):
        acted = bench.tick((0.0, 0.0, 0.01), beliefs=[belief] if tick == 1 else [])
        if acted.model is not None:
            ages.append(acted.model.fixture_age)
    assert ages[0] == pytest.approx(0.1, abs=0.01)
    assert ages[-1] == pytest.approx(1.07, abs=0.05)


def test_a_device_that_gives_no_position_is_told_in_a_scene() -> None:
    class Lost(SpatialDevice):
        name = "lost"
        places = iter([(0.0, 0.0, 0.1), (math.nan,) * 3, (0.0, math.inf, 0.1), (0.0, 0.0, 0.1)])

        def read(self, now_ns: int) -> tuple[float, float, float]:
            return next(self.places)

        def render(self, force: tuple[float, float, float]) -> None:
            pass

    settings = SessionSettings(scene="hill")
    driven, counted = drive_leader(Lost(), settings, "anna", 1), []
    for tick in range(1, 5):
        driven.tick(Tick(tick * 1_000_000, 1_000_000))
        counted.append(driven.nowhere)
    assert counted == [0, 1, 2, 2]


@pytest.mark.long
@pytest.mark.parametrize(("friction", "stiffness"), [("dry", 3000.0), ("rubber", 1500.0)])
def test_a_session_feels_how_a_surface_yields_along_itself_and_never_buzzes(friction: str, stiffness: float) -> None:
    still = {"fusion": "none", "displacement": 0.0, "turn": 0.0}
    settings = SessionSettings(scene="hill", friction=friction, grip="normal", seed=2, **still)
    report = session_report(simulate(settings, duration=40.0).log)
    learnt = report.scene.friction
    assert learnt.stiffness_N_per_m == pytest.approx(stiffness, abs=2.0 * learnt.stiffness_deviation_N_per_m)
    assert learnt.coefficient == pytest.approx(learnt.true_coefficient, abs=0.02)
    assert report.scene.energy.certificate_holds
    assert not report.hand.oscillation.oscillates

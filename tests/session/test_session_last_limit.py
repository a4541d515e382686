"""Whatever is commanded, felt, believed or missing: no place that the robot is told is beyond the limits of motion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from commanded import MS, SCENES, CommandedInSpace, parts_with
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from motion_limits import UNBOUNDED, MotionLimits

from foretouch.messages import VERSION, Command, FixtureBelief
from foretouch.quantities import Pose
from foretouch.quantities.pose import Vector
from foretouch.robot import GantryArm, RobotSample, RobotSpecification, SpatialSample, make_material
from foretouch.session import SessionSettings
from foretouch.session.safety.motion import EMERGENCY
from foretouch.session.spatial.making import SpatialWorld
from foretouch.session.spatial.scenes import MIDDLE, Scene
from foretouch.session.steps import follower as line_follower

TICK, SPEED, ACCELERATION, JERK = 1e-3, 0.25, 40.0, 1e5
X, Y, Z = MIDDLE


def within(path: list[Vector], *, hardest: float = EMERGENCY * ACCELERATION, change: float = math.inf) -> None:
    places = np.array([path[0], path[0], *path])
    velocity = np.diff(places, axis=0) / TICK
    acceleration = np.diff(velocity, axis=0) / TICK
    assert np.isfinite(places).all()
    assert np.linalg.norm(velocity, axis=1).max() <= SPEED * (1 + 1e-9)
    assert np.linalg.norm(acceleration, axis=1).max() <= hardest * (1 + 1e-6)
    assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() <= change * (1 + 1e-6)


# --- the limits themselves --------------------------------------------------------------------------------------------

near = st.floats(-0.05, 0.05)
anywhere = near | st.sampled_from((math.nan, math.inf, -1e300, 900.0))
targets = st.tuples(anywhere, anywhere, anywhere)
streams = st.lists(st.tuples(targets, st.integers(1, 60), st.sampled_from(("step", "ramp", "noise"))), max_size=8)


def streamed(parts: Any, seed: int) -> list[Vector]:
    random, output, before = np.random.default_rng(seed), [], np.zeros(3)
    for target, ticks, kind in parts:
        for tick in range(ticks):
            place = np.array(target)
            if kind == "ramp":
                place = before + (place - before) * (tick + 1) / ticks
            elif kind == "noise":
                place = place + random.normal(0.0, 1e-3, 3)
            output.append(tuple(place.tolist()))
        before = np.nan_to_num(np.array(target), nan=0.0, posinf=0.0, neginf=0.0)
    return output


@settings(max_examples=25)
@given(streams, st.integers(0, 1000), st.sampled_from((2e3, 1e4, 1e5)))
def test_no_stream_of_places_breaks_a_limit(parts: Any, seed: int, jerk: float) -> None:
    limits = MotionLimits(SPEED, ACCELERATION, jerk, TICK)
    limits.begin(0.0, 0.0, 0.0)
    path = [(0.0, 0.0, 0.0)] + [limits.move(place) for place in streamed(parts, seed)]
    within(path, hardest=ACCELERATION, change=jerk * TICK) if len(path) > 1 else None


@settings(max_examples=25)
@given(streams, st.integers(0, 1000))
def test_nor_one_with_bounds_that_turn_and_tighten(parts: Any, seed: int) -> None:
    random = np.random.default_rng(seed)
    limits = MotionLimits(SPEED, ACCELERATION, JERK, TICK)
    limits.begin(0.0, 0.0, 0.0)
    path, bounds = [(0.0, 0.0, 0.0)], (UNBOUNDED,) * 3
    for place in streamed(parts, seed):
        if random.random() < 0.3:
            ways = random.normal(size=(3, 3))
            ways /= np.linalg.norm(ways, axis=1)[:, None]
            bounds = tuple((*way, random.choice((0.0, 0.02, 0.3))) for way in ways.tolist())
        path.append(limits.move(place, bounds))
    within(path, change=10.0 * ACCELERATION) if len(path) > 1 else None


def test_two_ticks_that_brake_almost_opposite_ways_come_near_to_ten_times() -> None:
    limits = MotionLimits(SPEED, 1.0, JERK, TICK)
    limits.begin(0.0, 0.0, 0.0)
    for tick in range(2000):  # at 0.2 m/s, once it has caught up
        limits.move((2e-4 * tick, 0.0, 0.0))
    assert limits.speed == pytest.approx(0.2, abs=1e-3)
    sideways, ahead = math.cos(math.radians(5.0)), math.sin(math.radians(5.0))
    told = []
    for tick, side in ((2000, sideways), (2001, -sideways)):
        limits.move((2e-4 * tick, 0.0, 0.0), ((ahead, side, 0.0, 0.0), UNBOUNDED, UNBOUNDED))
        told.append(np.array(limits.acceleration))
    assert [np.linalg.norm(one) for one in told] == pytest.approx([5.0, 5.0])
    assert 9.9 < np.linalg.norm(told[1] - told[0]) < 10.0


@settings(max_examples=25)
@given(streams, st.integers(0, 1000))
def test_on_a_line_it_changes_by_six_times_at_most(parts: Any, seed: int) -> None:
    random, limits = np.random.default_rng(seed), MotionLimits(SPEED, ACCELERATION, JERK, TICK)
    limits.begin(0.0)
    path = [(0.0, 0.0, 0.0)]
    for place in streamed(parts, seed):
        path.append((limits.update(place[0], random.choice((0.0, 0.02, 0.3, math.inf))), 0.0, 0.0))
    within(path, change=6.0 * ACCELERATION) if len(path) > 1 else None


@pytest.mark.parametrize("seed", range(10))
def test_what_is_no_number_anywhere_leaves_a_path_of_numbers(seed: int) -> None:
    random, limits = np.random.default_rng(seed), MotionLimits(SPEED, ACCELERATION, JERK, TICK)
    limits.begin(0.0, 0.0, 0.0)
    path = [(0.0, 0.0, 0.0)]
    for _ in range(400):
        asked = random.normal(0.0, 0.1, 18)
        wrong = random.random(18) < 0.03
        asked[wrong] = random.choice((math.nan, math.inf, -math.inf, 1e300), wrong.sum())
        numbers = asked.tolist()
        bounds = tuple(tuple(numbers[at : at + 4]) for at in (6, 10, 14))
        path.append(limits.move(tuple(numbers[:3]), bounds, tuple(numbers[3:6])))
    within(path)


def test_on_a_line_a_shift_or_a_bound_that_is_no_number_leaves_a_position() -> None:
    for upwards, shifted in ((math.inf, math.nan), (math.inf, math.inf), (math.nan, 0.0), (-math.inf, -math.inf)):
        limits = MotionLimits(SPEED, ACCELERATION, JERK, TICK)
        limits.begin(0.0)
        assert math.isfinite(limits.update(0.01, upwards, shifted))
        assert [limits.update(0.01) for _ in range(500)][-1] == pytest.approx(0.01, abs=1e-9)


def test_a_line_is_the_case_of_one_direction() -> None:
    line, space = (MotionLimits(SPEED, ACCELERATION, JERK, TICK) for _ in range(2))
    line.begin(0.0)
    space.begin(0.0, 0.0, 0.0)
    way = (0.0, 0.6, -0.8)
    for tick in range(1500):
        wanted = 0.02 * math.sin(tick / 40.0) if tick % 300 < 250 else 0.05
        upwards = 0.03 if tick % 400 > 300 else math.inf
        told = line.update(wanted, upwards)
        place = space.move((0.0, 0.6 * wanted, -0.8 * wanted), ((*way, upwards), UNBOUNDED, UNBOUNDED))
        np.testing.assert_allclose(place, told * np.array(way), atol=1e-9)


def test_a_stream_that_jumps_is_no_motion_to_follow() -> None:
    """One that is set 60 mm away, of which the path is told nothing, leads it towards itself, and never away."""
    limits = MotionLimits(SPEED, ACCELERATION, JERK, TICK)
    limits.begin(0.0, 0.0, 0.0)
    path = [limits.move((0.0, 0.0, 0.006), shifted=(0.0, 0.0, 0.065))]
    path += [limits.move((0.0, 0.0, 0.006)) for _ in range(100)]
    heights = [z for _, _, z in path]
    assert min(heights) > -1e-4, "a speed of 59 m/s away would lead it 2 mm the other way"
    assert heights[-1] == pytest.approx(0.006, abs=1e-4)


def test_what_would_go_deeper_than_told_brakes_five_times_as_hard_and_what_goes_aside_does_not() -> None:
    down = ((0.0, 0.0, -1.0, math.inf), UNBOUNDED, UNBOUNDED)
    for way, hardest in (((0.0, 0.0, -1.0), EMERGENCY * ACCELERATION), ((1.0, 0.0, 0.0), ACCELERATION)):
        limits = MotionLimits(SPEED, ACCELERATION, JERK, TICK)
        limits.begin(0.0, 0.0, 0.0)
        path = [(0.0, 0.0, 0.0)]
        for tick in range(400):  # at 0.2 m/s, and then it is to stand at once
            far = 2e-4 * min(tick, 200)
            path.append(limits.move((way[0] * far, 0.0, way[2] * far), down))
        along = np.array(path) @ np.array(way)
        assert along[-1] == pytest.approx(0.04, abs=1e-6)
        braked = -np.diff(along, 2).min() / TICK**2
        assert braked <= hardest * (1 + 1e-6)
        assert (braked > 4.0 * ACCELERATION) == (hardest > ACCELERATION)
        assert along.max() - 0.04 < (2e-4 if hardest > ACCELERATION else 1e-3)


# --- the follower -----------------------------------------------------------------------------------------------------


def test_the_meshes_are_sharp_and_wound_outwards() -> None:
    assert SCENES["cube"].surface.contact((X, Y, Z + 0.01)).depth == pytest.approx(-0.01)
    assert SCENES["cube"].surface.contact((X, Y, Z - 0.01)).depth == pytest.approx(0.01)
    assert SCENES["groove"].surface.contact((X + 0.01, Y, Z - 0.001)).depth < 0.0
    for name, up in (("groove", 1.0), ("hill", 1.0), ("cube", 0.0), ("thin plate", 0.0)):
        assert SCENES[name].surface.facing() == pytest.approx((0.0, 0.0, up))


HOVER, DEEP, FELT = 0.015, -0.05, 0.05


def true_top(scene: Scene, fixture: tuple[float, ...]) -> float:
    """Height of a fixture's surface over the world's origin [m]."""
    pose = Pose.from_rotation_vector(fixture[3:], fixture[:3]).inverse()
    heights = np.arange(0.06, -0.06, -1e-4).tolist()
    return next(z for z in heights if scene.surface.contact(tuple(pose.apply((0.0, 0.0, z)))).depth > 0.0)


class Driven(CommandedInSpace):
    """A follower with the simulated arm over a scene that stands elsewhere than believed."""

    def __init__(
        self, scene: Scene, *, seed: int = 0, elsewhere: float = 1.0, inside: float | None = None, **changes: Any
    ) -> None:
        material = make_material(changes.pop("material", "hunt-crossley"))
        world = SpatialWorld(scene, material, displacement=0.01 * elsewhere, turn=0.1 * elsewhere, bump=0.0, seed=seed)
        height = HOVER if inside is None else true_top(scene, world.fixture()) - inside
        robot = GantryArm(world.touch, world.fixture, seed=seed, start=(0.0, 0.0, height))
        super().__init__(robot, SessionSettings(scene="plane", **changes), scene.surface, scene.nominal)
        self.beliefs, self.blind = 0, ""

    def belief(self, pose: tuple[float, ...], deviation: float) -> FixtureBelief:
        self.beliefs += 1
        covariance = tuple((deviation**2 * np.eye(6)).ravel().tolist())
        return FixtureBelief(VERSION, self.beliefs, 0, pose, covariance, 0.1, 1, 0, 0, "", 1)

    def go(self, place: Vector | None, *, blind: str = "", **asked: Any) -> None:
        self.blind = blind
        self.tick(place, **asked)

    def seen(self, sample: SpatialSample) -> SpatialSample:
        return sample._replace(**{self.blind: (math.nan, 0.0, 0.0)}) if self.blind else sample

    def glide(self, begin: Vector, end: Vector, ticks: int, stay: int = 0) -> None:
        for tick in range(ticks + stay):
            place = np.array(begin) + np.subtract(end, begin) * min((tick + 1) / ticks, 1.0)
            self.go(tuple(place.tolist()))

    def press(self, place: Vector, least: float, ticks: int = 8000) -> None:
        """Told to be at a place under the surface [m] until so much is felt there [N]."""
        for _ in range(ticks):
            if self.forces and self.forces[-1] > least:
                return
            self.go(place)
        raise AssertionError(f"only {max(self.forces)} N in {ticks} ticks")


TROUBLES = ("", "", "", "silence", "stop", "release", "force", "place", "belief", "belief", "restart", "dither")


FIRST = st.sampled_from(("follow", "guarded"))


def moved(name: str, parts: Any, seed: int, inside: float | None, first_touch: str) -> None:
    driven = Driven(SCENES[name], seed=seed, inside=inside, first_touch=first_touch)
    random = np.random.default_rng(seed)
    before = np.array(driven.sample.place)
    for target, ticks, trouble in parts:
        for tick in range(ticks + 60):
            place = before + (np.array(target) - before) * min((tick + 1) / ticks, 1.0)
            if trouble == "dither":
                place = place + random.normal(0.0, 3e-4, 3)
            asked: dict[str, Any] = {}
            if trouble == "belief" and tick % 25 == 0:
                wrong = [*random.uniform(-0.02, 0.02, 3), *random.uniform(-0.3, 0.3, 3)]
                asked["beliefs"] = [
                    driven.belief(tuple(np.add(driven.nominal, wrong).tolist()), 10 ** -random.uniform(2, 5))
                ]
            if trouble in ("stop", "release") and tick == 5:
                asked[trouble] = "test" if trouble == "stop" else True
            if trouble in ("force", "place") and tick % 10 == 3:
                asked["blind"] = trouble
            if trouble == "restart" and tick == 30:
                within(driven.path)
                driven.begin()
            silent = trouble == "silence" and tick > 10
            driven.go(None if silent else tuple(place.tolist()), **asked)
        before = np.array(target)
    within(driven.path, change=10.0 * ACCELERATION)
    assert inside is None or max(driven.forces[:3]) > FELT, "it begins in contact"


def test_where_the_robot_is_told_to_go_it_goes_and_touches() -> None:
    driven = Driven(SCENES["cube"], seed=3)
    for tick in range(3301):
        driven.go((1e-5 * min(max(tick - 2000, 0), 300), 0.0, max(0.016 - 3e-5 * tick, -0.006)))
    assert max(driven.forces) > 1.0
    assert math.dist(driven.path[-1], (0.003, 0.0, -0.006)) < 1e-6
    within(driven.path)


@pytest.mark.parametrize(
    ("name", "examples"),
    [
        *((name, 8) for name in ("hill", "cube", "groove")),
        *(pytest.param(name, 120, marks=pytest.mark.long) for name in SCENES),
    ],
)
def test_no_told_place_is_beyond_the_limits(name: str, examples: int) -> None:
    @settings(max_examples=examples, suppress_health_check=[HealthCheck.too_slow])
    @given(parts_with(TROUBLES), st.integers(0, 100), st.sampled_from((1e-3, None)), FIRST)
    @example([((0.0, 0.0, -0.01), 40, "")], 0, 1e-3, "follow")
    def motions(parts: Any, seed: int, inside: float | None, first_touch: str) -> None:
        moved(name, parts, seed, inside, first_touch)

    motions()


# --- what was found ---------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "depth", "least"), [("phantom", 0.008, 6.0), pytest.param("hill", 0.012, 4.0, marks=pytest.mark.long)]
)
def test_a_hand_that_slides_off_the_edge_moves_the_robot_no_further_than_the_limits(
    name: str, depth: float, least: float
) -> None:
    """The nearest point and the normal are others there from one tick to the next; it is pressed first."""
    driven = Driven(SCENES[name], elsewhere=0.0, first_touch="follow")
    deep, aside = (0.0, 0.0, 0.004 - depth), (0.06, 0.0, 0.004 - depth)
    driven.press(deep, least)
    driven.glide(deep, deep, 300)
    assert driven.path[-1][2] < deep[2] + 1e-3, "it is as deep as that before it slides"
    driven.glide(deep, aside, 300, 900)
    within(driven.path)
    assert max(driven.forces) < 15.0
    assert driven.forces[-1] == 0.0, "it is over the edge"
    assert math.dist(driven.path[-1], aside) < 1e-5, "it comes to the command all the same"


@pytest.mark.parametrize(
    ("name", "material", "seed", "first_touch", "least"),
    [
        ("hill", "kelvin-voigt", 5, "follow", 9.0),
        pytest.param("hill", "kelvin-voigt", 3, "guarded", 4.0, marks=pytest.mark.long),
        pytest.param("hill", "hunt-crossley", 2, "follow", 4.0, marks=pytest.mark.long),
        pytest.param("phantom", "hunt-crossley", 1, "follow", 6.0, marks=pytest.mark.long),
    ],
)
def test_a_hand_deep_under_the_surface_that_goes_sideways_meets_no_force_above_the_ceiling(
    name: str, material: str, seed: int, first_touch: str, least: float
) -> None:
    driven = Driven(SCENES[name], seed=seed, elsewhere=2.0, material=material, first_touch=first_touch)
    deep, aside = (0.0, 0.0, DEEP), (0.05, 0.0, DEEP)
    driven.press(deep, 1.0)
    driven.glide(deep, deep, 200)
    before = len(driven.forces)
    driven.glide(deep, aside, 500, 200)
    driven.glide(aside, (-0.05, 0.03, -0.04), 1000, 300)
    driven.glide((-0.05, 0.03, -0.04), (0.0, 0.0, 0.03), 400, 100)
    within(driven.path)
    assert max(driven.forces[before:]) > least, "it slides in contact"
    assert max(driven.forces) < 15.0


def test_a_normal_that_flips_moves_nothing_at_once() -> None:
    """A hand 30 mm deep slides off the border; the robot was held back over it, and is at first."""
    driven = Driven(SCENES["hill"], elsewhere=0.0, first_touch="follow", material="kelvin-voigt")
    for tick in range(1300):
        driven.go((0.0395, 0.0, max(0.02 - 5e-5 * tick, -0.03)))
    held = driven.path[-1]
    deep = len(driven.path)
    for tick in range(60):
        driven.go((0.0395 + 5e-5 * min(tick, 20), 0.0, -0.03))
    told = np.array(driven.path[deep:]) - held
    assert held[2] > -0.02, "it is held back"
    assert np.abs(told[:, 2]).max() < 0.06 * 0.12, "not the 20 mm and more between one side and the other"


@pytest.mark.parametrize("guarded", [False, True])
def test_the_first_tick_of_a_follower_on_a_line_begins_at_the_robot(guarded: bool) -> None:
    specification = RobotSpecification(TICK, 15.0, 5e-6, 0.0, 0.0, 0.0, 0.02, 0.0, 300.0, (-0.1, 0.1))
    state = line_follower.start(specification, SessionSettings())
    sample = RobotSample(0.030, 8.0, 0.0, math.nan, math.nan, 0.030, False)
    commands = [Command(VERSION, 100 + tick, tick * MS, -0.02, 0, guarded, "leader", 77) for tick in range(3)]
    path = [0.03]
    for tick in range(100):
        inputs = line_follower.Inputs(commands if tick == 0 else [], sample, MS, 0)
        path.append(line_follower.step(state, inputs, (1000 + tick) * MS)[1].desired_position)
    within([(position, 0.0, 0.0) for position in path])


def test_a_robot_that_does_not_say_where_it_is_is_told_nothing_yet() -> None:
    driven = Driven(SCENES["hill"])
    driven.go((0.0, 0.0, 0.01), blind="place")
    assert not any(map(math.isfinite, driven.path[-1]))
    here = driven.sample.place
    driven.go((0.0, 0.0, 0.01))
    assert math.dist(here, driven.path[-1]) <= ACCELERATION * TICK**2 * (1 + 1e-6)

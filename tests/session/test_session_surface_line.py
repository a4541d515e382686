"""The compiled line of a surface against the same in Python, to the last bit, and surfaces of Python's own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.messages import VERSION, Command, FixtureBelief
from foretouch.quantities.pose import RigidMotion, Vector, norm, scaled, subtract
from foretouch.rendering import Renderer
from foretouch.rendering.surfaces import (
    HeightField,
    OffsetSurface,
    Plane,
    Surface,
    SurfaceContact,
    SurfaceProxy,
    TriangleMesh,
)
from foretouch.rendering.whole import Now, OverSurface
from foretouch.robot import RobotSample, SpatialSample
from foretouch.session import SessionSettings, simulate
from foretouch.session.runners.warm_up import SPECIFICATION
from foretouch.session.spatial import make_scene
from foretouch.session.spatial.course import ClosestPoint, SurfaceLine
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.spatial.scenes import MIDDLE, NOMINAL
from foretouch.session.steps import follower

TETRAHEDRON = TriangleMesh(
    0.03 * np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]), [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)]
)
HILL = make_scene("hill").surface
SURFACES = {"plane": Plane((0.0, 0.001, 0.0), (0.1, 0.0, 2.0)), "hill": HILL, "mesh": TETRAHEDRON}
SPHERES = {f"sphere on {name}": OffsetSurface(surface, 0.004) for name, surface in SURFACES.items()}
NOWHERE = (math.nan, math.nan, math.nan)
MS = 1_000_000


class InPython:
    """What a line is to do."""

    def __init__(self, surface: Surface, pose: Sequence[float], leads: bool) -> None:
        self.leads, self.offset, self.proxy, self.radius = leads, 0.0, SurfaceProxy(surface.bare), surface.radius
        self.motion = RigidMotion.from_numbers(pose)
        self.place: Vector = NOWHERE
        self.closest: ClosestPoint | None = None

    def believe(self, pose: Sequence[float]) -> None:
        self.motion = RigidMotion.from_numbers(pose)
        if self.closest is not None:
            self.follow(self.place)

    def follow(self, place: Vector) -> ClosestPoint:
        if not all(map(math.isfinite, place)):
            if self.closest is not None:
                return self.closest
            place = self.motion.apply((0.0, 0.0, 0.1))
        before, moved, self.place = self.closest, norm(subtract(place, self.place)), place
        contact = self.proxy.follow(self.motion.apply_back(place))
        point, normal = self.motion.apply(contact.point), self.motion.rotate(contact.normal)
        if contact.depth < 0.0:
            away = subtract(place, point)
            normal = scaled(away, 1.0 / norm(away)) if norm(away) > 1e-9 else normal
        contact = contact._replace(depth=contact.depth + self.radius)
        if self.leads and before is not None and abs(contact.depth - before.depth) > moved + 1e-9:
            self.offset += before.depth - contact.depth
        self.closest = ClosestPoint(contact.depth, contact.depth + self.offset, normal, point, contact.point)
        return self.closest


near, turn = st.floats(-0.05, 0.05), st.floats(-0.5, 0.5)
places = st.tuples(near, near, near) | st.sampled_from([NOWHERE, (math.inf, 0.0, 0.0), (0.0, 5e3, 0.0), (0.0,) * 3])
poses = st.tuples(near, near, near, turn, turn, turn)


@pytest.mark.parametrize("leads", [True, False])
@pytest.mark.parametrize("name", SURFACES | SPHERES)
@given(places=st.lists(places, min_size=1, max_size=12), beliefs=st.lists(poses, min_size=2, max_size=3))
@pytest.mark.first
def test_a_compiled_line_is_the_one_in_python_to_the_last_bit(
    name: str, leads: bool, places: list[Vector], beliefs: list[Sequence[float]]
) -> None:
    surface, first = (SURFACES | SPHERES)[name], beliefs[0]
    line, same = SurfaceLine(surface, first, leads=leads), InPython(surface, first, leads)
    assert line.closest is None
    for number, goal in enumerate(places):
        if number and number % 4 == 0:
            for belief in beliefs:
                if line.believe(belief):
                    same.believe(belief)
        start = same.place if math.isfinite(same.place[0] + goal[0]) else goal
        for part in np.linspace(0.0, 1.0, 7).tolist():  # a motion, in which the god object has a memory
            place = tuple((1.0 - part) * a + part * b for a, b in zip(start, goal, strict=True))
            np.testing.assert_equal(line.follow(place), same.follow(place))
        np.testing.assert_equal((line.closest, line.offset), (same.closest, same.offset))
    line.restart()
    same.proxy.restart()
    np.testing.assert_equal(line.follow(places[0]), same.follow(places[0]))


class OwnPlane(Plane):
    """Of a user, who writes Python."""

    asked = 0

    def follow(self, memory: np.ndarray, x: float, y: float, z: float) -> SurfaceContact:
        self.asked += 1
        return super().follow(memory, x, y, z)


class OwnField(HeightField):
    """The same contacts, by Python."""

    def follow(self, memory: np.ndarray, x: float, y: float, z: float) -> SurfaceContact:
        return super().follow(memory, x, y, z)


class OwnHill(HeightField):
    def follow(self, memory: np.ndarray, x: float, y: float, z: float) -> SurfaceContact:
        contact = super().follow(memory, x, y, z)
        return contact._replace(depth=contact.depth + 1e-3)


@given(st.lists(places, min_size=1, max_size=12), poses)
def test_a_surface_of_python_is_asked_itself(places: list[Vector], belief: Sequence[float]) -> None:
    surface = OwnPlane((0.0, 0.001, 0.0), (0.1, 0.0, 2.0))
    own, line = SurfaceLine(surface, (0.0,) * 6), SurfaceLine(SURFACES["plane"], (0.0,) * 6)
    for number, place in enumerate([*places, (0.0, 0.0, 0.01)]):  # of places beyond 1 km no surface is asked
        if number == 3:
            assert own.believe(belief) == line.believe(belief)
        np.testing.assert_equal(own.follow(place), line.follow(place))
    np.testing.assert_equal(own.offset, line.offset)
    assert surface.asked > 0


def test_a_part_of_a_surface_that_is_written_anew_counts() -> None:
    heights = np.zeros((3, 3))
    own, line = SurfaceLine(OwnHill(heights, 0.1), (0.0,) * 6), SurfaceLine(HeightField(heights, 0.1), (0.0,) * 6)
    for height in (0.01, 0.002, -0.003):
        place = (0.1, 0.12, height)
        assert own.follow(place).depth == pytest.approx(line.follow(place).depth + 1e-3, abs=1e-15)


@pytest.mark.parametrize("radius", [0.0, 0.004])
@pytest.mark.parametrize("own", [OwnPlane(MIDDLE), OwnField(0.01 * np.eye(5), 0.02, (0.035, -0.04))])
@pytest.mark.first
def test_a_follower_on_a_surface_of_python_is_the_compiled_one(own: Plane | HeightField, radius: float) -> None:
    if isinstance(own, Plane):
        same: Surface = Plane(MIDDLE)
    else:
        same = HeightField(0.01 * np.eye(5), 0.02, (0.035, -0.04))
    settings = SessionSettings(scene="plane", material="hunt-crossley")
    probes = [ProbeInSpace(OffsetSurface(surface, radius), NOMINAL) for surface in (own, same)]
    states = [follower.start(SPECIFICATION, settings, probe=probe) for probe in probes]
    random, here, far, told = np.random.default_rng(4), np.array((0.0, 0.0, 0.02)), np.zeros(3), []
    for tick in range(1, 1500):
        if tick % 100 == 0:
            far = np.array((*random.uniform(-0.03, 0.03, 2), 0.02 if tick % 200 else -0.006))
        here = here + 0.02 * (far - here)
        force = (*random.normal(0.0, 0.3, 2).tolist(), 600.0 * max(-here[2], 0.0) + random.normal(0.0, 0.01))
        place = NOWHERE if tick in (700, 701) else tuple(here.tolist())
        command = Command(VERSION, tick, tick * MS, 0.0, 0, holder="test", epoch=1, place=tuple(far.tolist()))
        pose = (NOMINAL[0] + 1e-6 * tick, *NOMINAL[1:5], 1e-5 * tick)
        belief = FixtureBelief(
            VERSION, tick, 0, pose, tuple(1e-8 * np.eye(6).ravel()), 0.0, tick, tick // 500, 0, "", 1
        )
        sample = SpatialSample(place, force, force, place, (), False)
        inputs = follower.Inputs([command], sample, MS, 0, beliefs=[belief] if tick % 50 == 0 else [])
        first, second = (follower.step(state, inputs, tick * MS)[1] for state in states)
        assert repr(first.telemetry) == repr(second.telemetry)  # one NaN is not another
        told.append(first.desired_position)
    assert np.ptp(told, axis=0).min() > 0.002
    assert states[0].probe.friction.updates == states[1].probe.friction.updates > 0
    assert states[0].probe.told[3] == states[1].probe.told[3] > 0


@pytest.mark.parametrize(("scene", "model"), [("", "contact-map"), ("hill", "contact-map"), ("hill", "kelvin-voigt")])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(1, 12))])
@pytest.mark.first
def test_a_tick_as_a_whole_is_its_stages_one_by_one(scene: str, model: str, seed: int) -> None:
    """Whatever comes: commands late and in bunches, another leader, silence, stops, releases, sensors that fail."""
    first_touch = "guarded" if seed % 2 else "follow"
    settings = SessionSettings(scene=scene, material="hunt-crossley", model=model, first_touch=first_touch)
    surface = make_scene(scene).surface if scene else None
    states = [
        follower.start(SPECIFICATION, settings, probe=None if surface is None else ProbeInSpace(surface, NOMINAL))
        for _ in range(2)
    ]
    states[1].probe.whole = None
    random, now, sequence, epoch, silent, faulty = np.random.default_rng(seed), 0, 0, 1, 0, 0
    here, telemetry, felt = np.array((0.0, 0.0, -0.004)), None, 0.0
    far, acknowledged = here.copy(), 0
    for tick in range(1, 4000):
        now += MS if random.random() > 0.001 else 20 * MS
        if tick % 300 == 0:
            far = np.array((*random.uniform(-0.01, 0.01, 2), random.uniform(-0.003, 0.006)))
        if random.random() < 0.0008:
            silent = int(random.integers(20, 1200))
            epoch += silent > 1000
            sequence = 0 if silent > 1000 else sequence
        silent, faulty, commands = max(silent - 1, 0), max(faulty - 1, 0), []
        for _ in range(0 if silent or tick < 30 else random.choice((0, 1, 1, 1, 2))):
            sequence += 1
            told = (0, 1) if telemetry is None else (telemetry.sequence, telemetry.run)
            place = tuple(far * (1.0, 1.0, -1.0)) if scene else ()
            commands.append(
                Command(
                    VERSION, sequence, now, far[2], acknowledged, random.random() < 0.01, "test", epoch, place,
                    run=told[1], telemetry_sequence=told[0],
                )
            )  # fmt: skip
        if random.random() < 0.001:
            faulty = int(random.integers(1, 200))
        force = 2000.0 * max(here[2], 0.0) + random.normal(0.0, 0.01) if not faulty % 2 else math.nan
        felt = max(felt, force)
        x, y, z = (here + random.normal(0.0, 2e-6, 3)).tolist()
        sample = SpatialSample((x, y, -z), (0.1, 0.0, force), (0.0, 0.0, force), (x, y, -z), (), False)
        if not scene:
            sample = RobotSample(z, force, 0.0, 0.0, z, z, False)
        stop, release = "test" if random.random() < 0.0003 else "", bool(random.random() < 0.01)
        inputs = follower.Inputs(commands, sample, MS, 0, stop, release)
        one, other = (follower.step(state, inputs, now)[1] for state in states)
        assert repr(one) == repr(other)  # one NaN is not another
        telemetry, acknowledged = one.telemetry, acknowledged if one.model is None else one.model.sequence
        went = np.array((x, y, -one.desired_position[2]) if scene else (x, y, one.desired_position))
        here = here + 0.3 * (went - here) if np.isfinite(went).all() else here
    assert felt > 1.0
    assert states[0].learner.estimator.updates > 100


AT_ONCE = [
    {
        "scene": "hill",
        "material": "hunt-crossley",
        "fusion": "contact",
        "loss": 0.2,
        "jitter": 0.03,
        "position_delay": 0.0,
    },
    {"scene": "phantom", "fusion": "contact", "grip": "normal", "clutch": "3:3.2", "bump": 4.0, "position_scale": 0.5},
    {"scene": "plane", "model": "kelvin-voigt", "fusion": "none", "grip": "soft", "probe_radius": 0.004},
]


@pytest.mark.parametrize("changes", AT_ONCE, ids=lambda changes: changes["scene"])
@pytest.mark.long
def test_a_leaders_tick_at_once_is_that_which_waits_for_python(changes: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    at_once, settings, done = Renderer.go_over, SessionSettings(force_delay=0.1, **changes), []

    def counted(renderer: Renderer, hand: OverSurface, now: Now) -> tuple:
        said = at_once(renderer, hand, now)
        if hand[0]["closest"]["depth"][0] > 0.0:
            done.append(said[1] is not None)
        return said

    monkeypatch.setattr(Renderer, "go_over", counted)
    whole = simulate(settings, duration=5.0).log
    assert len(done) > 100
    assert np.mean(done) > 0.85  # the others had a message
    monkeypatch.setattr(Renderer, "go_over", lambda renderer, hand, now: at_once(renderer, hand, (*now[:4], True)))
    parts = simulate(settings, duration=5.0).log
    for name in ("leader", "leader_space", "follower_space"):
        one, other = getattr(whole, name), getattr(parts, name)
        for column in one.dtype.names:
            if column != "compute_ns":
                np.testing.assert_array_equal(one[column], other[column], err_msg=f"{name}.{column}")

"""What the direction of the force on a probe that slides tells of a fixture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.quantities import Pose
from foretouch.vision import ContactSeen, Fixture, FixtureFilter, FusionSettings, ImageSeen, SlideSeen, Verdict
from foretouch.vision.seen import turning

S = FusionSettings()
DEVIATION = 0.009
COVARIANCE = np.diag([2e-4, 2e-4, 2e-4, 2e-3, 2e-3, 2e-3]) ** 2
Array = np.ndarray
RANDOM = np.random.default_rng(3)


@dataclass(frozen=True)
class Ball:
    """A round surface, whose normal turns by 20 degrees in 2 cm."""

    middle: tuple[float, float, float] = (0.0, 0.0, -0.055)
    radius: float = 0.055
    relief: float = 0.02

    def height(self, point: Array) -> tuple[float, Array]:
        away = np.asarray(point) - self.middle
        size = float(np.linalg.norm(away))
        return size - self.radius, away / size

    def holds(self, point: Array) -> bool:
        return bool(np.isfinite(point).all())


def rubbed(normal: Array, motion: Array, friction: float) -> tuple[Array, Array]:
    """Directions of force and motion of a probe that slides over a surface with this normal."""
    along = motion - (motion @ normal) * normal
    along /= np.linalg.norm(along)
    force = normal - friction * along
    return force / np.linalg.norm(force), along


def slide(
    true: Pose,
    time: float,
    fixture: Ball | Fixture,
    mu: float = 0.4,
    place: tuple[float, float] = (0.0, 0.0),
    motion: tuple[float, float] = (1.0, 0.0),
) -> SlideSeen:
    """At a place of the fixture's plane, with noise."""
    inner = np.array([*place, 0.0])
    height, normal = fixture.height(inner)
    force, along = rubbed(true.rotation @ normal, true.rotation @ np.array([*motion, 0.0]), mu)
    force = force + RANDOM.normal(0.0, 0.5 * DEVIATION, 3)
    point = true.apply(inner - height * normal)
    return SlideSeen(time, tuple(point), tuple(force / np.linalg.norm(force)), tuple(along), DEVIATION)


def to_and_fro(time: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Place [m] and direction of a hand that goes over rows, at 30 mm/s."""
    row, within = divmod(time, 1.5)
    sign = 1.0 if row % 2 == 0 else -1.0
    return (sign * (0.03 * within - 0.0225), 0.006 * (row % 6) - 0.015), (sign, 0.0)


def slid(known: FixtureFilter, true: Pose, begin: float, end: float, mu: float = 0.4) -> list[Verdict]:
    """Slides over a fixture that stands elsewhere, 20 in a second; what became of each."""
    times = np.arange(begin, end, 0.05).tolist()
    return [known.update(slide(true, time, known.fixture, mu, *to_and_fro(time - begin))) for time in times]


def seen_for(seconds: float, fixture: Ball | Fixture, mu: float = 0.4) -> FixtureFilter:
    """A filter that saw the fixture where it is believed, while a probe slid over it."""
    known = FixtureFilter(fixture, Pose.identity())
    for time in np.arange(0.0, seconds, 0.05).tolist():
        error = RANDOM.multivariate_normal(np.zeros(6), COVARIANCE)
        known.update(ImageSeen(time, Pose.exp(error), COVARIANCE))
        known.update(slide(Pose.identity(), time + 0.01, fixture, mu, *to_and_fro(time)))
    return known


def tilt(known: FixtureFilter, true: Pose, now: float) -> float:
    """Angle between the believed and the true normal under the middle of the rows [degrees]."""
    poses = known.state(now).pose, true
    one, other = (pose.rotation @ known.fixture.height(pose.inverse().apply(np.zeros(3)))[1] for pose in poses)
    return math.degrees(math.acos(min(1.0, one @ other)))


@given(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.floats(0.0, 6.2), st.floats(0.0, 1.2), st.floats(-0.5, 0.5))
def test_the_normal_is_that_of_a_probe_that_rubs(a: float, b: float, turn: float, mu: float, press: float) -> None:
    normal = np.array([a, b, 1.0]) / math.sqrt(a * a + b * b + 1.0)
    force, along = rubbed(normal, np.array([math.cos(turn), math.sin(turn), 0.0]), mu)
    moving = along + press * normal  # it presses and lifts while it slides
    seen = SlideSeen(0.0, (0.0, 0.0, 0.0), tuple(force), tuple(moving / np.linalg.norm(moving)), DEVIATION)
    if abs(np.linalg.norm(np.cross(seen.force, seen.motion))) < 0.1 or press * mu > 0.9:
        return
    found, derivative = seen.normal(mu)
    assert found == pytest.approx(normal, abs=1e-9)
    step = 1e-6
    numeric = (seen.normal(mu + step)[0] - seen.normal(mu - step)[0]) / (2.0 * step)
    assert derivative == pytest.approx(numeric, abs=1e-8)


def test_the_derivative_of_the_normal_is_that_by_finite_differences() -> None:
    ball, point = Ball(), np.array([0.012, -0.007, -0.001])
    _, derivative, bent = turning(ball, point, np.zeros((6, 6)))
    assert bent == 0.0
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-6

        def turned(change: Array) -> Array:
            """The fixture's normal at the same point of the world, seen from where the fixture was."""
            moved = Pose.exp(change)
            return moved.rotation @ ball.height(moved.inverse().apply(point))[1]

        numeric = (turned(step) - turned(-step)) / 2e-6
        assert derivative[:, axis] == pytest.approx(numeric, rel=3e-4, abs=3e-3), axis  # over 1 mm it turns less
    wide = turning(ball, point, np.diag([5e-3**2] * 3 + [0.05**2] * 3))[2]
    assert 0.0 < wide < turning(ball, point, np.diag([0.02**2] * 3 + [0.17**2] * 3))[2] < 0.1


def test_while_images_come_slides_tell_of_friction_alone() -> None:
    known = seen_for(2.0, Ball())
    before = known.state(2.0)
    assert before.friction == pytest.approx(0.4, abs=0.01)
    verdict = known.update(slide(Pose.identity(), 1.99, Ball()))
    after = known.state(2.0)
    assert verdict is Verdict.RUBBED
    assert np.array_equal(after.pose.translation, before.pose.translation)
    assert np.array_equal(after.pose.rotation, before.pose.rotation)
    assert np.array_equal(after.covariance[:12, :12], before.covariance[:12, :12])


@pytest.mark.parametrize("fixture", [Fixture(), Ball()], ids=["flat", "round"])
def test_a_bump_that_nobody_sees_is_felt_and_its_tilt_found(fixture: Ball | Fixture) -> None:
    known, true = seen_for(2.0, fixture), Pose.exp([0.0, 0.0, 0.0, 0.04, -0.035, 0.0])
    assert tilt(known, Pose.identity(), 2.0) < 0.3
    verdicts = slid(known, true, 3.1, 6.1)
    known.update(ContactSeen(6.1, tuple(true.apply((0.0, 0.0, 0.0))), 2e-4))
    assert tilt(known, true, 6.1) < 0.5
    if fixture == Fixture():  # a round one is felt as one that stands 3 mm aside, which images do not rule out
        assert Verdict.REOPENED in verdicts[:15]
        state = known.state(6.1)
        error = (state.pose.inverse() @ true).log()
        assert error @ np.linalg.solve(state.pose_covariance, error) < 22.5  # 99.9 % of a chi-square of 6


def test_a_fixture_that_stays_is_not_opened_by_slides_nor_by_a_single_strange_one() -> None:
    known = seen_for(2.0, Ball())
    assert set(slid(known, Pose.identity(), 3.1, 6.1)) == {Verdict.USED}
    strange = slide(Pose.exp([0, 0, 0, 0.2, 0, 0]), 6.1, Ball())
    assert known.update(strange) is Verdict.REFUSED
    assert set(slid(known, Pose.identity(), 6.15, 7.0)) == {Verdict.USED}


def test_images_that_come_again_are_believed_though_a_probe_slides() -> None:
    known, true = seen_for(2.0, Fixture()), Pose.exp([0.004, -0.003, 0.001, 0.0, 0.0, 0.05])  # along the surface
    verdicts = []
    for time in np.arange(3.5, 5.5, 0.05).tolist():
        known.update(slide(true, time, known.fixture, 0.4, *to_and_fro(time)))
        error = RANDOM.multivariate_normal(np.zeros(6), COVARIANCE)
        verdicts.append(known.update(ImageSeen(time + 0.01, true @ Pose.exp(error), COVARIANCE)))
    assert Verdict.REOPENED in verdicts[:6]
    assert known.state(5.5).pose.distance(true)[0] < 5e-4


@pytest.mark.parametrize("degrees", [1.0, 3.0])
def test_what_a_sensor_that_is_mounted_aslant_tells_is_not_believed_too_far(degrees: float) -> None:
    known, aslant = seen_for(2.0, Fixture()), Pose.exp([0.0, 0.0, 0.0, math.radians(degrees), 0.0, 0.0])
    slid(known, aslant, 3.1, 9.1)  # as if it had been tilted
    state = known.state(9.1)
    tilt = math.sqrt(float(np.diag(state.pose_covariance)[3]))
    assert tilt >= math.radians(2.0) * (1.0 - 1e-9)
    error = float(np.abs(state.pose.rotation_vector()).max())
    assert error < 2.0 * tilt
    away = np.array([0.035, 0.035, 0.0])  # where nothing was felt
    assert abs(state.pose.apply(away)[2]) < 3.0 * tilt * 0.05


def test_slides_beside_the_specimen_tell_nothing() -> None:
    known = seen_for(2.0, Fixture())
    far = Pose.exp([0.3, 0.0, 0.0, 0.1, 0.1, 0.0])
    assert set(slid(known, far, 3.1, 5.1)) == {Verdict.REFUSED}


def test_friction_is_told_from_a_slope_by_going_to_and_fro() -> None:
    known, true = FixtureFilter(Fixture(), Pose.identity()), Pose.exp([0.0, 0.0, 0.0, 0.05, 0.06, 0.0])
    slid(known, true, 0.1, 1.4)  # one way
    alone = known.state(1.4).covariance[12, 12]
    slid(known, true, 1.65, 4.6)
    assert known.state(4.6).covariance[12, 12] < 0.2 * alone
    assert known.state(4.6).friction == pytest.approx(0.4, abs=0.03)
    assert tilt(known, true, 4.6) < 0.5


def test_slides_that_are_no_numbers_or_tell_nothing_change_nothing() -> None:
    known = FixtureFilter(Ball(), Pose.identity())
    good = SlideSeen(0.1, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), DEVIATION)
    for change in (
        {"time": math.nan},
        {"point": (math.inf, 0.0, 0.0)},
        {"force": (math.nan, 0.0, 1.0)},
        {"motion": (0.0, 0.0, 1.0)},
        {"deviation": 0.0},
    ):
        assert known.update(replace(good, **change)) is Verdict.NOT_FINITE
    assert known.update(good) is Verdict.USED

"""The shape of a surface that nobody knew, learnt from where contacts begin and how forces point."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.identification.shape_learner import FRICTION, LATE_DEVIATION, NODES, ShapeLearner
from foretouch.models import ShapeField
from foretouch.models.shape_field import SPREAD
from foretouch.quantities.pose import Vector

X, REACH = 0.075, 0.024
Height = Callable[[float, float], float]


def hill(x: float, y: float) -> float:
    return 0.004 * math.exp(-((x - X) ** 2 + y**2) / (2.0 * 0.018**2))


def plane(x: float, y: float) -> float:
    return 0.003 + 0.1 * (x - X) - 0.05 * y


def pushed(height: Height, x: float, y: float, way: float, friction: float, size: float) -> tuple[Vector, Vector]:
    """Force on a probe that slides along x over a surface, and its velocity."""
    step = 1e-6
    right = (height(x + step, y) - height(x - step, y)) / (2.0 * step)
    back = (height(x, y + step) - height(x, y - step)) / (2.0 * step)
    normal, along = np.array((-right, -back, 1.0)), way * np.array((1.0, 0.0, right))
    force = size * (normal / np.linalg.norm(normal) - friction * along / np.linalg.norm(along))
    return tuple(force.tolist()), tuple((0.05 * along).tolist())


def palpated(height: Height, seed: int, friction: float = 0.35) -> ShapeLearner:
    """Seven rows, back and forth, with noise; the material is up to 20 times as stiff at one place as at another."""
    learner, random = ShapeLearner(), np.random.default_rng(seed)
    for row, y in enumerate(np.linspace(-REACH, REACH, 7).tolist()):
        way = 1.0 if row % 2 == 0 else -1.0
        places = X + way * np.linspace(-REACH, REACH, 80)
        learner.touch((places[0], y, height(places[0], y) + 2e-4 * random.normal()))
        for x in places.tolist():
            force, velocity = pushed(height, x, y, way, friction, math.exp(random.uniform(0.0, 3.0)))
            noisy = np.array(force) * (1.0 + 0.01 * random.normal(size=3))
            learner.slide((x, y), tuple(noisy.tolist()), velocity)
    return learner


def errors(learner: ShapeLearner, height: Height) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the height within the rows, and the deviations that are said of them [m]."""
    grid = np.linspace(-REACH, REACH, 25).tolist()
    known = [(learner.height_at((X + a, b)), height(X + a, b)) for a in grid for b in grid]
    return np.array([z - true for (z, _), true in known]), np.sqrt([variance for (_, variance), _ in known])


@pytest.mark.parametrize("height", [hill, plane])
@pytest.mark.parametrize("seed", range(3))
def test_a_surface_is_learnt_whatever_its_stiffness(height: Height, seed: int) -> None:
    learner = palpated(height, seed)
    error, deviation = errors(learner, height)
    assert np.sqrt(np.mean(error**2)) < 2e-4
    assert np.mean(np.abs(error) < 2.0 * deviation) > 0.9
    assert learner.states["mean"][0, FRICTION] == pytest.approx(0.35, abs=0.01)


def test_uncertainty_grows_with_the_distance_from_what_was_touched() -> None:
    learner = ShapeLearner()
    learner.touch((X, 0.0, 0.002))
    deviations = [math.sqrt(learner.height_at((X + away, 0.0))[1]) for away in (0.0, 0.005, 0.015, 0.03, 0.058)]
    assert deviations == sorted(deviations)
    assert LATE_DEVIATION < deviations[0] < 5e-4
    assert deviations[-1] > 0.85 * SPREAD
    assert learner.height_at((X + 0.058, 0.0))[0] < 0.002


def test_what_all_touches_are_late_by_stays_uncertain() -> None:
    learner = ShapeLearner()
    for _ in range(200):
        learner.touch((X, 0.0, 0.002))
    assert math.sqrt(learner.height_at((X, 0.0))[1]) > 0.9 * LATE_DEVIATION


@settings(max_examples=20)
@given(st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-0.02, 0.02)), max_size=10))
def test_the_covariance_stays_one_and_never_grows(points: list) -> None:
    learner = ShapeLearner()
    before = learner.states["joint"][0].copy()
    for point in points:
        learner.touch(point)
        learner.slide(point, (0.3, -0.1, 2.0), (0.03, 0.02, 0.0))
    joint = learner.states["joint"][0]
    assert np.array_equal(joint, joint.T)
    assert (joint.diagonal() <= before.diagonal() * (1.0 + 1e-9)).all()
    assert np.linalg.eigvalsh(joint)[0] > -1e-9


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_changes_nothing(bad: float) -> None:
    learner = ShapeLearner()
    learner.touch((X, 0.0, 0.002))
    before = learner.states.tobytes()
    for place in range(3):
        point, force, velocity = ([X, 0.0, 0.001], [0.0, 0.0, 2.0], [0.03, 0.0, 0.0])
        force[place] = bad
        assert not learner.slide(point, tuple(force), tuple(velocity))
        velocity[place] = bad
        assert not learner.slide(point, (0.0, 0.0, 2.0), tuple(velocity))
    assert not learner.touch((X, 0.0, bad))
    for name in ("mean", "joint", "updates"):
        again = np.frombuffer(before, learner.states.dtype)
        assert np.array_equal(learner.states[name], again[name])


def test_a_touch_that_is_far_off_is_left_out() -> None:
    learner = palpated(hill, 0)
    before = learner.coefficients.copy()
    assert not learner.touch((X, 0.0, 0.02))
    assert np.array_equal(learner.coefficients, before)


def test_the_news_bring_another_side_to_the_same_surface_though_some_are_lost() -> None:
    learner, shape, random = palpated(hill, 1), ShapeField(), np.random.default_rng(0)
    for _ in range(60):
        content = learner.news()
        assert len(content) < 500
        if random.uniform() < 0.7:
            shape.take(content)
    points = np.array([(X + a, b) for a in (-0.02, 0.0, 0.02) for b in (-0.02, 0.0, 0.02)])
    heights, deviations = shape.heights_at(points)
    assert heights == pytest.approx([learner.height_at(point)[0] for point in points], abs=1e-5)
    assert deviations.max() < 6e-4
    assert shape.count > 0.98 * NODES


def test_it_goes_back_to_what_was_known_before_and_tells_so() -> None:
    """Touches of a surface that had moved away are forgotten, and who hears the news has the shape of before."""
    learner, heard = ShapeLearner(), ShapeField()

    def touch_all(height: float) -> None:
        for x in np.linspace(0.05, 0.1, 6):
            learner.touch((x, 0.0, height))
        heard.take(learner.news())

    touch_all(2e-3)
    before, kept, updates = learner.coefficients.copy(), learner.states.copy(), learner.updates
    touch_all(3e-3)
    assert np.abs(learner.coefficients - before).max() > 2e-4
    learner.go_back(kept)
    assert np.array_equal(learner.coefficients, before)
    assert learner.updates != updates
    for _ in range(40):
        heard.take(learner.news())
    (there,), _ = heard.heights_at([(0.075, 0.0)])
    assert there == pytest.approx(learner.height_at((0.075, 0.0))[0], abs=2e-5)

"""The scale learnt place by place: a Gaussian process in NumPy, two materials side by side, and what is no force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.identification import ContactMap, Learner, ScaleFieldLearner
from foretouch.identification.scale_field_kernel import (
    CORRELATION,
    FIRST_DEVIATION,
    FORCE_NOISE,
    LAW_ERROR,
)
from foretouch.models import HuntCrossley, ScaleField
from foretouch.models.scale_field_kernel import REACH, SPACING, SPREAD

PERIOD, FORCE = 1e-3, 10.0
LAW = HuntCrossley(6e3, 30.0, 1.3)


def weights(point: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Bilinear weights of nodes at a point."""
    away = np.maximum(1.0 - np.abs(point - nodes) / SPACING, 0.0)
    return away[:, 0] * away[:, 1]


def whole_process(points: np.ndarray, errors: np.ndarray, noise: float, nodes: np.ndarray) -> tuple[np.ndarray, ...]:
    """Mean and covariance of the logarithms of the scale at nodes, after errors seen at points with a variance."""
    apart = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    covariance, mean = SPREAD**2 * np.exp(-apart / REACH), np.zeros(len(nodes))
    variances = np.array([FIRST_DEVIATION**2, *np.full(len(points), noise)])
    for point, error, variance in zip([points[0], *points], [None, *errors], variances, strict=True):
        h = weights(point, nodes)
        along = covariance @ h
        innovation = 0.0 if error is None else error
        mean = mean + along * innovation / (h @ along + variance)
        covariance = covariance - np.outer(along, along) / (h @ along + variance)
    return mean, covariance


def test_about_one_place_it_is_the_gaussian_process_itself() -> None:
    """Within one square of nodes nothing is left out; what drifts in 20 ms is small."""
    learner, random = ScaleFieldLearner(), np.random.default_rng(3)
    points = random.uniform(0.0, SPACING, (20, 2))
    at = np.arange(-1, 3) * SPACING
    nodes = np.array([(x, y) for x in at for y in at])
    noise = (LAW_ERROR**2 + (FORCE_NOISE / FORCE) ** 2) * CORRELATION / PERIOD
    errors, field = random.normal(0.0, 0.2, len(points)), []
    for point, error in zip(points, errors, strict=True):
        learner.touch_at((*point, 0.0))
        scale = np.exp(_here(learner, point, nodes))
        # The noise is the same in each: the law expects so much less where the scale is larger.
        learner.share((1.0 + error) * FORCE, FORCE / scale, 0.0, PERIOD)
        field.append(scale)
    mean, covariance = whole_process(points, errors, noise, nodes)
    state = learner.states[0]
    i, j = (state.at[0] + np.arange(16) // 4, state.at[1] + np.arange(16) % 4)
    assert state.scales.value[i, j] == pytest.approx(mean, abs=2e-4)
    assert np.asarray(state.joint) == pytest.approx(covariance, abs=2e-4)


def _here(learner: ScaleFieldLearner, point: np.ndarray, nodes: np.ndarray) -> float:
    state = learner.states[0]
    if state.at[0] < 0:
        return 0.0
    i, j = (state.at[0] + np.arange(16) // 4, state.at[1] + np.arange(16) % 4)
    return float(weights(point, nodes) @ state.scales.value[i, j])


def raster(seconds: float = 50.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, places and depths of presses in rows, 1 s each, that go on by 5 mm, and over all again."""
    time = np.arange(0.0, seconds, PERIOD)
    number = time.astype(int) % 25
    places = 5e-3 * np.stack([number % 5, number // 5], axis=1) - 0.01
    return time, places, 2.5e-3 * (1.0 - np.cos(2.0 * np.pi * time)) - 5e-4


def felt(time: np.ndarray, places: np.ndarray, depths: np.ndarray, ratio: float, seed: int) -> np.ndarray:
    """Force where the material is so many times as strong right of the middle [N]."""
    speeds = np.gradient(depths, PERIOD)
    forces = np.array([LAW.advance((), x, v, PERIOD)[1] for x, v in zip(depths, speeds, strict=True)])
    return np.where(places[:, 0] > 0.002, ratio, 1.0) * forces + np.random.default_rng(seed).normal(
        0.0, 0.01, time.size
    )


def learnt(learner: Learner, ratio: float = 3.0, seed: int = 0) -> Learner:
    """After the presses of `raster` on two materials side by side."""
    time, places, depths = raster()
    forces = felt(time, places, depths, ratio, seed)
    for t, place, x, force in zip(time.tolist(), places.tolist(), depths.tolist(), forces.tolist(), strict=True):
        assert learner.places is not None
        learner.places.touch_at((*place, 0.0))
        learner.update(t, x, force)
    return learner


@pytest.mark.parametrize("ratio", [0.3, 0.6, 3.0])
def test_one_law_and_a_scale_tell_two_materials_apart(ratio: float) -> None:
    learner = learnt(Learner(places=ScaleFieldLearner()), ratio)
    learnt_model, places = learner.learnt(), learner.places
    model, state = learnt_model.model, learnt_model.state
    assert model is not None
    assert places is not None
    assert learner.estimator.changes == 0
    _, _, depths = raster(1.0)  # one press more, moved as the law knows it
    speeds, forces = np.gradient(depths, PERIOD), []
    for x, v in zip(depths.tolist(), speeds.tolist(), strict=True):
        state, force, _ = model.advance(state, x - learnt_model.surface, v, PERIOD)
        forces.append(force)
    true = np.array([LAW.advance((), x, v, PERIOD)[1] for x, v in zip(depths.tolist(), speeds.tolist(), strict=True)])
    for place, factor in (((-0.005, 0.0), 1.0), ((0.01, 0.0), ratio)):
        scale, deviation = places.field.scale_at(place)
        error = scale * np.array(forces) - factor * true
        assert np.sqrt(np.mean(error**2) / np.mean((factor * true) ** 2)) < 0.05
        assert deviation < 0.4


class OtherMap(ContactMap):
    """A contact map that is not taken for one: then all is called from Python."""


@pytest.mark.long
def test_in_one_compiled_call_and_step_by_step_it_learns_the_same() -> None:
    whole, steps = (learnt(Learner(kind(), places=ScaleFieldLearner())) for kind in (ContactMap, OtherMap))
    assert whole.places is not None
    assert steps.places is not None
    points = np.random.default_rng(0).uniform(-0.015, 0.015, (50, 2))
    one, other = whole.places.field.scales_at(points), steps.places.field.scales_at(points)
    assert one[0] == pytest.approx(other[0], rel=0.03)  # the model from Python is rounded to 32 bits
    assert one[1] == pytest.approx(other[1], rel=0.05)


def test_without_a_place_nothing_is_shared() -> None:
    learner = ScaleFieldLearner()
    assert learner.share(2.0, 1.0, 0.1, PERIOD) == 2.0
    assert learner.updates == 0


def test_news_are_what_has_changed_and_others_in_turn() -> None:
    learner = ScaleFieldLearner()
    for x in np.arange(0.0, 0.1, 1e-4).tolist():
        learner.touch_at((x, 0.0, 0.0))
        learner.share(2.0, 1.0, 0.0, PERIOD)
    whole = learner.field
    assert whole.count > 60
    before = learner.updates
    assert len(learner.news(before, 0, 64)) == 8
    assert len(learner.news(before - 1, 0, 64)) <= 8 + 6 * 16
    late = ScaleField()
    for _ in range(-(-whole.count // 16)):
        content = learner.news(before, 16, 64)
        assert len(content) <= 8 + 6 * 16
        late.take(content)
    assert late.records.tobytes() == whole.records.tobytes()


def test_who_hears_of_a_field_hears_that_it_went_back() -> None:
    learner, heard = ScaleFieldLearner(), ScaleField()

    def feel(begin: float, end: float, force: float) -> None:
        for x in np.arange(begin, end, 1e-4).tolist():
            learner.touch_at((x, 0.0, 0.0))
            learner.share(force, 1.0, 0.0, PERIOD)

    feel(0.0, 0.03, 2.0)
    before, kept = learner.updates, learner.states.copy()
    heard.take(learner.news(-1, 0, 64))
    feel(0.02, 0.06, 0.2)
    heard.take(learner.news(before, 0, 64))
    assert heard.scale_at((0.05, 0.0))[0] < 0.5
    before = learner.updates
    learner.go_back(kept)
    assert learner.updates > before
    heard.take(learner.news(before, 0, 64))
    assert heard.scale_at((0.01, 0.0))[0] == pytest.approx(2.0, rel=0.05)
    assert heard.scale_at((0.05, 0.0))[0] == pytest.approx(1.0, abs=0.05)
    assert heard.scale_at((0.05, 0.0))[1] > 0.5
    feel(0.04, 0.05, 3.0)  # and it learns on
    assert learner.field.scale_at((0.045, 0.0))[0] == pytest.approx(3.0, rel=0.1)


NUMBERS = st.floats(-1e6, 1e6) | st.sampled_from([0.0, 1e-300, math.nan])
SAMPLES = st.lists(
    st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-1e6, 1e6), NUMBERS, NUMBERS, st.floats(0.0, 1.0)),
    max_size=40,
)


@settings(deadline=None)
@given(SAMPLES)
def test_whatever_is_felt_it_stays_within_its_prior(samples: list[tuple[float, ...]]) -> None:
    learner = ScaleFieldLearner()
    for x, y, force, expected, deviation, period in samples:
        learner.touch_at((x, y))
        left = learner.share(force, expected, deviation, period)
        assert math.isfinite(left)
    state = learner.states[0]
    joint = np.asarray(state.joint)
    assert (joint == joint.T).all()
    if learner.updates:
        assert np.linalg.eigvalsh(joint).min() > -1e-9
        assert np.diag(joint).max() <= SPREAD**2 + 1e-9
    assert np.isfinite(state.scales.value).all()

"""A contact map from before: the prior mean of the one that is learnt, dropped where it does harm."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from foretouch.identification import ContactMap, Learner, from_the_surface, predict
from foretouch.identification.contact_map.prior import prior
from foretouch.identification.contact_map.regression import (
    Regression,
    begin_regression,
    expect_mean,
    fit,
    reach,
)
from foretouch.identification.contact_map.remembered import shift
from foretouch.models import ContactMapModel, advance
from foretouch.models.contact_map.kernel import locate
from foretouch.models.contact_map.layout import COARSE
from foretouch.quantities import Recording

Array = NDArray[np.float64]


def press(stiffness: float, seed: int, surface: float = 0.01) -> Recording:
    """Presses that go deeper and deeper into a quadratic spring, with noise."""
    time = np.arange(0.0, 12.0, 2e-3)
    deepest = np.interp(time, [0.0, 4.0, 8.0, 12.0], [0.003, 0.005, 0.008, 0.008])
    depth = deepest * np.sin(2.0 * np.pi * 0.5 * time - 0.5 * np.pi)
    noise = np.random.default_rng(seed).normal(0.0, 0.01, time.size)
    return Recording(time, surface + depth, stiffness * np.maximum(depth, 0.0) ** 2 + noise)


def learnt(recording: Recording, remembered: ContactMapModel | None = None) -> tuple[Array, ContactMap]:
    """Force that is predicted 0.3 s late, and the estimator at the end."""
    estimator = ContactMap()
    if remembered is not None:
        estimator.recall(remembered)
    learner = Learner(estimator, contact_floor=recording.contact_floor)
    return predict(recording, learner, delay=0.3).force, estimator


def memory_of(stiffness: float) -> ContactMapModel:
    """What is remembered of such a press."""
    model = learnt(press(stiffness, 7, 0.02))[1].remembered
    assert model is not None
    return model


def error(recording: Recording, force: Array) -> float:
    """RMS error [N]."""
    return float(np.sqrt(np.mean((force - recording.force) ** 2)))


def test_a_mean_is_the_rest_learnt_without_it() -> None:
    random = np.random.default_rng(3)
    mean = random.multivariate_normal(np.zeros(COARSE.size), prior(0))
    samples = [(x, random.normal(size=COARSE.features), random.normal()) for x in random.uniform(-2e-3, 9e-3, 60)]

    def learn(begin: int) -> tuple[Array, Regression]:
        """Weights and regression after all samples, where the mean is given before this one."""
        weights, regression = np.zeros(COARSE.size), Regression.new()[0]
        begin_regression(regression, 0)
        for index, (x, values, force) in enumerate(samples):
            if index == begin:
                reach_all(regression, weights)
                expect_mean(regression, mean)
            fit(weights, regression, COARSE, x, values, force)
        return weights, regression

    def reach_all(regression: Regression, weights: Array) -> None:
        reach(weights, regression, 0, 0)
        reach(weights, regression, COARSE.knots - 4, COARSE.feature_knots - 4)

    early, late = learn(0), learn(30)
    assert np.allclose(early[1].trace, late[1].trace, atol=1e-6)  # at whatever sample the mean is given
    # The same by the normal equations: posterior mean of a Gaussian with this prior mean.
    rows, forces = np.zeros((len(samples), COARSE.size)), np.array([force for *_, force in samples])
    for row, (x, values, _) in zip(rows, samples, strict=True):
        part = np.empty(4)
        first = locate(x, COARSE.spacing, COARSE.below, COARSE.knots, part)
        row[first : first + 4] = part
        first = locate(x, COARSE.feature_spacing, COARSE.feature_below, COARSE.feature_knots, part)
        for f, value in enumerate(values):
            at = COARSE.knots + f * COARSE.feature_knots + first
            row[at : at + 4] = value * part
    covariance = prior(0)
    gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + np.eye(len(samples)))
    assert np.allclose(early[0] + early[1].trace, mean + gain @ (forces - rows @ mean), atol=1e-5)


def test_a_map_keeps_its_forces_where_it_is_moved() -> None:
    model = memory_of(4e4)
    moved = model.record.copy()
    shift(moved[0], 1.3e-3)
    there = ContactMapModel.of(moved)
    assert there is not None
    for depth in (1e-3, 3e-3, 5e-3):
        expected = advance(model, (), depth, 0.0, 1e-3)[1]
        assert advance(there, (), depth + 1.3e-3, 0.0, 1e-3)[1] == pytest.approx(expected, abs=0.02)
    assert from_the_surface(model.record)[0].origin == 0.0


def test_memory_foresees_what_is_deeper() -> None:
    recording, known = press(4e4, 8), memory_of(4e4)
    plain, with_memory = learnt(recording), learnt(recording, known)
    assert with_memory[1].recalls == "held"
    assert error(recording, with_memory[0]) < error(recording, plain[0])


@pytest.mark.parametrize("stiffness", [1.3e4, 1.2e5, 1e6])
@pytest.mark.first
def test_a_wrong_memory_is_dropped_and_leaves_nothing(stiffness: float) -> None:
    recording = press(4e4, 8)
    plain, with_memory = learnt(recording), learnt(recording, memory_of(stiffness))
    assert with_memory[1].recalls == "dropped"
    assert error(recording, with_memory[0]) < error(recording, plain[0]) + 0.01 * float(
        np.sqrt(np.mean(recording.force**2))
    )
    assert np.allclose(with_memory[0][-2000:], plain[0][-2000:], atol=1e-6)


def test_a_reset_begins_with_the_memory_again() -> None:
    _, estimator = learnt(press(4e4, 8), memory_of(1e6))
    estimator.reset()
    assert estimator.recalls == "held"
    assert estimator.model is None

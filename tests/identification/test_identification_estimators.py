"""What every estimator must do, whatever it identifies."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from presses import SOFT, press

from foretouch.errors import UnknownNameError
from foretouch.identification import (
    ESTIMATORS,
    ContactSample,
    ContactSamples,
    Estimator,
    Learner,
    Status,
    identify,
    make_estimator,
)
from foretouch.identification.registry import DEFAULT_ESTIMATORS
from foretouch.models import LAWS, make_model
from foretouch.session.conformance.estimator_checks import OWN_LAWS

NAMES = [(model, estimator) for model, estimators in ESTIMATORS.items() for estimator in estimators]
SHORT = 2.0
"""Of a press [s], where it only has to teach something: those that fit all samples at once are slow."""


@pytest.fixture(params=NAMES, ids=["/".join(names) for names in NAMES])
def estimator(request: pytest.FixtureRequest) -> Estimator:
    return make_estimator(*request.param)


def test_it_is_registered_under_its_own_names(estimator: Estimator) -> None:
    assert ESTIMATORS[estimator.model_name][estimator.name] is type(estimator)


def test_every_law_that_is_estimated_has_a_default() -> None:
    assert DEFAULT_ESTIMATORS.keys() == ESTIMATORS.keys()


def test_it_knows_nothing_at_first(estimator: Estimator) -> None:
    assert estimator.model is None
    assert estimator.parameters == {}
    assert estimator.updates == 0


def test_it_learns_a_clean_press_of_its_own_law(estimator: Estimator) -> None:
    """Given surface and offset, the law it found gives the force again, where the depth is not tiny."""
    true = OWN_LAWS.get(estimator.model_name, SOFT)
    recording = press(true, duration=5.0)
    result = identify(recording, Learner(estimator, surface=0.01, force_offset=0.3))
    assert result.in_contact.sum() > 1000
    assert result.residual_rms < 0.1 * result.contact_force_rms
    model = estimator.model
    assert model is not None
    for depth in (0.004, 0.008):
        matches, expected = (law.advance((), depth, 0.0, 1e-3)[1] for law in (model, true))
        assert matches == pytest.approx(expected, rel=0.05)
    assert recording.position.max() > 0.01 + 0.008  # it was pressed so deep


def test_samples_outside_contact_teach_nothing(estimator: Estimator) -> None:
    for index in range(200):
        estimator.update(ContactSample(index * 1e-3, -0.01, 0.0, 0.0, False))
    assert estimator.updates == 0
    assert estimator.model is None


def test_bad_numbers_never_raise(estimator: Estimator) -> None:
    values = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, 1e-300)
    for depth in values:
        for velocity in values:
            for force in values:
                estimator.update(ContactSample(0.0, depth, velocity, force, True))
    model = estimator.model
    assert model is None or all(map(math.isfinite, model.parameters))


@pytest.mark.first
def test_its_model_can_cross_the_network_and_after_a_reset_the_same_samples_teach_the_same_again(
    estimator: Estimator,
) -> None:
    recording = press(noise=0.01, duration=SHORT)
    first = identify(recording, Learner(estimator), keep_history=True)
    model = estimator.model
    assert model is not None
    assert LAWS[model.law] is type(model)
    assert make_model(model.law, model.parameters, getattr(model, "map", b"")) == model
    for name, value in zip(model.parameter_names, model.parameters, strict=True):
        assert estimator.parameters[name] in (value, None)  # None: the model needs a number, but it is undetermined
    errors = estimator.standard_errors
    assert errors is None or errors.keys() == estimator.parameters.keys()
    estimator.reset()
    assert estimator.model is None
    assert estimator.parameters == {}
    assert estimator.updates == 0
    again = identify(recording, Learner(estimator), keep_history=True)
    assert again.parameters == first.parameters
    assert estimator.standard_errors == errors
    for name, column in first.history.items():
        np.testing.assert_array_equal(again.history[name], column)


@cache
def test_a_run_is_an_update_with_each_sample(estimator: Estimator) -> None:
    samples = arbitrary_samples(300)
    other = make_estimator(estimator.model_name, estimator.name)
    done = [estimator.update(sample) for sample in samples]
    columns = ContactSamples(*zip(*samples, strict=True))
    assert [tuple(Status)[index] for index in other.run(columns)] == done
    assert (other.updates, other.changes) == (estimator.updates, estimator.changes)
    assert other.parameters == estimator.parameters
    assert len(columns) == len(list(columns)) == 300


def arbitrary_samples(count: int) -> list[ContactSample]:
    """Presses, held positions, jumps and nonsense, in turns."""
    random, result = np.random.default_rng(7), []
    while count > 0:
        size = min(count, 500)
        kind = random.integers(4)
        if kind == 0:  # a press
            depth = 0.01 * np.abs(np.sin(np.linspace(0.0, 6.0, size)))
            velocity, force = random.normal(0.0, 0.05, size), 1000.0 * depth + random.normal(0.0, 0.05, size)
        elif kind == 1:  # held, with an encoder's noise
            depth = 0.008 + random.normal(0.0, 5e-6, size)
            velocity, force = random.normal(0.0, 1e-3, size), 6.0 + random.normal(0.0, 0.02, size)
        elif kind == 2:  # quite still
            depth, velocity, force = np.full(size, 0.004), np.zeros(size), np.full(size, 2.0)
        else:  # nonsense of every size
            depth, velocity, force = (random.normal(size=size) * 10.0 ** random.uniform(-9, 9, size) for _ in range(3))
        contact = random.random(size) < 0.9
        for row in zip(depth.tolist(), velocity.tolist(), force.tolist(), contact.tolist(), strict=True):
            result.append(ContactSample(0.0, *row))
        count -= size
    return result


def test_no_samples_unbound_its_covariance(estimator: Estimator) -> None:
    for index, sample in enumerate(arbitrary_samples(6_000)):
        estimator.update(sample)
        if index % 97:
            continue
        model = estimator.model
        assert model is None or all(map(math.isfinite, model.parameters))
        for numbers in (estimator.parameters, estimator.standard_errors or {}):
            assert all(value is None or math.isfinite(value) for value in numbers.values())
        covariance = getattr(estimator, "unscaled_covariance", None)
        if covariance is not None:
            assert np.abs(covariance).max() < 1e101
            np.testing.assert_array_equal(covariance, covariance.T)


def test_unknown_names_list_the_choices() -> None:
    with pytest.raises(UnknownNameError, match="unknown model 'x': choose one of contact-map"):
        make_estimator("x", "fprls")
    with pytest.raises(UnknownNameError, match=r"unknown estimator for continuous-switching 'x': choose .*fprls"):
        make_estimator("continuous-switching", "x")


def test_history_and_residual_have_a_row_a_sample() -> None:
    """And its last row is the result, where nothing has to be found in hindsight."""
    recording = press(duration=SHORT)
    learner = Learner(make_estimator("continuous-switching", "fprls"), surface=0.01, force_offset=0.3)
    result = identify(recording, learner, keep_history=True)
    assert set(result.history) == {"ln_k", "s", "b1", "b2", "stiffness", "damping", "exponent", "switching"}
    for column in (*result.history.values(), result.residual, result.in_contact):
        assert column.shape == recording.time.shape
    assert np.isnan(result.residual[~result.in_contact]).all()
    last = {name: math.nan if value is None else value for name, value in result.parameters.items()}
    np.testing.assert_array_equal([column[-1] for column in result.history.values()], list(last.values()))

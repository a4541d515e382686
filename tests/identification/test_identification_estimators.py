"""What every estimator must do, whatever it identifies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from presses import SOFT, press, true_force

from foretouch.errors import UnknownNameError
from foretouch.identification import ESTIMATORS, ContactSample, Estimator, Learner, identify, make_estimator
from foretouch.models import LAWS, make_model

NAMES = [(model, estimator) for model, estimators in ESTIMATORS.items() for estimator in estimators]


@pytest.fixture(params=NAMES, ids=["/".join(names) for names in NAMES])
def estimator(request: pytest.FixtureRequest) -> Estimator:
    return make_estimator(*request.param)


def test_it_is_registered_under_its_own_names(estimator: Estimator) -> None:
    assert ESTIMATORS[estimator.model_name][estimator.name] is type(estimator)


def test_it_knows_nothing_at_first(estimator: Estimator) -> None:
    assert estimator.model is None
    assert estimator.parameters == {}
    assert estimator.updates == 0


def test_its_model_can_cross_the_network(estimator: Estimator) -> None:
    identify(press(), Learner(estimator))
    model = estimator.model
    assert model is not None
    assert LAWS[model.law] is type(model)
    assert make_model(model.law, model.parameters) == model
    assert estimator.parameters == dict(zip(model.parameter_names, model.parameters, strict=True))
    errors = estimator.standard_errors
    assert errors is None or errors.keys() == estimator.parameters.keys()


def test_it_learns_a_clean_soft_press(estimator: Estimator) -> None:
    """Given surface and offset, the law it found gives the force again, where the depth is not tiny."""
    recording = press()
    learner = Learner(estimator, surface=0.01, force_offset=0.3)
    result = identify(recording, learner)
    assert result.in_contact.sum() > 1000
    assert result.residual_rms < 0.1 * result.contact_force_rms
    model = estimator.model
    assert model is not None
    for depth in (0.004, 0.008):
        found, true = (law.advance((), depth, 0.0, 1e-3)[1] for law in (model, SOFT))
        assert found == pytest.approx(true, rel=0.05)
    assert true_force(recording).max() > 4.0


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


def test_reset_forgets(estimator: Estimator) -> None:
    recording = press(noise=0.01)
    first = identify(recording, Learner(estimator)).parameters
    estimator.reset()
    assert estimator.model is None
    assert identify(recording, Learner(estimator)).parameters == first


def test_unknown_names_list_the_choices() -> None:
    with pytest.raises(UnknownNameError, match="unknown model 'x': choose one of continuous-switching"):
        make_estimator("x", "fprls")
    with pytest.raises(UnknownNameError, match="unknown estimator for continuous-switching 'x': choose one of fprls"):
        make_estimator("continuous-switching", "x")


def test_history_and_residual_have_a_row_a_sample() -> None:
    recording = press()
    result = identify(recording, Learner(make_estimator("continuous-switching", "fprls")))
    assert set(result.history) == {"ln_k", "s", "b1", "b2"}
    for column in (*result.history.values(), result.residual, result.in_contact):
        assert column.shape == recording.time.shape
    assert np.isnan(result.residual[~result.in_contact]).all()
    assert [column[-1] for column in result.history.values()] == list(result.parameters.values())

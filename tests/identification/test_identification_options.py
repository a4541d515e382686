"""Estimators by name, and the covariance of what they know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from presses import press

from foretouch.errors import UnknownNameError
from foretouch.identification import (
    DEFAULT_ESTIMATORS,
    RLS,
    HuntCrossleyLogOptions,
    HuntCrossleyLogRLS,
    KelvinVoigtOptions,
    KelvinVoigtRLS,
    Learner,
    identify,
    make_estimator,
)
from foretouch.identification.linear.options import RobustOptions


@pytest.mark.parametrize(
    ("learnt", "size"),
    [
        (KelvinVoigtRLS(), 2),
        (KelvinVoigtRLS(KelvinVoigtOptions(robust=RobustOptions(scaled=True))), 2),
        (HuntCrossleyLogRLS(), 3),
        (HuntCrossleyLogRLS(HuntCrossleyLogOptions(robust=RobustOptions(scaled=True))), 3),
        (RLS(), 4),
    ],
)
def test_the_standard_errors_are_those_of_the_covariance(learnt: Any, size: int) -> None:
    assert learnt.covariance is None
    identify(press(noise=0.02, duration=3.0), Learner(learnt, surface=0.01, force_offset=0.3))
    covariance, errors = learnt.covariance, learnt.standard_errors
    assert covariance.shape == (size, size)
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9)
    own: dict[str, list[str | None]] = {
        "kelvin-voigt": ["stiffness", "damping"],
        "hunt-crossley": [None, None, "exponent"],
    }
    names = own.get(learnt.model_name, ["ln_k", "s", "b1", "b2"])
    for name, variance in zip(names, np.diag(covariance), strict=True):
        if name is not None:
            assert np.sqrt(variance) == pytest.approx(errors[name], rel=1e-9)


def test_what_enlarges_p_on_purpose_has_no_covariance() -> None:
    learnt: Any = make_estimator("continuous-switching", "fprls")
    identify(press(noise=0.02, duration=3.0), Learner(learnt, surface=0.01, force_offset=0.3))
    assert learnt.covariance is None
    assert learnt.unscaled_covariance.shape == (4, 4)


def test_a_law_without_an_estimator_has_its_own() -> None:
    for model, name in DEFAULT_ESTIMATORS.items():
        assert make_estimator(model).name == name
    with pytest.raises(UnknownNameError, match="unknown model 'jelly': choose one of contact-map"):
        make_estimator("jelly")

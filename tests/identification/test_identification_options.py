"""Options of estimators by name, and the covariance of what they know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from presses import press

from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import (
    DEFAULT_ESTIMATORS,
    ContactMapBank,
    FPRLSOptions,
    Learner,
    identify,
    make_estimator,
)
from foretouch.identification.linear.options import RobustOptions


def test_options_go_to_the_options_class_or_to_the_constructor() -> None:
    assert make_estimator("kelvin-voigt", "rls", forgetting_factor=0.9).options.forgetting_factor == 0.9
    forgetting = make_estimator(
        "continuous-switching", "rls-forgetting", forgetting_factor=0.9, initial_covariance=10.0
    )
    assert forgetting.options == FPRLSOptions(initial_covariance=10.0, forgetting_rate=0.0, perturbation=0.0)
    assert forgetting.forgetting_factor(0.0) == 0.9
    robust: Any = make_estimator("continuous-switching", "robust-fprls", forgetting_rate=5.0)
    assert robust.options.robust != RobustOptions()  # its own defaults stay
    bank = make_estimator("contact-map", "bank", horizon=0.1)
    assert isinstance(bank, ContactMapBank)
    assert bank.horizon == 0.1


@pytest.mark.parametrize(
    ("model", "estimator", "options", "text"),
    [
        (
            "kelvin-voigt",
            "rls",
            {"forgeting": 0.9},
            "unknown option of rls 'forgeting': choose one of forgetting_",
        ),
        ("contact-map", "bank", {"delay": 0.1}, "unknown option of bank 'delay': choose one of experts, horizon"),
        ("kelvin-voigt", "offline", {"delay": 0.1}, "options = 'delay': offline of kelvin-voigt takes none"),
        ("kelvin-voigt", "rls", {"forgetting_factor": 2.0}, "forgetting_factor = 2.0: must be finite and above 0"),
        ("kelvin-voigt", "rls", {"forgetting_factor": "a"}, "forgetting_factor is 'a' (str): must be a number"),
        ("continuous-switching", "rls", {"perturbation": 5.0}, "perturbation = 5.0: rls always has 0.0"),
    ],
)
def test_an_option_that_is_unknown_out_of_range_or_fixed_is_refused_in_one_line(
    model: str, estimator: str, options: dict[str, object], text: str
) -> None:
    with pytest.raises((UnknownNameError, SettingError)) as caught:
        make_estimator(model, estimator, **options)
    assert str(caught.value).startswith(text)


@pytest.mark.parametrize(
    ("model", "estimator", "options", "size"),
    [
        ("kelvin-voigt", "rls", {}, 2),
        ("kelvin-voigt", "rls", {"robust": RobustOptions(scaled=True)}, 2),
        ("hunt-crossley", "log-rls", {}, 3),
        ("hunt-crossley", "log-rls", {"robust": RobustOptions(scaled=True)}, 3),
        ("continuous-switching", "rls", {}, 4),
    ],
)
def test_the_standard_errors_are_those_of_the_covariance(
    model: str, estimator: str, options: dict[str, object], size: int
) -> None:
    learnt: Any = make_estimator(model, estimator, **options)
    assert learnt.covariance is None
    identify(press(noise=0.02, duration=3.0), Learner(learnt, surface=0.01, force_offset=0.3))
    covariance, errors = learnt.covariance, learnt.standard_errors
    assert covariance.shape == (size, size)
    np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9)
    own: dict[str, list[str | None]] = {
        "kelvin-voigt": ["stiffness", "damping"],
        "hunt-crossley": [None, None, "exponent"],
    }
    names = own.get(model, ["ln_k", "s", "b1", "b2"])
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
    with_option: Any = make_estimator("kelvin-voigt", forgetting_factor=0.99)
    assert with_option.options.forgetting_factor == 0.99
    with pytest.raises(UnknownNameError, match="unknown model 'jelly': choose one of contact-map"):
        make_estimator("jelly")

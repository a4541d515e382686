"""Contact laws against closed forms, by properties, and through the registry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from example_maps import example_map
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError, UnknownNameError
from foretouch.models import (
    LAWS,
    NO_STATE,
    ContactModel,
    ContinuousSwitching,
    HuntCrossley,
    KelvinVoigt,
    LinearisedContinuousSwitching,
    ThresholdSwitching,
    advance,
    make_model,
)

LAWS_ALONE: dict[str, ContactModel] = {
    "kelvin-voigt": KelvinVoigt(6000.0, 500.0),
    "hunt-crossley": HuntCrossley(3000.0, 1500.0, 1.4),
    "threshold-switching": ThresholdSwitching(3900.0, 500.0, 3000.0, 1500.0, 1.4, 4000.0),
    "continuous-switching": ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5),
    "linearised-continuous-switching": LinearisedContinuousSwitching(math.log(3000.0), 1.4, 0.5, 1e-3),
}
EXAMPLES = {**LAWS_ALONE, "contact-map": example_map()}
depths = st.one_of(st.floats(-0.05, 0.05), st.floats())
velocities = st.one_of(st.floats(-1.0, 1.0), st.floats())


def force_of(model: ContactModel, depth: float, velocity: float) -> float:
    return advance(model, model.initial_state(), depth, velocity, 1e-3)[1]


def test_every_law_has_an_example() -> None:
    assert EXAMPLES.keys() == LAWS.keys()


@pytest.mark.parametrize("model", EXAMPLES.values(), ids=EXAMPLES)
@given(depth=depths, velocity=velocities)
def test_force_is_finite_never_negative_and_zero_outside(model: ContactModel, depth: float, velocity: float) -> None:
    force = force_of(model, depth, velocity)
    assert math.isfinite(force)
    assert force >= 0.0
    if not depth > (-0.02 if model.law == "contact-map" else 0.0):  # a map may know better where contact begins
        assert force == 0.0


@pytest.mark.parametrize("model", EXAMPLES.values(), ids=EXAMPLES)
def test_a_law_survives_the_wire(model: ContactModel) -> None:
    assert make_model(model.law, model.parameters, getattr(model, "map", b"")) == model
    assert model.initial_state() == NO_STATE


def test_kelvin_voigt_is_equation_1() -> None:
    assert force_of(KelvinVoigt(6000.0, 500.0), 0.01, 0.02) == pytest.approx(6000 * 0.01 + 500 * 0.02)


def test_kelvin_voigt_does_not_pull_at_release() -> None:
    assert force_of(KelvinVoigt(6000.0, 500.0), 0.001, -0.1) == 0.0


def test_hunt_crossley_is_equation_2() -> None:
    x, v = 0.01, 0.02
    assert force_of(HuntCrossley(3000.0, 1500.0, 1.4), x, v) == pytest.approx(3000 * x**1.4 + 1500 * x**1.4 * v)


def test_linearised_law_is_equation_18() -> None:
    x, v = 0.01, 0.02
    model = LinearisedContinuousSwitching(8.0, 1.4, 0.5, 1e-3)
    assert math.log(force_of(model, x, v)) == pytest.approx(8.0 + 1.4 * math.log(x) + 0.5 * v + 1e-3 * v / x)


def test_linearised_law_is_hunt_crossley_to_first_order() -> None:
    """With b2 = 0 and b1 = lambda / k, (18) is ln of (2) to first order in phi = lambda v / k."""
    exact = HuntCrossley(3000.0, 150.0, 1.4)
    linearised = LinearisedContinuousSwitching(math.log(3000.0), 1.4, 150.0 / 3000.0, 0.0)
    for velocity in (-0.05, 0.05):
        phi = 0.05 * velocity
        ratio = force_of(linearised, 0.01, velocity) / force_of(exact, 0.01, velocity)
        assert abs(ratio - 1.0) < phi**2


def test_linearised_law_is_continuous_at_its_smallest_depth() -> None:
    model = EXAMPLES["linearised-continuous-switching"]
    below, above = force_of(model, 3e-4 - 1e-12, -0.05), force_of(model, 3e-4 + 1e-12, -0.05)
    assert below == pytest.approx(above, rel=1e-6)
    assert force_of(model, 1e-9, -0.05) < 1e-5 * above


def test_a_diverged_estimate_stays_finite() -> None:
    assert force_of(LinearisedContinuousSwitching(1e5, 1.0, 0.0, 0.0), 0.01, 0.0) == pytest.approx(1e6)


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        ("kelvin-voigt", (0.0, 1.0)),
        ("kelvin-voigt", (1.0, -1.0)),
        ("hunt-crossley", (1.0, 1.0, 0.0)),
        ("hunt-crossley", (1.0, np.inf, 1.0)),
        ("linearised-continuous-switching", (1.0, 1.0, np.nan, 1.0)),
        ("linearised-continuous-switching", (1.0,)),
        ("continuous-switching", (1.0, 1.0, -0.1, 1.0)),
        ("continuous-switching", (1.0, 1.0, 1.0, -0.1)),
        ("continuous-switching", (1.0, 1.0, 0.0, 0.0)),
        ("threshold-switching", (1.0, 1.0, 1.0, 1.0, 1.0, 0.0)),
        ("threshold-switching", (1.0, 1.0, 1.0, -1.0, 1.0, 1.0)),
    ],
)
def test_parameters_out_of_range_are_refused(law: str, parameters: tuple[float, ...]) -> None:
    with pytest.raises(SettingError, match=r"^\w+ = "):
        make_model(law, parameters)


def test_an_unknown_law_is_refused_with_the_choices() -> None:
    with pytest.raises(UnknownNameError, match="choose one of contact-map, continuous-switching, "):
        make_model("jelly", ())

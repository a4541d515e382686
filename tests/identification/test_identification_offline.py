"""The offline fit and steepest descent against known laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from exact_samples import BETWEEN, HUNT_CROSSLEY, KELVIN_VOIGT, Law, feed, force_of, motion, samples
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import InputError, SettingError, UnknownNameError
from foretouch.identification import (
    ContactSample,
    OfflineContinuousSwitching,
    SteepestDescent,
    SteepestDescentHuntCrossley,
    SteepestDescentKelvinVoigt,
    SteepestDescentOptions,
    fit_offline,
)
from foretouch.identification.offline import LARGEST_BUFFER
from foretouch.models import ContinuousSwitching, HuntCrossley, KelvinVoigt

LAWS: list[tuple[str, Law]] = [
    ("continuous-switching", BETWEEN),
    ("continuous-switching", (3000.0, 1500.0, 1.1, 0.3)),
    ("continuous-switching", (150_000.0, 10.0, 1.3, 0.6)),
    ("kelvin-voigt", KELVIN_VOIGT),
    ("hunt-crossley", HUNT_CROSSLEY),
]


@pytest.mark.parametrize(("name", "law"), LAWS)
def test_clean_data_gives_the_law_to_many_digits(name: str, law: Law) -> None:
    _, depth, velocity = motion()
    fit = fit_offline(depth, velocity, force_of(law, depth, velocity), name)
    expected = {"kelvin-voigt": law[:2], "hunt-crossley": law[:3]}.get(name, law)
    np.testing.assert_allclose(fit.model.parameters, expected, rtol=1e-4)
    assert fit.model.law == name
    assert fit.residual_rms < 1e-6 * fit.force_rms
    assert set(fit.standard_errors) == set(fit.model.parameter_names)


@pytest.mark.parametrize(("law", "ends"), [(KELVIN_VOIGT, (0.0, 1.0)), (HUNT_CROSSLEY, (1.4, 0.0))])
def test_the_ends_of_the_family_are_inside_the_bounds(law: Law, ends: tuple[float, float]) -> None:
    _, depth, velocity = motion()
    model = fit_offline(depth, velocity, force_of(law, depth, velocity)).model
    assert isinstance(model, ContinuousSwitching)
    assert (model.exponent, model.switching) == pytest.approx(ends, abs=1e-3)


@pytest.mark.parametrize("law", [BETWEEN, (3000.0, 1500.0, 1.1, 0.3)])
@pytest.mark.first
def test_standard_errors_are_honest(law: Law) -> None:
    """Squared errors in standard errors, over 40 seeds: chi-square of 40 degrees of freedom for each parameter."""
    _, depth, velocity = motion(2.0)
    clean = force_of(law, depth, velocity)
    keep = clean > 0.3
    squares = np.zeros(4)
    for seed in range(40):
        force = clean + np.random.default_rng(seed).normal(0.0, 0.05, clean.size)
        fit = fit_offline(depth[keep], velocity[keep], force[keep])
        result, errors = np.array(fit.model.parameters), np.array(list(fit.standard_errors.values()))
        squares += ((result - np.array(law)) / errors) ** 2
        assert fit.residual_rms == pytest.approx(0.05, rel=0.1)
    assert np.all((squares > 17.9) & (squares < 73.4))  # 0.1 % and 99.9 %


def test_residuals_that_resemble_each_other_count_as_fewer() -> None:
    _, depth, velocity = motion(2.0)
    random = np.random.default_rng(0)
    white = random.normal(0.0, 0.05, depth.size)
    slow = np.convolve(random.normal(0.0, 0.05, depth.size + 99), np.full(100, 0.1), "valid")  # the same variance
    clean = force_of(BETWEEN, depth, velocity)
    errors = [fit_offline(depth, velocity, clean + noise).standard_errors["stiffness"] for noise in (white, slow)]
    assert errors[1] > 5.0 * errors[0]


def test_what_slow_motion_does_not_tell_keeps_the_spread_of_its_range() -> None:
    depth = 0.008 + 0.006 * np.sin(np.linspace(0.0, 10.0, 2000))
    force = 3000.0 * depth**1.4 + np.random.default_rng(0).normal(0.0, 0.02, depth.size)
    fit = fit_offline(depth, np.zeros_like(depth), force)
    assert fit.standard_errors["switching"] == pytest.approx(math.sqrt(1.0 / 12.0), rel=0.01)


@settings(max_examples=20)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_units_do_not_matter(log_depth_scale: float, log_force_scale: float) -> None:
    depth_scale, force_scale = 10.0**log_depth_scale, 10.0**log_force_scale
    _, depth, velocity = motion(1.0)
    force = force_of(BETWEEN, depth, velocity) + np.random.default_rng(1).normal(0.0, 0.05, depth.size)
    plain = fit_offline(depth, velocity, force)
    scaled = fit_offline(depth_scale * depth, depth_scale * velocity, force_scale * force)
    assert scaled.residual_rms == pytest.approx(force_scale * plain.residual_rms, rel=1e-6)
    for index in (2, 3):
        assert scaled.model.parameters[index] == pytest.approx(plain.model.parameters[index], abs=1e-3)


def test_what_cannot_be_fitted_is_refused() -> None:
    _, depth, velocity = motion(0.1)
    force = force_of(BETWEEN, depth, velocity)
    with pytest.raises(UnknownNameError, match="unknown exact law 'x': choose one of continuous-switching"):
        fit_offline(depth, velocity, force, "x")
    with pytest.raises(InputError, match="columns of one length"):
        fit_offline(depth, velocity[1:], force)
    with pytest.raises(InputError, match="must be finite"):
        fit_offline(depth, velocity, np.where(depth > 0.01, np.nan, force))
    with pytest.raises(InputError, match="0 samples inside the surface"):
        fit_offline(-depth, velocity, force)


def test_the_estimator_is_the_fit_of_what_it_was_given() -> None:
    estimator = OfflineContinuousSwitching()
    data = samples(noise=0.05, duration=1.0)
    feed(estimator, data)
    model = estimator.model
    assert isinstance(model, ContinuousSwitching)
    depth, velocity, force = (np.array([getattr(s, name) for s in data]) for name in ("depth", "velocity", "force"))
    assert model.parameters == fit_offline(depth, velocity, force).model.parameters
    assert estimator.model is model  # not fitted again while nothing new has come


def test_its_buffer_is_bounded_and_covers_everything() -> None:
    estimator = OfflineContinuousSwitching()
    data = samples(BETWEEN, duration=4.0) + samples((9000.0, 1000.0, 0.7, 0.5), duration=4.0)
    for repeat in range(3):
        feed(estimator, data)
        assert len(estimator._rows) < LARGEST_BUFFER
        assert estimator.updates == (repeat + 1) * len(data)
    model = estimator.model
    assert model is not None
    force = model.advance((), 0.01, 0.0, 1e-3)[1]
    assert force == pytest.approx(6750.0 * 0.01**1.2, rel=0.05)  # both laws weigh the same


@pytest.mark.parametrize("law", [BETWEEN, HUNT_CROSSLEY, (600.0, 10.0, 0.0, 1.0)])
def test_steepest_descent_finds_the_force_of_a_clean_press(law: Law) -> None:
    estimator = SteepestDescent()
    feed(estimator, samples(law, duration=20.0))
    model = estimator.model
    assert model is not None
    for depth in (0.003, 0.008, 0.014):
        assert model.advance((), depth, 0.0, 1e-3)[1] == pytest.approx(law[0] * depth ** (law[2] + law[3]), rel=0.15)


def test_steepest_descent_needs_good_initial_values() -> None:
    """What the paper says of the method: far from the truth it stays away for long, near to it it does not."""
    n, alpha = BETWEEN[2:]
    data = samples(BETWEEN, duration=2.0)
    misses = []
    for options in (
        SteepestDescentOptions(initial_s=n + alpha, initial_alpha=alpha, initial_damping=0.1),
        SteepestDescentOptions(initial_s=2.0 - 1e-6, initial_alpha=0.0, initial_damping=10.0),
    ):
        estimator = SteepestDescent(options)
        feed(estimator, data)
        model = estimator.model
        assert isinstance(model, ContinuousSwitching)
        misses.append(abs(model.switching - alpha) + abs(model.exponent - n))
    assert misses[0] < 0.5 * misses[1]


def test_the_ends_keep_their_form() -> None:
    for estimator, kind, law in (
        (SteepestDescentKelvinVoigt(), KelvinVoigt, (600.0, 10.0, 0.0, 1.0)),
        (SteepestDescentHuntCrossley(), HuntCrossley, HUNT_CROSSLEY),
    ):
        feed(estimator, samples(law))
        model = estimator.model
        assert isinstance(model, kind)
        assert model.parameters[0] == pytest.approx(law[0], rel=0.2)


@given(
    st.lists(
        st.tuples(st.floats(-0.01, 0.1), st.floats(-1.0, 1.0), st.floats(-1.0, 100.0), st.booleans()),
        min_size=1,
        max_size=200,
    )
)
def test_descent_keeps_the_bounds(rows: list[tuple[float, float, float, bool]]) -> None:
    estimator = SteepestDescent()
    for index, row in enumerate(rows):
        estimator.update(ContactSample(index * 1e-3, *row))
    model = estimator.model
    if model is not None:
        assert isinstance(model, ContinuousSwitching)
        assert 1.0 - 1e-9 <= model.exponent + model.switching < 2.0
        assert 0.0 <= model.switching <= 1.0


def test_a_step_that_diverges_is_refused() -> None:
    with pytest.raises(SettingError, match="below 2"):
        SteepestDescentOptions(step=2.0)

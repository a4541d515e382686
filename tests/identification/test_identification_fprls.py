"""The paper's estimator against its own equations, least squares, and known parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.identification import FPRLS, ContactSample, Estimator, FPRLSOptions, Status

TRUE = np.array([math.log(3000.0), 1.4, 0.5, 1e-3])


def samples(
    count: int = 400, *, noise: float = 0.0, seed: int = 0, theta: NDArray[np.float64] = TRUE
) -> list[ContactSample]:
    """Samples of the linearised law itself."""
    random = np.random.default_rng(seed)
    time = 0.01 * np.arange(count)
    depth = 0.008 + 0.006 * np.sin(1.7 * time) * np.cos(0.4 * time)
    velocity = np.gradient(depth, time) + random.normal(0.0, 0.01, count)
    log_force = theta[0] + theta[1] * np.log(depth) + theta[2] * velocity + theta[3] * velocity / depth
    force = np.exp(log_force + random.normal(0.0, noise, count))
    rows = zip(time.tolist(), depth.tolist(), velocity.tolist(), force.tolist(), strict=True)
    return [ContactSample(*row, True) for row in rows]


def linear(estimator: Estimator) -> list[float]:
    """(ln k, s, b1, b2) as they are known now."""
    model = estimator.model
    assert model is not None
    return list(model.parameters)


def as_printed(data: list[ContactSample], options: FPRLSOptions) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Equation (20), line by line."""
    theta, p = np.array(options.initial_parameters), options.initial_covariance * np.eye(4)
    before = data[0].depth
    for sample in data:
        x, v = sample.depth, sample.velocity
        phi, y = np.array([1.0, math.log(x), v, v / x]), math.log(sample.force)
        mu = 0.95 + 0.05 * math.exp(-options.forgetting_rate * abs(x - before))
        before = x
        k = p @ phi / (mu + phi @ p @ phi)
        e = y - phi @ theta
        theta = theta + k * e
        p = (np.eye(4) - np.outer(k, phi)) @ p / mu
        if options.sensitivity * e**2 >= 1.0:
            p = p + options.perturbation * np.eye(4)
    return theta, p


@pytest.mark.parametrize(
    "options",
    [
        FPRLSOptions(initial_covariance=100.0, perturbation=10.0),
        FPRLSOptions(initial_covariance=100.0, perturbation=10.0, sensitivity=25.0, forgetting_rate=5000.0),
        FPRLSOptions(initial_covariance=10.0, forgetting_rate=0.0, initial_parameters=(7.0, 1.0, 0.0, 0.0)),
    ],
)
def test_it_is_equation_20(options: FPRLSOptions) -> None:
    data = samples(noise=0.1)
    estimator = FPRLS(options)
    for sample in data:
        assert estimator.update(sample) is Status.LEARNT
    theta, covariance = as_printed(data, options)
    np.testing.assert_allclose(linear(estimator), theta, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(estimator.unscaled_covariance, covariance, rtol=1e-6, atol=1e-9)


def test_without_forgetting_it_is_regularised_least_squares() -> None:
    data = samples(noise=0.1)
    options = FPRLSOptions(initial_covariance=50.0, perturbation=0.0, forgetting_rate=0.0)
    estimator = FPRLS(options)
    for sample in data:
        estimator.update(sample)
    phi = np.array([[1.0, math.log(s.depth), s.velocity, s.velocity / s.depth] for s in data])
    y = np.log([s.force for s in data])
    expected = np.linalg.solve(phi.T @ phi + np.eye(4) / 50.0, phi.T @ y)
    np.testing.assert_allclose(linear(estimator), expected, rtol=1e-8)


def test_known_parameters_are_found_and_a_sudden_change_is_followed() -> None:
    estimator = FPRLS()
    for sample in samples():
        estimator.update(sample)
    np.testing.assert_allclose(linear(estimator), TRUE, rtol=1e-3, atol=1e-3)
    stiffer = TRUE + np.array([3.0, 0.2, 0.0, 0.0])  # about 2 in ln F: the self-perturbing test trips
    for sample in samples(theta=stiffer, seed=1):
        estimator.update(sample)
    np.testing.assert_allclose(linear(estimator), stiffer, rtol=1e-2, atol=2e-2)


def test_free_air_and_unusable_samples_change_nothing() -> None:
    estimator = FPRLS()
    for sample in samples(50):
        estimator.update(sample)
    before, covariance = estimator.parameters, estimator.unscaled_covariance
    assert estimator.update(ContactSample(9.0, -0.001, 0.0, 0.0, False)) is Status.FREE_AIR
    for bad in (
        ContactSample(9.0, 0.0, 0.0, 1.0, True),
        ContactSample(9.0, 0.01, 0.0, 0.0, True),
        ContactSample(9.0, 0.01, math.nan, 1.0, True),
        ContactSample(9.0, math.nan, 0.0, 1.0, True),
    ):
        assert estimator.update(bad) is Status.UNUSABLE
    assert estimator.parameters == before
    np.testing.assert_array_equal(estimator.unscaled_covariance, covariance)


def test_no_model_before_twenty_samples_and_none_after_a_reset() -> None:
    estimator = FPRLS()
    for count, sample in enumerate(samples(25), start=1):
        estimator.update(sample)
        assert (estimator.model is None) == (count < 20)
    assert estimator.standard_errors is None
    estimator.reset()
    assert estimator.model is None
    assert estimator.parameters == {}


@given(
    st.lists(
        st.tuples(st.floats(-0.01, 0.1), st.floats(-1.0, 1.0), st.floats(-1.0, 100.0), st.booleans()),
        min_size=1,
        max_size=200,
    )
)
def test_arbitrary_samples_never_raise_and_never_leave_the_numbers(
    rows: list[tuple[float, float, float, bool]],
) -> None:
    estimator = FPRLS()
    for index, row in enumerate(rows):
        estimator.update(ContactSample(index * 1e-3, *row))
        covariance = estimator.unscaled_covariance
        assert np.isfinite(covariance).all()
        np.testing.assert_array_equal(covariance, covariance.T)
        model = estimator.model
        if model is not None:
            assert all(map(math.isfinite, model.parameters))


def test_a_position_held_for_long_does_not_break_it() -> None:
    estimator = FPRLS()
    random = np.random.default_rng(3)
    for index in range(20_000):
        depth = 0.01 + random.normal(0.0, 5e-6)
        estimator.update(
            ContactSample(index * 1e-3, depth, random.normal(0.0, 1e-3), 5.0 + random.normal(0.0, 0.02), True)
        )
    assert np.isfinite(estimator.unscaled_covariance).all()


@pytest.mark.parametrize(
    "options",
    [
        {"initial_covariance": 0.0},
        {"perturbation": -1.0},
        {"forgetting_rate": math.nan},
        {"initial_parameters": (0.0, 0.0)},
        {"initial_parameters": (0.0, 0.0, math.inf, 0.0)},
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(SettingError, match=next(iter(options))):
        FPRLSOptions(**options)  # type: ignore[arg-type]

"""From (ln k, s, b1, b2) back to k, lambda, n, alpha."""

from __future__ import annotations

import math

import numpy as np
import pytest
from counted_depths import CountedDepths
from hypothesis import given
from hypothesis import strategies as st

from foretouch.identification import RLS, ContactSample, ContactSamples, ForgettingRLS, FPRLSOptions, RobustOptions
from foretouch.identification.linear.recovery import INVERSE_DEPTH, recover

SURE = 1e-12 * np.eye(4)


def summary(depths: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    seen = CountedDepths()
    for depth, velocity in zip(depths.tolist(), velocities.tolist(), strict=True):
        seen.add(depth, velocity)
    return seen.weights


def motion(low: float = 0.002, high: float = 0.012, count: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    phase = np.linspace(0.0, 40.0, count)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    depth = middle + half * np.sin(phase)
    return depth, half * 2.0 * np.cos(phase) + 0.2 * half * np.cos(3.1 * phase)


@given(st.floats(0.0, 1.0), st.floats(0.01, 2.0))
def test_the_law_is_found_again_from_its_own_linear_numbers(alpha: float, damping_share: float) -> None:
    """b1 and b2 from a least squares fit by NumPy over the depths themselves."""
    depth, velocity = motion()
    a1, a2 = np.linalg.lstsq(
        velocity[:, None] * np.c_[np.ones(depth.size), 1 / depth], velocity * depth**-alpha, rcond=None
    )[0]
    k, s = 3000.0, 1.5
    damping = damping_share * k
    result = recover((math.log(k), s, a1 * damping / k, a2 * damping / k), SURE, summary(depth, velocity))
    assert result.stiffness == pytest.approx(k)
    assert result.switching == pytest.approx(alpha, abs=5e-3)
    assert result.damping == pytest.approx(damping, rel=0.03)
    assert result.exponent == pytest.approx(s - alpha, abs=5e-3)


def test_the_limits_of_17_are_hunt_crossley_and_kelvin_voigt() -> None:
    depths = summary(*motion())
    soft = recover((8.0, 1.4, 0.5, 0.0), SURE, depths)
    assert (soft.switching, soft.exponent) == (0.0, 1.4)
    assert soft.damping == pytest.approx(0.5 * math.exp(8.0))
    stiff = recover((8.0, 1.0, 0.0, 0.083), SURE, depths)
    assert (stiff.switching, stiff.exponent) == (1.0, 0.0)
    assert stiff.damping == pytest.approx(0.083 * math.exp(8.0))


@pytest.mark.parametrize(
    ("linear", "uncertainty", "depths"),
    [
        ((8.0, 1.4, -0.5, 0.0), 1e-6, motion()),  # damping is negative
        ((8.0, 1.4, -2.0, 0.02), 1e-6, motion()),  # b1 and b2 contradict each other
        ((8.0, 1.4, 0.5, 0.001), 0.5, motion()),  # they may be anything
        ((8.0, 1.4, 0.5, 0.001), 1e-6, motion(0.0079, 0.0081)),  # one depth
        ((8.0, 1.4, 0.5, 0.001), 1e-6, (np.full(50, 0.01), np.zeros(50))),  # no motion
    ],
)
def test_undetermined_is_an_answer(
    linear: tuple[float, float, float, float], uncertainty: float, depths: tuple[np.ndarray, np.ndarray]
) -> None:
    result = recover(linear, uncertainty**2 * np.eye(4), summary(*depths))
    assert result[1:] == (None, None, None)
    assert result.stiffness == pytest.approx(math.exp(8.0))


sizes = st.one_of(st.floats(-10.0, 10.0), st.floats(allow_nan=False, allow_infinity=False))


@given(st.tuples(sizes, sizes, sizes, sizes), st.floats(0.0, 1e200), st.lists(st.tuples(sizes, sizes), max_size=20))
def test_no_numbers_make_it_raise_or_answer_with_none_such(
    linear: tuple[float, float, float, float], variance: float, rows: list[tuple[float, float]]
) -> None:
    """Warnings of overflow count as failures here."""
    seen = np.concatenate((np.column_stack(motion(count=50)), np.array(rows).reshape(-1, 2)))
    result = recover(linear, variance * np.eye(4), summary(*seen.T))
    assert all(value is None or math.isfinite(value) for value in result)
    assert result.switching is None or 0.0 <= result.switching <= 1.0


def test_without_a_covariance_nothing_but_the_stiffness_is_determined() -> None:
    assert recover((8.0, 1.4, 0.5, 0.001), None, summary(*motion()))[1:] == (None, None, None)
    assert recover((800.0, 1.4, 0.5, 0.001), SURE, summary(*motion())) == (None, None, None, None)


def exact(alpha: float, *, noise: float = 0.0, seed: int = 0) -> list[ContactSample]:
    """Samples of the law (4) itself, k = 3000, s = 1.5, with a damping of some hundredths of the force."""
    depth, velocity = motion()
    random = np.random.default_rng(seed)
    phi = 0.02 * 0.006**alpha / 0.01 * velocity
    force = 3000.0 * depth ** (1.5 - alpha) * (depth**alpha + phi) * np.exp(random.normal(0.0, noise, depth.size))
    return [
        ContactSample(0.0, *row, True) for row in zip(depth.tolist(), velocity.tolist(), force.tolist(), strict=True)
    ]


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize(
    "options", [{}, {"depth_unit": "mm"}, {"robust": RobustOptions(scaled=True, weight_force=1.0)}]
)
def test_least_squares_finds_the_exact_law(alpha: float, options: dict[str, object]) -> None:
    """Up to the error of the linearisation, which is small here: damping is at most 2 % of the force."""
    estimator = RLS(FPRLSOptions(**options))  # type: ignore[arg-type]
    for sample in exact(alpha):
        estimator.update(sample)
    result = estimator.parameters
    assert list(result) == ["ln_k", "s", "b1", "b2", "stiffness", "damping", "exponent", "switching"]
    assert result["stiffness"] == pytest.approx(3000.0, rel=0.02)
    assert result["switching"] == pytest.approx(alpha, abs=0.05)
    assert result["exponent"] == pytest.approx(1.5 - alpha, abs=0.05)
    assert result["damping"] == pytest.approx(0.02 * 0.006**alpha / 0.01 * 3000.0, rel=0.3)


def test_noise_makes_it_uncertainty_then_give_up() -> None:
    """Standard errors of the recovered law are its spread, and a noise that drowns the damping leaves it open."""
    runs = []
    for seed in range(40):
        estimator = RLS()
        for sample in exact(0.5, noise=0.01, seed=seed):
            estimator.update(sample)
        runs.append((estimator.parameters, estimator.standard_errors))
    for name in ("stiffness", "damping", "exponent", "switching"):
        spread = np.std([values[name] for values, _ in runs])
        claimed = np.mean([errors[name] for _, errors in runs if errors is not None])
        assert claimed == pytest.approx(spread, rel=0.35)
    noisy = RLS()
    for sample in exact(0.5, noise=0.3):
        noisy.update(sample)
    assert noisy.parameters["switching"] is None
    assert noisy.parameters["stiffness"] is not None
    errors = noisy.standard_errors
    assert errors is not None
    assert errors["switching"] is None
    assert errors["stiffness"] is not None


def test_old_depths_fade_with_what_was_learnt_there() -> None:
    depth = np.repeat([0.002, 0.01], [1000, 100_000])
    estimator = ForgettingRLS(forgetting_factor=0.99)
    estimator.run(ContactSamples(1e-3 * np.arange(depth.size), depth, np.full(depth.size, 0.01), 1000.0 * depth))
    weights = estimator._state.bins / estimator._state.bins.sum()
    assert float(weights @ (1 / INVERSE_DEPTH)) == pytest.approx(0.01, rel=0.05)

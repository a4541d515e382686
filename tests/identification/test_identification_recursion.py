"""The shared recursion against batch least squares, its interpreted twin, and each of its choices."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from foretouch.core.compiling import interpreted
from foretouch.errors import SettingError
from foretouch.identification import (
    FPRLS,
    RLS,
    ContactSample,
    Estimator,
    ForgettingRLS,
    FPRLSOptions,
    RobustFPRLS,
    RobustOptions,
    SelfPerturbingRLS,
    Status,
)
from foretouch.identification.linear import recursion
from foretouch.identification.linear.kernel import bounded_rate
from foretouch.identification.linear.recursion import PERTURBED, Recursion

Array = NDArray[np.float64]
TRUE = np.array([math.log(3000.0), 1.4, 0.5, 1e-3])


def samples(count: int = 400, *, noise: float = 0.1, seed: int = 0, theta: Array = TRUE) -> list[ContactSample]:
    """Samples of the linearised law itself."""
    random = np.random.default_rng(seed)
    time = 0.01 * np.arange(count)
    depth = 0.008 + 0.006 * np.sin(1.7 * time) * np.cos(0.4 * time)
    velocity = np.gradient(depth, time) + random.normal(0.0, 0.01, count)
    log_force = theta[0] + theta[1] * np.log(depth) + theta[2] * velocity + theta[3] * velocity / depth
    force = np.exp(log_force + random.normal(0.0, noise, count))
    rows = zip(time.tolist(), depth.tolist(), velocity.tolist(), force.tolist(), strict=True)
    return [ContactSample(*row, True) for row in rows]


def regressors(data: list[ContactSample], unit: float = 1.0) -> tuple[Array, Array]:
    """Phi and y, with depths in a unit of so many metres."""
    rows = [[1.0, math.log(s.depth / unit), s.velocity / unit, s.velocity / s.depth] for s in data]
    return np.array(rows), np.log([s.force for s in data])


def fed(estimator: Estimator, data: list[ContactSample]) -> Any:
    for sample in data:
        assert estimator.update(sample) is Status.LEARNT
    return estimator


def linear(estimator: Estimator) -> list[float]:
    model = estimator.model
    assert model is not None
    return list(model.parameters)


@pytest.mark.parametrize("form", [False, True])
def test_the_interpreted_step_is_the_compiled_one(form: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    phi, y = regressors(samples(100))
    compiled = np.zeros(4), 1e3 * np.eye(4), np.zeros(2)
    plain = np.zeros(4), 1e3 * np.eye(4), np.zeros(2)
    answers = set()
    for row, target in zip(phi, y, strict=True):
        arguments = (row, target, 2.0, 0.99, (4.0, 50.0, form, 5e3))
        answer = recursion._step(*compiled, *arguments)
        with monkeypatch.context() as patch:
            patch.setattr(recursion, "_perturb", interpreted(recursion._perturb))
            assert interpreted(recursion._step)(*plain, *arguments) == answer
        answers.add(answer)
    assert answers == {1, 2}  # some samples tripped the test
    for ours, theirs in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


def test_with_weights_and_forgetting_it_is_weighted_least_squares() -> None:
    phi, y = regressors(samples())
    random = np.random.default_rng(1)
    weights = random.uniform(0.1, 3.0, y.size)
    problem = Recursion(np.array([7.0, 1.0, 0.0, 0.0]), 40.0)
    for row, target, weight in zip(phi, y, weights, strict=True):
        problem.learn(tuple(row), target, 0.99, weight)
    age = np.arange(y.size)[::-1]
    total = weights * 0.99**age
    prior = np.eye(4) / 40.0 * 0.99**y.size
    information = phi.T @ (total[:, None] * phi) + prior
    expected = np.linalg.solve(information, phi.T @ (total * y) + prior @ [7.0, 1.0, 0.0, 0.0])
    np.testing.assert_allclose(problem.theta, expected, rtol=1e-7)
    np.testing.assert_allclose(problem.covariance, np.linalg.inv(information), rtol=1e-6)


def test_the_residual_variance_is_that_of_the_residuals_left() -> None:
    phi, y = regressors(samples(300))
    problem = Recursion(np.zeros(4), 1e9)
    for row, target in zip(phi, y, strict=True):
        problem.learn(tuple(row), target)
    left = y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]
    assert problem.residual_variance == pytest.approx(left @ left / (300 - 4), rel=1e-3)
    assert Recursion(np.zeros(4), 1.0).residual_variance is None


def test_the_trace_of_p_stays_within_its_limit() -> None:
    """Held and perturbed again and again; without a limit both take it far beyond."""
    for limit in (50.0, math.inf):
        problem = Recursion(np.zeros(2), 1.0, sensitivity=1.0, perturbation=1e6, trace_limit=limit)
        traces = []
        tripped = 0
        for index in range(3000):
            target = 5.0 if index % 700 == 0 else 1.0
            tripped += problem.learn((1.0, 0.5), target, 0.97) == PERTURBED
            traces.append(float(np.trace(problem.covariance)))
        assert tripped > 3
        assert (max(traces) <= 50.0 * (1 + 1e-12)) == (limit == 50.0)


def test_depth_in_millimetres_is_the_same_recursion_in_millimetres() -> None:
    data = samples()
    estimator = fed(FPRLS(FPRLSOptions(initial_covariance=100.0, perturbation=10.0, depth_unit="mm")), data)
    phi, y = regressors(data, 1e-3)
    theta, p, before = np.zeros(4), 100.0 * np.eye(4), data[0].depth
    for row, target, sample in zip(phi, y, data, strict=True):
        mu = 0.95 + 0.05 * math.exp(-1000.0 * abs(sample.depth - before))
        before = sample.depth
        k = p @ row / (mu + row @ p @ row)
        e = target - row @ theta
        theta = theta + k * e
        p = (np.eye(4) - np.outer(k, row)) @ p / mu + (10.0 if e**2 >= 1.0 else 0.0) * np.eye(4)
    in_metres = [theta[0] + theta[1] * math.log(1000.0), theta[1], 1000.0 * theta[2], theta[3]]
    np.testing.assert_allclose(linear(estimator), in_metres, rtol=1e-7)
    np.testing.assert_allclose(estimator.unscaled_covariance, p, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"depth_unit": "mm"}, {"robust": RobustOptions(scaled=True)}])
def test_units_and_scales_do_not_change_what_it_converges_to(options: dict[str, Any]) -> None:
    data = samples(noise=0.05)
    phi, y = regressors(data)
    expected = np.linalg.lstsq(phi, y, rcond=None)[0]
    np.testing.assert_allclose(linear(fed(RLS(FPRLSOptions(**options)), data)), expected, rtol=3e-3)


def test_initial_parameters_are_in_metres_whatever_the_unit() -> None:
    """A confident start stays where it was."""
    for unit in ("m", "mm"):
        options = FPRLSOptions(
            initial_covariance=1e-12, perturbation=0.0, initial_parameters=tuple(TRUE.tolist()), depth_unit=unit
        )
        np.testing.assert_allclose(linear(fed(FPRLS(options), samples(30))), TRUE, rtol=1e-6)


def sudden(size: float) -> list[ContactSample]:
    return [*samples(100, noise=0.0), *samples(3, noise=0.0, theta=TRUE + np.array([size, 0.0, 0.0, 0.0]))]


def test_the_test_sees_logarithms_or_newtons() -> None:
    """A change of ln F by 0.6 at some newtons is no e of the logarithm, but more than 1 N."""
    data = sudden(0.6)
    assert min(s.force for s in data[100:]) > 5.0
    for error, tripped in (("log", False), ("newton", True)):
        estimator = fed(SelfPerturbingRLS(FPRLSOptions(perturbation_error=error)), data[:100])
        settled = np.trace(estimator.unscaled_covariance)
        fed(estimator, data[100:101])
        assert (np.trace(estimator.unscaled_covariance) > settled + 1e6) == tripped


def test_p_is_enlarged_after_the_gain_or_before_it() -> None:
    data = sudden(3.0)
    errors = {}
    for moment in ("after", "before"):
        estimator = fed(SelfPerturbingRLS(FPRLSOptions(perturbation_moment=moment)), data[:101])
        model, newest = estimator.model, data[100]
        errors[moment] = abs(math.log(model.advance((), newest.depth, newest.velocity, 1e-3)[1] / newest.force))
    assert errors["before"] < 1e-3 < 1.0 < errors["after"]


def test_delta_is_added_or_takes_the_place_of_p() -> None:
    data = sudden(3.0)
    for form in ("add", "reset"):
        options = FPRLSOptions(initial_covariance=1.0, perturbation=1e4, perturbation_form=form)
        estimator = fed(SelfPerturbingRLS(options), data[:100])
        before = estimator.unscaled_covariance
        fed(estimator, data[100:101])
        assert (np.diag(estimator.unscaled_covariance) == 1e4).all() == (form == "reset")
        assert not (np.diag(before) >= 1e4).any()


def test_each_estimator_forgets_as_it_says() -> None:
    """A change too small for the self-perturbing test: only those that forget follow it."""
    data = [*samples(600, noise=0.0), *samples(600, noise=0.0, theta=TRUE + np.array([0.5, 0.0, 0.0, 0.0]))]
    quick = FPRLS(FPRLSOptions(forgetting_rate=1e4))
    result = {
        type(estimator).__name__: linear(fed(estimator, data))[0] - TRUE[0]
        for estimator in (RLS(), SelfPerturbingRLS(), ForgettingRLS(forgetting_factor=0.97), quick)
    }
    assert result["ForgettingRLS"] == pytest.approx(0.5, abs=0.02)
    assert result["FPRLS"] == pytest.approx(0.5, abs=0.02)
    assert abs(result["RLS"] - 0.5) > 0.1
    assert abs(result["SelfPerturbingRLS"] - 0.5) > 0.1


def test_what_is_forgotten_is_forgotten_by_distance_moved() -> None:
    """The same path in a hundred times as many samples forgets as much; held still, nothing is forgotten."""
    estimator = FPRLS()
    path = 0.02
    slow, fast = (estimator.forgetting.factor(path / steps) ** steps for steps in (20_000, 2_000))
    assert slow == pytest.approx(math.exp(-1.0), rel=0.01)
    assert fast == pytest.approx(slow, rel=0.01)
    assert estimator.forgetting.factor(0.0) == 1.0


def test_standard_errors_are_the_spread_of_the_estimates() -> None:
    result, claimed = [], []
    for seed in range(150):
        estimator = fed(RLS(), samples(200, seed=seed))
        result.append(linear(estimator))
        errors = estimator.standard_errors
        claimed.append([errors[name] for name in ("ln_k", "s", "b1", "b2")])
    np.testing.assert_allclose(np.mean(claimed, axis=0), np.std(result, axis=0), rtol=0.2)
    for other in (FPRLS(), SelfPerturbingRLS(), RobustFPRLS()):
        assert fed(other, samples(200)).standard_errors is None
    assert fed(ForgettingRLS(), samples(200)).standard_errors is not None


def test_gates_clamp_and_weights() -> None:
    robust = RobustOptions(gate_force=0.5, gate_depth=1e-3, largest_rate=10.0, weight_force=2.0)
    estimator = RLS(FPRLSOptions(robust=robust))
    assert estimator.update(ContactSample(0.0, 0.01, 0.0, 0.4, True)) is Status.GATED
    assert estimator.update(ContactSample(0.0, 5e-4, 0.0, 4.0, True)) is Status.GATED
    assert estimator.update(ContactSample(0.0, 0.01, 0.0, 4.0, True)) is Status.LEARNT
    assert (bounded_rate(0.01, 1.0, 10.0), bounded_rate(0.01, -1.0, 10.0)) == (10.0, -10.0)
    assert bounded_rate(0.01, 0.05, 10.0) == 5.0
    assert robust.weight(4.0) == 4.0
    assert (bounded_rate(1e-4, 1.0, math.inf), RobustOptions().weight(4.0)) == (1e4, 1.0)


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (FPRLSOptions, {"depth_unit": "km"}),
        (FPRLSOptions, {"perturbation_error": "volt"}),
        (FPRLSOptions, {"perturbation_moment": "never"}),
        (FPRLSOptions, {"perturbation_form": "multiply"}),
        (RobustOptions, {"gate_force": -1.0}),
        (RobustOptions, {"covariance_limit": 0.0}),
        (RobustOptions, {"largest_rate": math.nan}),
        (ForgettingRLS, {"forgetting_factor": 1.1}),
    ],
)
def test_choices_that_there_are_not_are_refused(make: Any, options: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match=next(iter(options))):
        make(**options)

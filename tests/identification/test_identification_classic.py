"""Kelvin-Voigt, Hunt-Crossley and the switch between them, against batch least squares and known laws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from foretouch.errors import SettingError
from foretouch.identification import (
    ContactSample,
    Estimator,
    HuntCrossleyLogOptions,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    KelvinVoigtOptions,
    KelvinVoigtRLS,
    RobustOptions,
    Status,
    ThresholdSwitching,
    TwoStageOptions,
)
from foretouch.models import ContactModel, HuntCrossley, KelvinVoigt

SCALED = RobustOptions(scaled=True)


def samples(
    law: ContactModel, count: int = 4000, *, noise: float = 0.0, seed: int = 0, rate: float = 500.0, lag: int = 0
) -> list[ContactSample]:
    """A motion between 2 and 14 mm at up to 40 mm/s; `lag` delays the force by so many samples."""
    time = np.arange(count) / rate
    depth = 0.008 + 0.004 * np.sin(5.0 * time) + 0.002 * np.sin(8.3 * time)
    velocity = np.gradient(depth, time)
    force = np.array([law.advance((), x, v, 1.0)[1] for x, v in zip(depth, velocity, strict=True)])
    force = np.roll(force, lag) + np.random.default_rng(seed).normal(0.0, noise, count)
    rows = zip(time[lag:].tolist(), depth[lag:].tolist(), velocity[lag:].tolist(), force[lag:].tolist(), strict=True)
    return [ContactSample(*row, True) for row in rows]


def fed(estimator: Any, data: list[ContactSample]) -> Any:
    for sample in data:
        assert estimator.update(sample) is Status.LEARNT
    return estimator


def table(data: list[ContactSample]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns = np.array([[s.depth, s.velocity, s.force] for s in data]).T
    return columns[0], columns[1], columns[2]


@pytest.mark.parametrize("robust", [RobustOptions(), SCALED])
def test_kelvin_voigt_is_least_squares_with_its_standard_errors(robust: RobustOptions) -> None:
    data = samples(KelvinVoigt(800.0, 5.0), noise=0.05)
    x, v, force = table(data)
    regressors = np.c_[x, v]
    expected, _, _, _ = np.linalg.lstsq(regressors, force, rcond=None)
    estimator = fed(KelvinVoigtRLS(KelvinVoigtOptions(robust=robust)), data)
    np.testing.assert_allclose(estimator.model.parameters, expected, rtol=1e-5)
    left = force - regressors @ expected
    covariance = np.linalg.inv(regressors.T @ regressors) * (left @ left) / (force.size - 2)
    np.testing.assert_allclose(list(estimator.standard_errors.values()), np.sqrt(np.diag(covariance)), rtol=1e-3)


@pytest.mark.parametrize("robust", [RobustOptions(), SCALED])
def test_a_force_that_lags_gives_no_negative_damping(robust: RobustOptions) -> None:
    """The bound is part of the fit: K is what fits best with B = 0."""
    data = samples(KelvinVoigt(800.0, 0.0), lag=10)
    x, _, force = table(data)
    model = fed(KelvinVoigtRLS(KelvinVoigtOptions(robust=robust)), data).model
    assert model.damping == 0.0
    assert model.stiffness == pytest.approx(x @ force / (x @ x), rel=1e-5)


@pytest.mark.parametrize("robust", [RobustOptions(), SCALED])
def test_hunt_crossley_by_logarithm_is_least_squares(robust: RobustOptions) -> None:
    data = samples(HuntCrossley(3000.0, 1500.0, 1.4), noise=0.01)
    x, v, force = table(data)
    regressors, target = np.c_[np.ones(x.size), v, np.log(x)], np.log(force)
    expected, _, _, _ = np.linalg.lstsq(regressors, target, rcond=None)
    estimator = fed(HuntCrossleyLogRLS(HuntCrossleyLogOptions(robust=robust)), data)
    k = math.exp(expected[0])
    np.testing.assert_allclose(estimator.model.parameters, [k, k * expected[1], expected[2]], rtol=1e-4)


def test_hunt_crossley_by_logarithm_knows_its_errors() -> None:
    """With weights: a noise in newtons is none of equal logarithms."""
    options = HuntCrossleyLogOptions(robust=RobustOptions(weight_force=1.0))
    runs = []
    for seed in range(60):
        estimator = fed(
            HuntCrossleyLogRLS(options), samples(HuntCrossley(3000.0, 1500.0, 1.4), 500, noise=0.02, seed=seed)
        )
        runs.append((estimator.model.parameters, list(estimator.standard_errors.values())))
    spread = np.std([result for result, _ in runs], axis=0)
    np.testing.assert_allclose(np.mean([errors for _, errors in runs], axis=0), spread, rtol=0.2)


def test_the_logarithm_is_as_good_as_phi_is_small() -> None:
    """Pressing only: damping is found to 1 % at phi = 0.02, and far too small at 0.8."""
    result = []
    for damping in (1500.0, 60_000.0):
        data = [s for s in samples(HuntCrossley(3000.0, damping, 1.4)) if s.velocity > 0.0]
        result.append(fed(HuntCrossleyLogRLS(), data).model.damping / damping)
    assert result[0] == pytest.approx(1.0, abs=0.02)
    assert result[1] < 0.8


@pytest.mark.parametrize("start", [1.0, 1.5, 2.0])
def test_two_stages_find_the_force_soon_and_the_law_where_regressors_are_scaled(start: float) -> None:
    law = HuntCrossley(3000.0, 3000.0, 1.4)
    result = {}
    for robust in (RobustOptions(), SCALED):
        estimator = fed(HuntCrossleyTwoStage(TwoStageOptions(initial_exponent=start, robust=robust)), samples(law))
        assert estimator.standard_errors is None
        result[robust.scaled] = estimator.model
        ours, true = (one.advance((), 0.009, 0.0, 1.0)[1] for one in (estimator.model, law))
        assert ours == pytest.approx(true, rel=0.1)
    np.testing.assert_allclose(result[True].parameters, law.parameters, rtol=0.05)
    assert abs(result[False].exponent - 1.4) > abs(result[True].exponent - 1.4)


def test_error_feeds_back_between_the_stages_where_the_depth_hardly_changes() -> None:
    """There k and n move together on k x^n = constant: the force is right, the law is not."""
    law = HuntCrossley(3000.0, 3000.0, 1.4)
    data = [s._replace(depth=0.008 + 0.01 * (s.depth - 0.008)) for s in samples(law, 20_000)]
    data = [s._replace(force=law.advance((), s.depth, s.velocity, 1.0)[1]) for s in data]
    model = fed(HuntCrossleyTwoStage(TwoStageOptions(initial_exponent=2.0)), data).model
    assert abs(model.exponent - 1.4) > 0.2
    assert model.advance((), 0.008, 0.0, 1.0)[1] == pytest.approx(law.advance((), 0.008, 0.0, 1.0)[1], rel=0.02)


def test_forgetting_follows_a_change() -> None:
    before, after = samples(KelvinVoigt(800.0, 5.0)), samples(KelvinVoigt(1600.0, 5.0))
    quick, slow = KelvinVoigtRLS(KelvinVoigtOptions(forgetting_factor=0.99)), KelvinVoigtRLS()
    for estimator in (quick, slow):
        fed(estimator, before + after)
    assert quick.model is not None
    assert quick.model.stiffness == pytest.approx(1600.0, rel=1e-3)
    assert slow.model is not None
    assert slow.model.stiffness == pytest.approx(1200.0, rel=0.05)


def test_the_threshold_chooses_the_law() -> None:
    soft, stiff = HuntCrossley(3000.0, 1500.0, 1.4), KelvinVoigt(6000.0, 50.0)
    estimator = fed(ThresholdSwitching(), samples(soft))
    assert isinstance(estimator.model, HuntCrossley)
    assert estimator.parameters["exponent"] == pytest.approx(1.4, rel=0.01)
    assert list(estimator.standard_errors) == list(estimator.parameters) == ["stiffness", "damping", "exponent"]
    fed(estimator, samples(stiff, 40_000))
    assert isinstance(estimator.model, KelvinVoigt)
    assert estimator.parameters["exponent"] is None
    assert estimator.model.stiffness >= 4000.0


@pytest.mark.parametrize("threshold", [700.0, 900.0])
@pytest.mark.parametrize("method", [HuntCrossleyLogRLS, HuntCrossleyTwoStage])
def test_the_threshold_and_the_method_are_options(threshold: float, method: Any) -> None:
    estimator = ThresholdSwitching(threshold, soft=method())
    model = fed(estimator, samples(KelvinVoigt(800.0, 5.0))).model
    assert isinstance(model, KelvinVoigt if threshold == 700.0 else HuntCrossley)


def test_it_switches_with_a_jump_of_the_force() -> None:
    """A stiffness that grows through the threshold: at one sample the law changes, and the force jumps."""
    estimator = ThresholdSwitching(
        800.0,
        KelvinVoigtRLS(KelvinVoigtOptions(forgetting_factor=0.99)),
        HuntCrossleyLogRLS(HuntCrossleyLogOptions(forgetting_factor=0.99)),
    )
    law = HuntCrossley(3000.0, 1500.0, 1.4)
    before = None
    jumps = []
    for index, sample in enumerate(samples(law, 4000)):
        estimator.update(sample._replace(force=sample.force * (1.0 + index / 2000.0)))
        model = estimator.model
        if before is not None and type(model) is not type(before):
            jumps.append(abs(model.advance((), 0.012, 0.0, 1.0)[1] - before.advance((), 0.012, 0.0, 1.0)[1]))
        before = model
    assert isinstance(before, KelvinVoigt)
    assert max(jumps) > 0.1


@pytest.mark.parametrize("estimator", [KelvinVoigtRLS(), HuntCrossleyLogRLS()])
def test_no_law_without_a_positive_stiffness(estimator: Estimator) -> None:
    """Forces that shrink with depth are no such material."""
    for index in range(100):
        depth = 0.002 + 1e-4 * index
        force = -1.0 if isinstance(estimator, KelvinVoigtRLS) else 1e-4 * depth**-2.0
        estimator.update(ContactSample(0.0, depth, 0.01, force, True))
    assert estimator.updates > 20
    assert estimator.model is None
    assert estimator.parameters == {}


@pytest.mark.parametrize(
    ("make", "options"),
    [
        (KelvinVoigtOptions, {"initial_covariance": 0.0}),
        (KelvinVoigtOptions, {"forgetting_factor": 0.0}),
        (HuntCrossleyLogOptions, {"initial_parameters": (1.0,)}),
        (HuntCrossleyLogOptions, {"forgetting_factor": 1.01}),
        (HuntCrossleyLogOptions, {"initial_parameters": (1.0, math.nan, 0.0)}),
        (TwoStageOptions, {"initial_exponent": 0.0}),
        (TwoStageOptions, {"initial_exponent_covariance": -1.0}),
        (ThresholdSwitching, {"threshold": 0.0}),
    ],
)
def test_options_out_of_range_are_refused(make: Any, options: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match=next(iter(options))):
        make(**options)

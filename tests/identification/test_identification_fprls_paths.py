"""The paths through the linear estimators give the same bits: by sample, by recording, by many recordings, interpreted.

And what they give is what an independent NumPy version of the equation gives.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from counted_depths import CountedDepths
from fprls_numpy import fprls_many_numpy
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_recordings import OPTIONS, Recorded, columns, recorded
from numba import config
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.identification import (
    FPRLS,
    RLS,
    ROBUST,
    ContactSample,
    ContactSamples,
    ForgettingRLS,
    FPRLSOptions,
    RobustFPRLS,
    SelfPerturbingRLS,
    Status,
)
from foretouch.identification.linear.kernel import update
from foretouch.identification.linear.linearised import LinearisedEstimator, LinearRuns, residual_variance

Array = NDArray[np.float64]
HERE = Path(__file__).parent
SHORT, MANY = (400, 131) if not config.DISABLE_JIT else (60, 3)
LONG = 1500 if not config.DISABLE_JIT else 100
"""Interpreted, a sample of a block of recordings takes 10 ms."""


def fprls_many(*recordings: Any, options: FPRLSOptions | None = None, **more: Any) -> LinearRuns:
    """Recordings side by side, each from the beginning."""
    return FPRLS(options).run_many(*recordings, **more)


def samples(recording: Any) -> ContactSamples:
    """One recording; these estimators do not look at its times."""
    return ContactSamples(np.zeros(len(recording[0])), *recording)


def run(estimator: LinearisedEstimator, recording: Any) -> list[Status]:
    """The recording at once: what was done with each sample."""
    return [tuple(Status)[index] for index in estimator.run(samples(recording))]


def by_sample(estimator: LinearisedEstimator, recording: Recorded) -> tuple[list[Status], Array]:
    """`update` with every sample: what it said, and theta after it."""
    output, theta = [], []
    for row in zip(*(column.tolist() for column in recording), strict=True):
        output.append(estimator.update(ContactSample(0.0, *row)))
        theta.append(estimator.linear_parameters)
    return output, np.array(theta)


def same(one: LinearisedEstimator, other: LinearisedEstimator) -> None:
    """All that two estimators know is the same to the last bit."""
    assert one._recordings.tobytes() == other._recordings.tobytes()
    assert one.updates == other.updates
    assert one.parameters == other.parameters
    assert one.standard_errors == other.standard_errors


@pytest.mark.parametrize("name", OPTIONS)
def test_a_recording_is_its_samples_one_by_one(name: str) -> None:
    """Over ten blocks of 256 samples."""
    recording = recorded(2500, 1)
    single, whole = FPRLS(OPTIONS[name]), FPRLS(OPTIONS[name])
    output, theta = by_sample(single, recording)
    assert run(whole, recording) == output
    same(single, whole)
    whole.reset()
    np.testing.assert_array_equal(whole.trajectory(samples(recording)), theta)
    same(single, whole)


@pytest.mark.parametrize(
    "name",
    [
        name if name in ("as printed", "all", "robust", "gates") else pytest.param(name, marks=pytest.mark.long)
        for name in OPTIONS
    ],
)
def test_many_recordings_are_each_by_itself(name: str) -> None:
    """More than the 64 whose samples are ordered at once, and not a multiple of them."""
    recordings = [recorded(SHORT, seed) for seed in range(MANY)]
    many = fprls_many(*columns(recordings), options=OPTIONS[name], every=True)
    parallel = fprls_many(*columns(recordings), options=OPTIONS[name], every=True, parallel=True)
    for index, recording in enumerate(recordings):
        estimator = FPRLS(OPTIONS[name])
        np.testing.assert_array_equal(many.every[:, index], FPRLS(OPTIONS[name]).trajectory(samples(recording)))
        output = run(estimator, recording)
        np.testing.assert_array_equal(many.theta[index], estimator.linear_parameters)
        np.testing.assert_array_equal(many.unscaled_covariance[index], estimator.unscaled_covariance)
        variance = residual_variance(*estimator._state.numbers[14:])
        np.testing.assert_array_equal(many.residual_variance[index], variance)
        assert many.updates[index] == estimator.updates
        assert many.restarts[index] == output.count(Status.RESTARTED)
        assert many.perturbations[index] == estimator.perturbations
    for field in ("theta", "unscaled_covariance", "residual_variance", "updates", "restarts", "perturbations", "every"):
        np.testing.assert_array_equal(getattr(parallel, field), getattr(many, field))


def test_the_recordings_have_all_that_can_happen() -> None:
    """Else the tests above prove little."""
    estimators = {name: FPRLS(options) for name, options in OPTIONS.items()}
    runs = {name: run(estimator, recorded(2500, 1)) for name, estimator in estimators.items()}
    for status in (Status.LEARNT, Status.FREE_AIR, Status.UNUSABLE):
        assert all(output.count(status) > 20 for output in runs.values())
    assert runs["gates"].count(Status.GATED) > 20
    assert runs["breaking"].count(Status.RESTARTED) > 5
    assert runs["as printed"].count(Status.RESTARTED) > 0
    assert all((one.perturbations > 0) == (name != "no test") for name, one in estimators.items())
    paths = {FPRLS(options).trajectory(samples(recorded(2500, 1))).tobytes() for options in OPTIONS.values()}
    assert len(paths) == len(OPTIONS)  # every option changes something


@pytest.mark.parametrize(
    "make", [FPRLS, RLS, ForgettingRLS, SelfPerturbingRLS, RobustFPRLS, lambda: ForgettingRLS(forgetting_factor=0.9)]
)
def test_all_linear_estimators_have_all_paths(make: Any) -> None:
    recordings = [recorded(LONG, seed) for seed in (3, 4)]
    many = make().run_many(*columns(recordings))
    for index, recording in enumerate(recordings):
        single, whole = make(), make()
        by_sample(single, recording)
        run(whole, recording)
        same(single, whole)
        np.testing.assert_array_equal(many.theta[index], single.linear_parameters)


def test_robust_options_are_the_robust_estimator() -> None:
    recordings = columns([recorded(500, seed) for seed in (5, 6)])
    np.testing.assert_array_equal(
        fprls_many(*recordings, options=FPRLSOptions(robust=ROBUST)).theta, RobustFPRLS().run_many(*recordings).theta
    )


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.floats(-0.01, 0.1), st.floats()),
            st.one_of(st.floats(-1.0, 1.0), st.floats()),
            st.one_of(st.floats(-1.0, 100.0), st.floats()),
            st.booleans(),
        ),
        min_size=1,
        max_size=60,
    ),
    st.sampled_from(sorted(OPTIONS)),
)
def test_whatever_comes(rows: list[tuple[float, float, float, bool]], name: str) -> None:
    depth, velocity, force, touching = (np.array(column) for column in zip(*rows, strict=True))
    recording = (depth, velocity, force, touching)
    single, whole = FPRLS(OPTIONS[name]), FPRLS(OPTIONS[name])
    output, _ = by_sample(single, recording)
    assert run(whole, recording) == output
    same(single, whole)
    many = fprls_many(*(column[:, None] for column in recording), options=OPTIONS[name])
    np.testing.assert_array_equal(many.theta[0], single.linear_parameters)
    np.testing.assert_array_equal(many.unscaled_covariance[0], single.unscaled_covariance)


def test_a_run_goes_on_where_samples_and_runs_before_it_ended() -> None:
    recording = recorded(3000, 2)
    parts = [tuple(column[begin:end] for column in recording) for begin, end in ((0, 700), (700, 701), (701, 3000))]
    whole, cut = FPRLS(), FPRLS()
    run(whole, recording)
    run(cut, parts[0])
    by_sample(cut, parts[1])
    run(cut, parts[2])
    same(whole, cut)
    cut.reset()
    run(cut, recording)
    same(whole, cut)


def test_numbers_of_other_types_are_learnt_from_without_compiling_anew() -> None:
    """A compilation inside a loop would hold it up for a second."""
    plain, other = FPRLS(), FPRLS()
    for _ in range(30):
        plain.update(ContactSample(0.0, 1.0, 0.0, 2.0, True))
        other.update(ContactSample(0, 1, np.float32(0.0), np.int64(2), np.True_))  # type: ignore[arg-type]
    same(plain, other)
    assert len(getattr(update, "signatures", [0])) == 1


def test_an_empty_recording_changes_nothing() -> None:
    estimator = FPRLS()
    assert run(estimator, ([], [], [])) == []
    assert estimator.linear_parameters == (0.0, 0.0, 0.0, 0.0)
    assert estimator.trajectory(samples(([], [], []))).shape == (0, 4)
    assert fprls_many(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3))).theta.shape == (3, 4)


def test_without_contact_flags_what_has_no_depth_is_left_out() -> None:
    depth, velocity, force, _ = recorded(300, 7)
    plain, flagged = FPRLS(), FPRLS()
    output = run(plain, (depth, velocity, force))
    run(flagged, (depth, velocity, force, np.ones(300, bool)))
    same(plain, flagged)
    assert output.count(Status.FREE_AIR) == 0
    assert output.count(Status.UNUSABLE) > 100


PRINTED = FPRLSOptions(initial_covariance=100.0, perturbation=10.0)


def test_it_is_what_numpy_makes_of_the_equation() -> None:
    """Well-conditioned, both agree to ten digits; NumPy's logarithms and order of sums are its own."""
    recordings = columns([recorded(SHORT, seed) for seed in range(MANY)])
    recordings[1][np.abs(recordings[1]) > 1e3] = np.nan  # what restarts the recursion depends on rounding there
    ours = fprls_many(*recordings, options=PRINTED)
    theta, covariance = fprls_many_numpy(*recordings, options=PRINTED)
    assert ours.perturbations.sum() > 1
    np.testing.assert_allclose(ours.theta, theta, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(ours.unscaled_covariance, covariance, rtol=1e-9, atol=1e-9)


def test_numpy_restarts_where_a_covariance_overflows() -> None:
    recordings = columns([recorded(200, seed) for seed in range(3)])
    options = OPTIONS["breaking"]
    assert fprls_many(*recordings, options=options).restarts.sum() > 0
    theta, _ = fprls_many_numpy(*recordings, options=options)
    assert np.isfinite(theta).all()
    with pytest.raises(SettingError, match="printed choices"):
        fprls_many_numpy(*recordings, options=OPTIONS["robust"])


def test_the_histogram_of_depths_is_that_of_plain_counting() -> None:
    """What was learnt at which depth; one is the other times a constant."""
    depth = np.geomspace(2e-5, 0.9, 400)
    velocity, force = np.full(400, 0.1), np.full(400, 2.0)
    estimator, summary = FPRLS(FPRLSOptions(perturbation=0.0, forgetting_rate=3.0)), CountedDepths()
    run(estimator, (depth, velocity, force))
    for index, (x, v) in enumerate(zip(depth.tolist(), velocity.tolist(), strict=True)):
        summary.add(x, v, estimator.forgetting.factor(x - depth[index - 1] if index else 0.0))
    ours, expected = estimator._state.bins, summary.weights
    np.testing.assert_allclose(ours / ours.sum(), expected / expected.sum(), rtol=1e-9)


@pytest.mark.parametrize(
    ("arrays", "name"),
    [
        (([1.0], [[1.0]], [[1.0]]), "depth"),
        (([[1.0]], [[1.0, 2.0]], [[1.0]]), "velocity"),
        (([[1.0]], [[1.0]], [1.0]), "force"),
        (([[1.0]], [[1.0]], [[1.0]], [[True, False]]), "in_contact"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arrays: Any, name: str) -> None:
    with pytest.raises(SettingError, match=f"shape of {name}"):
        FPRLS().run_many(*arrays)


def everything(names: list[str]) -> list[str]:
    """All paths over short recordings, in hexadecimal digits."""
    numbers: list[float] = []
    recordings = [recorded(60, seed) for seed in (1, 2)]
    for name in names:
        single = FPRLS(OPTIONS[name])
        by_sample(single, recordings[0])
        numbers += [*single._state.numbers.tolist(), *single._state.bins.tolist()]
        whole = FPRLS(OPTIONS[name])
        run(whole, recordings[0])
        numbers += whole.linear_parameters
        numbers += fprls_many(*columns(recordings), options=OPTIONS[name]).theta.ravel().tolist()
    return [number.hex() for number in numbers]


@pytest.mark.long
def test_interpreted_it_is_the_same_to_the_last_bit() -> None:
    """A process in which nothing is compiled."""
    names = ["as printed", "breaking", "all"]
    program = f"from test_identification_fprls_paths import everything\nprint(*everything({names!r}))"
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == everything(names)

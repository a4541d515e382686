"""The scoring contract: values by hand, edges of the window, what must never look good."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import InputError, SettingError
from foretouch.recordings import read_recording
from foretouch.report import STATUSES, delayed_force, lowest_mean, score_prediction

QUICK = settings(derandomize=True, deadline=None, max_examples=25)
PERIOD = 0.001


def presses(duration: float = 6.0, peak: float = 4.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, position and force of a spring touched from a distance: half of each second in free air."""
    time = np.arange(round(duration / PERIOD)) * PERIOD
    position = -0.01 * np.cos(2 * np.pi * time)
    return time, position, np.maximum(position, 0.0) / 0.01 * peak


def test_perfect_prediction() -> None:
    time, position, force = presses()
    scores = score_prediction(
        time, force + 7.0, force, np.full_like(force, np.nan), contact_floor=0.05, position=position
    )
    assert scores.status == "ok"
    assert scores.prediction_error_percent == pytest.approx(0.0, abs=1e-9)
    assert scores.prediction_rmse_N == pytest.approx(0.0, abs=1e-9)
    assert scores.within_jnd_percent == 100.0
    assert scores.missed_contact_percent == 0.0
    assert scores.phantom_force_rms_N == pytest.approx(0.0, abs=0.2)
    assert scores.delayed_force_error_percent == pytest.approx(100.0)  # nothing arrived: wrong by the force itself
    np.testing.assert_allclose(scores.measured_force, force, atol=1e-12)


@pytest.mark.parametrize(("factor", "percent", "within"), [(1.1, 10.0, 100.0), (0.9, 10.0, 100.0), (1.5, 50.0, 0.0)])
def test_wrong_by_a_share(factor: float, percent: float, within: float) -> None:
    time, _, force = presses(peak=400.0)  # far above 0.05 N: the relative bound decides everywhere
    scores = score_prediction(time, force, factor * force, force, contact_floor=20.0)
    assert scores.prediction_error_percent == pytest.approx(
        percent, rel=0.01
    )  # a few more samples are predicted than are in contact
    assert scores.within_jnd_percent == within
    assert scores.delayed_force_error_percent == pytest.approx(0.0, abs=1e-9)


def test_every_figure_by_hand() -> None:
    """Ten samples of a rest, then nine that are counted on paper."""
    time = np.arange(109) * PERIOD
    measured = np.concatenate((np.zeros(100), [0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 1.0, 0.0, 0.0]))
    predicted = np.concatenate((np.zeros(100), [0.0, 0.6, 1.05, 2.3, 2.0, 0.02, 1.0, 0.09, 0.0]))
    known = np.concatenate((np.zeros(100), [np.nan, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 1.0, 5.0]))
    scores = score_prediction(time, measured + 3.0, predicted, known + 3.0, contact_floor=0.05, score_from=0.1)
    contact_rms = np.sqrt((1 + 4 + 4 + 4 + 1) / 5)
    assert scores.samples == 109
    # the 98th percentile of nine samples is 2.0, so the threshold is 0.1: a prediction of 0.09 is not above it
    assert scores.threshold_N == pytest.approx(0.1)
    assert scores.scored_samples == 6
    errors = np.array([0.6, 0.05, 0.3, 0.0, -1.98, 0.0])
    assert scores.contact_force_rms_N == pytest.approx(contact_rms)
    assert scores.prediction_rmse_N == pytest.approx(np.sqrt(np.mean(errors**2)))
    late = np.array([1.0, 1.0, 0.0, 0.0, -1.0])  # in contact alone: it knows nothing of the prediction
    assert scores.delayed_force_rmse_N == pytest.approx(np.sqrt(np.mean(late**2)))
    assert scores.delayed_force_error_percent == pytest.approx(100 * np.sqrt(np.mean(late**2)) / contact_rms)
    assert scores.within_jnd_percent == pytest.approx(60.0)
    assert scores.missed_contact_percent == pytest.approx(20.0)
    assert scores.phantom_force_rms_N == pytest.approx(np.sqrt((0.36 + 0.0081) / 4))
    assert int(scores.in_contact.sum()) == 5


def test_a_force_predicted_in_free_air_counts_against_the_prediction_alone() -> None:
    time, _, force = presses()
    phantom = np.where(force > 0.2, force, 1.0)
    scores = score_prediction(time, force, phantom, force + 1.0, contact_floor=0.05)
    inside = time >= 1.5
    assert scores.scored_samples == inside.sum()
    assert scores.delayed_force_rmse_N == pytest.approx(1.0)
    contact = inside & scores.in_contact
    assert scores.prediction_rmse_N == pytest.approx(np.sqrt((inside & (force <= 0.2)).sum() / inside.sum()), rel=0.02)
    assert scores.contact_force_rms_N == pytest.approx(np.sqrt(np.mean(force[contact] ** 2)))


def test_the_window_counts_from_the_first_sample_and_holds_both_ends() -> None:
    time, _, force = presses()
    wrong = force.copy()
    wrong[[1499, 3001]] += 10.0  # just outside
    for start in (0.0, 1e5):
        scores = score_prediction(time + start, force, wrong, force, contact_floor=0.05, score_from=1.5, score_to=3.0)
        assert scores.prediction_rmse_N == pytest.approx(0.0, abs=1e-12)
    for index in (1500, 3000):
        wrong = force.copy()
        wrong[index] += 10.0
        scores = score_prediction(time, force, wrong, force, contact_floor=0.05, score_from=1.5, score_to=3.0)
        assert scores.prediction_rmse_N is not None
        assert scores.prediction_rmse_N > 0.1


def test_no_contact_has_null_metrics() -> None:
    time = np.arange(4000) * PERIOD
    noise = np.random.default_rng(1).normal(0.0, 0.005, time.size)
    scores = score_prediction(time, 7.0 + noise, np.full(time.size, 9.0), noise, contact_floor=0.05)
    assert scores.status == "no_contact"
    assert scores.scored_samples == 0
    assert scores.prediction_error_percent is None
    assert scores.phantom_force_rms_N is None
    assert not scores.in_contact.any()


@pytest.mark.parametrize("length", [0, 1, 30])
def test_short_files_have_nothing_to_score(length: int) -> None:
    time = np.arange(length) * PERIOD
    scores = score_prediction(time, time + 1.0, time, time, contact_floor=0.05)
    assert scores.status == "nothing_to_score"
    assert scores.samples == length
    assert scores.contact_force_rms_N is None


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_prediction_that_is_not_finite_never_looks_good(bad: float) -> None:
    time, _, force = presses()
    predicted = force.copy()
    predicted[force > 2.0] = bad
    scores = score_prediction(time, force, predicted, force, contact_floor=0.05)
    assert scores.status == "prediction_not_finite"
    assert scores.prediction_rmse_N is None
    assert scores.prediction_error_percent is None
    percent = 100.0 * np.mean(force[scores.in_contact] > 2.0)
    assert scores.within_jnd_percent == pytest.approx(100.0 - percent, abs=0.5)
    if bad != np.inf:
        assert scores.missed_contact_percent == pytest.approx(percent, abs=0.5)
    everywhere = score_prediction(time, force, np.full(time.size, bad), force, contact_floor=0.05)
    assert everywhere.within_jnd_percent == 0.0
    assert everywhere.phantom_force_rms_N is None


def test_statuses_are_listed() -> None:
    assert set(STATUSES) == {"ok", "no_contact", "nothing_to_score", "prediction_not_finite", "offset_unobservable"}


def test_a_preloaded_spring_never_leaves_contact() -> None:
    time, position, _ = presses()
    preloaded = 400.0 * (position + 0.012)
    scores = score_prediction(time, preloaded, preloaded, preloaded, contact_floor=0.05, position=position)
    assert scores.status == "offset_unobservable"
    assert scores.prediction_error_percent is not None
    blind = score_prediction(time, preloaded, preloaded, preloaded, contact_floor=0.05)
    assert blind.status == "ok"


def test_lowest_mean_is_the_lowest_of_all_runs() -> None:
    rng = np.random.default_rng(2)
    for rate in (1000, 2000):
        time = np.arange(rate) / rate
        force = rng.normal(0.0, 1.0, rate)
        length = rate // 20
        runs = np.convolve(force, np.ones(length) / length, "valid")
        assert lowest_mean(time, force) == pytest.approx(runs.min(), abs=1e-12)


def test_lowest_mean_of_a_short_file_is_its_mean() -> None:
    assert lowest_mean([0.0, 0.001, 0.002], [1.0, 2.0, 6.0]) == pytest.approx(3.0)


def test_lowest_mean_does_not_take_one_sample_after_a_gap() -> None:
    time = np.concatenate((np.arange(500) * PERIOD, 2.0 + np.arange(500) * PERIOD))
    force = np.ones(1000)
    force[500] = -5.0
    assert lowest_mean(time, force) == pytest.approx((9 * 1.0 - 5.0) / 10)  # ten samples, not one


def test_delayed_holds_the_newest_that_arrived() -> None:
    time = np.arange(6) * 0.1
    force = np.arange(1.0, 7.0)
    np.testing.assert_array_equal(delayed_force(time, force, 0.3), [np.nan, np.nan, np.nan, 1, 2, 3])
    np.testing.assert_array_equal(delayed_force(time, force, 0.25), [np.nan, np.nan, np.nan, 1, 2, 3])
    np.testing.assert_array_equal(delayed_force(time, force, 0.0), force)
    np.testing.assert_array_equal(delayed_force(time + 1e4, force, 0.3), [np.nan, np.nan, np.nan, 1, 2, 3])
    np.testing.assert_array_equal(delayed_force(time, force, 9.0), np.full(6, np.nan))
    with pytest.raises(SettingError, match="delay"):
        delayed_force(time, force, -0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"score_from": 2.0, "score_to": 2.0}, "later than score_from"),
        ({"contact_floor": 0.0}, "above 0 N"),
        ({"contact_floor": np.nan}, "above 0 N"),
        ({"score_from": np.nan}, "finite"),
    ],
)
def test_settings_out_of_range(change: dict[str, float], message: str) -> None:
    time, _, force = presses(2.0)
    with pytest.raises(SettingError, match=message):
        score_prediction(time, force, force, force, **{"contact_floor": 0.05, **change})


def test_columns_that_do_not_belong_together() -> None:
    time, _, force = presses(2.0)
    with pytest.raises(InputError, match="shapes"):
        score_prediction(time, force, force[:-1], force, contact_floor=0.05)
    with pytest.raises(InputError, match="sample 7"):
        score_prediction(np.where(np.arange(time.size) == 7, time[6], time), force, force, force, contact_floor=0.05)
    with pytest.raises(InputError, match="sample 3"):
        score_prediction(time, np.where(np.arange(time.size) == 3, np.nan, force), force, force, contact_floor=0.05)


@QUICK
@given(scale=st.floats(0.01, 1e4), seed=st.integers(0, 1000))
def test_percent_errors_do_not_depend_on_the_unit_of_force(scale: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time, position, force = presses(3.0)
    predicted = force * rng.uniform(0.5, 1.5) + rng.normal(0.0, 0.3, time.size)
    known = delayed_force(time, force, 0.3)
    one = score_prediction(time, force, predicted, known, contact_floor=0.05, position=position)
    other = score_prediction(
        time, scale * force, scale * predicted, scale * known, contact_floor=scale * 0.05, position=position
    )
    assert other.prediction_error_percent == pytest.approx(one.prediction_error_percent)
    assert other.delayed_force_error_percent == pytest.approx(one.delayed_force_error_percent)
    assert other.missed_contact_percent == pytest.approx(one.missed_contact_percent)
    assert other.scored_samples == one.scored_samples
    assert other.status == one.status


@QUICK
@given(offset=st.floats(-50.0, 50.0), start=st.floats(0.0, 1e4), seed=st.integers(0, 1000))
def test_sensor_offset_and_clock_start_do_not_matter(offset: float, start: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time, _, force = presses(3.0)
    predicted = np.maximum(0.0, force + rng.normal(0.0, 0.3, time.size))
    one = score_prediction(time, force, predicted, force, contact_floor=0.05)
    other = score_prediction(time + start, force + offset, predicted, force + offset, contact_floor=0.05)
    assert other.prediction_error_percent == pytest.approx(one.prediction_error_percent, rel=1e-6)
    assert other.within_jnd_percent == pytest.approx(one.within_jnd_percent, abs=0.1)
    assert other.delayed_force_error_percent == pytest.approx(one.delayed_force_error_percent, abs=1e-6)
    known = delayed_force(time, force + offset, 0.4)
    late = score_prediction(time, force + offset, predicted, known, contact_floor=0.05, score_from=0.0)
    plain = score_prediction(
        time, force, predicted, delayed_force(time, force, 0.4), contact_floor=0.05, score_from=0.0
    )
    assert late.delayed_force_error_percent == pytest.approx(plain.delayed_force_error_percent, rel=1e-6)
    taken_off = score_prediction(
        time, force + offset, predicted, known - offset, contact_floor=0.05, score_from=0.0, delayed_offset=0.0
    )
    assert taken_off.delayed_force_error_percent == pytest.approx(plain.delayed_force_error_percent, rel=1e-6)


def test_the_delayed_force_has_one_error_whatever_predicts() -> None:
    time, _, force = presses()
    known = delayed_force(time, force + 3.0, 0.3)
    errors = {
        score_prediction(time, force + 3.0, predicted, known, contact_floor=0.05).delayed_force_error_percent
        for predicted in (force, np.roll(force, 100), np.full_like(force, 2.0), np.zeros_like(force))
    }
    assert len(errors) == 1


@QUICK
@given(seed=st.integers(0, 10_000), uneven=st.booleans())
def test_what_is_measured_is_predicted_without_error(seed: int, uneven: bool) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.0005, 0.002, 3000) if uneven else np.full(3000, PERIOD)
    time = np.cumsum(steps)
    measured = np.maximum(0.0, rng.uniform(1.0, 9.0) * np.sin(rng.uniform(2.0, 12.0) * time))
    zero = lowest_mean(time, measured)
    scores = score_prediction(time, measured, measured - zero, measured, contact_floor=0.05)
    assert scores.prediction_error_percent == pytest.approx(0.0, abs=1e-9)
    assert scores.delayed_force_error_percent == pytest.approx(0.0, abs=1e-9)
    assert scores.within_jnd_percent == 100.0
    assert scores.missed_contact_percent == 0.0


MEASURED = {
    "tue/a-foam": "ok",
    "tue/b-foam3": "ok",
    "tue/d-foam2": "ok",
    "tue/e-foam2": "ok",
    "tue/a-rigid": "ok",
    "tue/a-free-motion": "no_contact",
    "tue/a-spring": "offset_unobservable",
    "tue/d-spring": "offset_unobservable",
}


@pytest.mark.parametrize(("name", "status"), MEASURED.items())
def test_status_of_measured_files(measured: Callable[[str], Path], name: str, status: str) -> None:
    recording = read_recording(measured(name))
    time, force = recording.time, recording.force
    scores = score_prediction(
        time, force, force, delayed_force(time, force, 0.3), contact_floor=0.3, position=recording.position
    )
    assert scores.status == status

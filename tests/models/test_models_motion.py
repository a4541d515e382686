"""The motion filter and the predictor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.models import HuntCrossley, MotionFilter, Predictor


def test_velocity_of_a_ramp_is_its_slope() -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    assert MotionFilter().run(time, 0.03 * time)[-1] == pytest.approx(0.03, rel=1e-6)


def test_acceleration_of_a_parabola_is_constant() -> None:
    motion = MotionFilter()
    time = np.arange(0.0, 0.5, 1e-3)
    motion.run(time, 0.5 * 2.0 * time**2)
    assert motion.acceleration == pytest.approx(2.0, rel=1e-3)


def test_velocity_lags_by_about_two_milliseconds() -> None:
    """A first-order low-pass at 80 Hz delays by 1 / (2 pi 80) s = 2.0 ms, give or take the half samples."""
    time = np.arange(0.0, 4.0, 1e-3)
    velocity = MotionFilter().run(time, 0.01 * np.sin(2 * np.pi * 2.0 * time))[1000:]
    lags = np.arange(0.0, 5e-3, 1e-4)
    truth = [0.01 * 2 * np.pi * 2.0 * np.cos(2 * np.pi * 2.0 * (time[1000:] - lag)) for lag in lags]
    best = lags[np.argmin([np.square(velocity - shifted).sum() for shifted in truth])]
    assert 1.5e-3 < best < 2.5e-3


def test_a_5_um_encoder_at_1_khz_leaves_half_a_millimetre_per_second() -> None:
    time = np.arange(0.0, 5.0, 1e-3)
    position = np.round(0.0103 * time / 5e-6) * 5e-6
    assert 1e-4 < (MotionFilter().run(time, position)[100:] - 0.0103).std() < 6e-4


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=2, max_size=20))
def test_no_sample_makes_it_lose_its_mind(positions: list[float]) -> None:
    motion = MotionFilter()
    for index, position in enumerate(positions):
        assert math.isfinite(motion.update(index * 1e-3, max(-1.0, min(1.0, position))))
    assert math.isfinite(motion.update(math.nan, 0.0))


def test_cutoff_must_be_positive() -> None:
    with pytest.raises(SettingError, match="velocity_cutoff"):
        MotionFilter(velocity_cutoff=0.0)


def test_predictor_is_silent_without_a_model_and_runs_the_law_with_one() -> None:
    predictor = Predictor()
    assert [predictor.update(t * 1e-3, 0.02) for t in range(3)] == [0.0, 0.0, 0.0]
    law = HuntCrossley(3000.0, 0.0, 1.4)
    predictor.adopt(law, 0.01)
    assert predictor.update(3e-3, 0.02) == pytest.approx(3000 * 0.01**1.4)
    predictor.adopt(None, 0.01)
    assert predictor.update(4e-3, 0.02) == 0.0


def test_predictor_takes_a_measured_velocity() -> None:
    predictor = Predictor()
    predictor.adopt(HuntCrossley(3000.0, 1500.0, 1.4), 0.0)
    predictor.update(0.0, 0.01, 0.05)
    assert predictor.update(1e-3, 0.01, 0.05) == pytest.approx(0.01**1.4 * (3000 + 1500 * 0.05))

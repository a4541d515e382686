"""The motion filter and the predictor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.models import HuntCrossley, KelvinVoigt, MotionFilter, Predictor


def test_velocity_of_a_ramp_is_its_slope() -> None:
    time = np.arange(0.0, 0.2, 1e-3)
    assert MotionFilter().run(time, 0.03 * time)[-1] == pytest.approx(0.03, rel=1e-6)


def test_acceleration_of_a_parabola_is_constant() -> None:
    time = np.arange(0.0, 0.5, 1e-3)
    velocity = MotionFilter().run(time, 0.5 * 2.0 * time**2)
    assert MotionFilter(velocity_cutoff=40.0).run(time, velocity)[-1] == pytest.approx(2.0, rel=1e-3)


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


@settings(derandomize=True, deadline=None, max_examples=25)
@given(
    stiffness=st.floats(0.0, 1e4), surface=st.floats(-0.02, 0.02), velocity=st.floats(-0.2, 0.2), at=st.integers(1, 8)
)
def test_the_jump_of_a_switch_is_the_difference_of_both_laws(
    stiffness: float, surface: float, velocity: float, at: int
) -> None:
    before, after = HuntCrossley(3000.0, 1500.0, 1.4), KelvinVoigt(stiffness + 1.0, 5.0)
    predictor = Predictor()
    predictor.adopt(before, 0.0)
    jumps = []
    for tick in range(10):
        if tick == at:
            predictor.adopt(after, surface)
        predictor.update(tick * 1e-3, 0.01, velocity)
        jumps.append(predictor.jump)
    old = before.advance((), 0.01, velocity, 1e-3)[1]
    new = after.advance((), 0.01 - surface, velocity, 1e-3)[1]
    expected = np.zeros(10)
    expected[1] = old  # the first sample has no period, so the first model's force begins with the second
    expected[at] = new if at == 1 else new - old
    np.testing.assert_allclose(jumps, expected, rtol=1e-12, atol=1e-12)


def test_jumps_of_no_model_and_of_the_same_model() -> None:
    law, predictor, jumps = HuntCrossley(3000.0, 0.0, 1.4), Predictor(), []
    arrivals = {2: law, 4: HuntCrossley(3000.0, 0.0, 1.4), 6: None, 8: None}
    for tick in range(10):
        if tick in arrivals:
            predictor.adopt(arrivals[tick], 0.01)
        predictor.update(tick * 1e-3, 0.02)
        jumps.append(predictor.jump)
    force = 3000.0 * 0.01**1.4
    np.testing.assert_allclose(jumps, [0, 0, force, 0, 0, 0, -force, 0, 0, 0], rtol=1e-12)
    assert math.isnan(predictor.standard_deviation)


def test_of_several_models_in_one_sample_only_the_last_makes_the_jump() -> None:
    first, middle, last = (HuntCrossley(k, 0.0, 1.0) for k in (100.0, 9000.0, 300.0))
    predictor = Predictor()
    predictor.adopt(first, 0.0)
    predictor.update(0.0, 0.01)
    predictor.update(1e-3, 0.01)
    predictor.adopt(middle, 0.0)
    predictor.adopt(last, 0.0)
    predictor.update(2e-3, 0.01)
    assert predictor.jump == pytest.approx(3.0 - 1.0)

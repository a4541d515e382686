"""Prediction under a delay uses the motion up to now and the forces up to a delay ago, and nothing more."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from presses import press, true_force

from foretouch.errors import RecordingError, SettingError
from foretouch.identification import Learner, Motion, identify, make_estimator, predict, predict_motion
from foretouch.quantities import Recording


def learner(**given_values: float) -> Learner:
    return Learner(make_estimator("continuous-switching", "fprls"), **given_values)


def changed(recording: Recording, *, force_from: float = np.inf, position_from: float = np.inf) -> Recording:
    force, position = recording.force.copy(), recording.position.copy()
    force[recording.time > force_from] = 9.0
    position[recording.time > position_from] = 0.05
    return Recording(recording.time, position, force)


@cache
def predicted_whole(delay: float) -> NDArray[np.float64]:
    return predict(press(duration=3.0, noise=0.01), learner(), delay=delay).force


@pytest.mark.long
@settings(max_examples=8)
@given(st.sampled_from([0.0, 0.001, 0.3, 1.0]), st.floats(1.2, 2.8))
def test_the_future_is_not_used(delay: float, now: float) -> None:
    recording, whole = press(duration=3.0, noise=0.01), predicted_whole(delay)
    past = recording.time <= now
    other = predict(changed(recording, force_from=now - delay + 1e-9, position_from=now), learner(), delay=delay)
    np.testing.assert_array_equal(other.force[past], whole[past])


def test_the_newest_force_allowed_is_used() -> None:
    """The other side of causality: a force that may be known does change the prediction."""
    recording, delay, now = press(duration=4.0), 0.3, 2.5
    whole = predict(recording, learner(), delay=delay).force
    other = predict(changed(recording, force_from=now - delay - 0.0101), learner(), delay=delay).force
    index = int(np.searchsorted(recording.time, now))
    assert whole[index] > 1.0
    assert other[index] != whole[index]


@pytest.mark.long
def test_a_law_that_fits_is_predicted_over_any_delay() -> None:
    recording = press(duration=8.0)
    true = true_force(recording)
    for delay in (0.0, 0.3):
        forces = predict(recording, learner(surface=0.01, force_offset=0.3), delay=delay).force
        late = recording.time > 4.0
        error = np.sqrt(np.mean((forces - true)[late] ** 2))
        assert error < 0.05 * np.sqrt(np.mean(true[late] ** 2))


def test_nothing_is_predicted_before_a_model_has_arrived() -> None:
    recording = press()
    forces = predict(recording, learner(), delay=0.3).force
    assert not forces[recording.time < 1.3].any()
    assert forces.any()


def test_another_motion_gets_its_own_forces() -> None:
    recording = press(duration=4.0)
    every = np.arange(len(recording))
    away = Motion(recording.time, recording.position - 0.1, every, recording.time + 0.1, every + 1)
    assert not predict_motion(recording, learner(), away).force.any()
    same = Motion(recording.time, recording.position, every, recording.time + 0.1, every + 1)
    again, known = predict_motion(recording, learner(), same), predict(recording, learner(), delay=0.1)
    np.testing.assert_array_equal(again.force, known.force)
    np.testing.assert_array_equal(again.jump, known.jump)


def test_only_models_that_arrive_are_used() -> None:
    recording = press(duration=4.0)
    motion = Motion(
        recording.time, recording.position, np.array([2000, 2100]), np.array([2.5, np.inf]), np.array([2001, 2101])
    )
    result = predict_motion(recording, learner(), motion)
    forces = result.force
    assert not forces[recording.time < 2.5 - 1e-6].any()
    assert forces.any()
    assert np.flatnonzero(result.jump).tolist() == [2500]
    assert result.jump[2500] == forces[2500]
    assert np.isnan(result.standard_deviation).all()  # a power law carries no uncertainty
    later = changed(recording, force_from=2.05)  # would show in the model that was lost
    np.testing.assert_array_equal(predict_motion(later, learner(), motion).force, forces)


def test_a_measured_velocity_is_used() -> None:
    recording = press(duration=3.0)
    still = Recording(recording.time, recording.position, recording.force, velocity=np.zeros(len(recording)))
    one, other = (predict(either, learner(), delay=0.1).force for either in (still, recording))
    assert (one != other).any()


def test_a_delay_below_zero_is_refused() -> None:
    with pytest.raises(SettingError, match=r"delay = -0\.3: must be finite and at least 0"):
        predict(press(), learner(), delay=-0.3)


def test_too_little_contact_cannot_be_identified() -> None:
    with pytest.raises(RecordingError, match="samples in contact, at least 50 are needed"):
        identify(press(duration=1.0), learner())

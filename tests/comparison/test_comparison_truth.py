"""What follows from a known truth: the mask, convergence, errors of parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.comparison.truth import (
    LEARNING_TIME,
    Truth,
    convergence,
    local_stiffness,
    parameter_errors,
    unforeseeable,
)
from foretouch.errors import SettingError
from foretouch.identification import LearntModel
from foretouch.models import ContinuousSwitching, HuntCrossley, KelvinVoigt, LinearisedContinuousSwitching
from foretouch.quantities import Recording

SPRING = KelvinVoigt(1000.0, 0.0)


def seconds(*values: float) -> np.ndarray:
    return np.array(values, dtype=np.float64)


def test_depths_that_were_not_reached_before_the_delay_cannot_be_told() -> None:
    time = np.arange(8.0)
    depth = seconds(-1.0, 1.0, 3.0, 2.0, 2.5, 3.5, 1.0, 3.2)
    #  reached 2 s ago:   0    0    0    1    3    3    3    3.5
    expected = [False, True, True, True, False, True, False, False]
    assert unforeseeable(time, depth, 2.0).tolist() == expected


def test_without_a_delay_only_new_samples_are_told() -> None:
    time, depth = np.arange(4.0), seconds(-1.0, 1.0, 2.0, 1.5)
    assert not unforeseeable(time, depth, 0.0).any()
    assert unforeseeable(time, depth, 0.5).tolist() == [False, True, True, False]


def test_free_air_can_always_be_told() -> None:
    time, depth = np.arange(5.0), seconds(-5.0, -4.0, -3.0, 0.0, -1.0)
    assert not unforeseeable(time, depth, 1.0, changes=(2.0,))[:2].any()
    assert not unforeseeable(time, depth, 1.0).any()


def test_after_a_change_the_delay_and_a_tenth_of_a_second_cannot_be_told() -> None:
    time = np.arange(0.0, 3.0, 0.05)
    depth = np.where(time < 0.5, 1.0, 0.5)
    flags = unforeseeable(time, depth, 0.3, changes=(2.0,))
    assert time[flags & (time > 1.0)] == pytest.approx(np.arange(2.0, 2.39, 0.05))
    assert LEARNING_TIME == 0.1


def test_a_change_in_free_air_is_felt_at_the_next_touch() -> None:
    time = np.arange(0.0, 4.0, 0.1)
    depth = np.where((time < 1.95) | (time > 2.75), 1.0, -1.0)
    flags = unforeseeable(time, depth, 0.3, changes=(2.25,))
    assert time[flags & (time > 1.0)] == pytest.approx(np.arange(2.3, 3.15, 0.1))


def test_a_change_that_is_never_felt_hides_the_rest() -> None:
    time, depth = np.arange(6.0), seconds(1.0, 1.0, 1.0, -1.0, -1.0, -1.0)
    assert unforeseeable(time, depth, 0.0, changes=(3.0,)).tolist() == [False] * 3 + [True] * 3


def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(SettingError):
        unforeseeable(np.arange(3.0), np.zeros(3), -0.1)


def learning(*pieces: tuple[float, KelvinVoigt | None]) -> tuple[Recording, list[LearntModel]]:
    """Palpation of a spring whose surface is at 10 mm, and what was known from each time on."""
    time = np.arange(0.0, 6.0, 1e-3)
    depth = np.where(time < 1.0, -0.001, 0.005 + 0.002 * np.sin(8.0 * time))
    recording = Recording(time, depth + 0.01, np.zeros(time.size), velocity=np.zeros(time.size))
    known = [next(model for begin, model in reversed(pieces) if now >= begin) for now in time.tolist()]
    return recording, [LearntModel(model, 0.01, (), "") for model in known]


def test_convergence_is_counted_from_the_first_touch_and_from_each_change() -> None:
    wrong, near, stiff = KelvinVoigt(1300.0, 0.0), KelvinVoigt(1080.0, 0.0), KelvinVoigt(2000.0, 0.0)
    recording, learnt = learning((0.0, None), (1.1, wrong), (1.5, near), (4.2, stiff))
    depth = recording.position - 0.01
    force = np.maximum(depth, 0.0) * np.where(recording.time < 4.0, 1000.0, 2000.0)
    events = convergence(recording, Truth(depth, force, stiff, (4.0,)), learnt)
    assert [event.event_s for event in events] == pytest.approx([1.0, 4.0])
    assert [event.convergence_s for event in events] == pytest.approx([0.5, 0.2], abs=0.021)


def test_what_is_never_right_never_converges() -> None:
    recording, learnt = learning((0.0, KelvinVoigt(1300.0, 0.0)))
    depth = recording.position - 0.01
    events = convergence(recording, Truth(depth, np.maximum(1000.0 * depth, 0.0), SPRING), learnt)
    assert [event.convergence_s for event in events] == [None]


def test_a_change_that_is_not_felt_before_the_next_has_no_time_of_its_own() -> None:
    recording, learnt = learning((0.0, SPRING))
    depth = np.where(recording.time < 2.0, recording.position - 0.01, -1.0)
    depth = np.where(recording.time > 4.0, recording.position - 0.01, depth)
    events = convergence(recording, Truth(depth, np.maximum(1000.0 * depth, 0.0), SPRING, (2.5, 3.5)), learnt)
    assert [event.event_s for event in events] == pytest.approx([1.0, 4.0], abs=1.1e-3)


def test_nothing_is_touched_and_nothing_converges() -> None:
    recording, learnt = learning((0.0, SPRING))
    assert convergence(recording, Truth(recording.position - 1.0, np.zeros(6000), SPRING), learnt) == ()


def test_strengths_are_compared_as_shares_and_exponents_as_they_are() -> None:
    truth = Truth(np.zeros(1), np.zeros(1), HuntCrossley(3000.0, 1500.0, 1.4))
    errors = parameter_errors(
        "continuous-switching",
        {"stiffness": 3300.0, "damping": None, "exponent": 1.3, "switching": 0.2, "ln_k": math.log(3000.0), "b1": 0.5},
        truth,
    )
    assert errors.keys() == {"stiffness", "damping", "exponent", "switching", "ln_k"}
    assert errors["stiffness"].error == pytest.approx(10.0)
    assert errors["damping"].error is None
    assert errors["damping"].true == 1500.0
    assert errors["exponent"].error == pytest.approx(-0.1)
    assert errors["switching"].error == pytest.approx(0.2)
    assert errors["ln_k"].error == pytest.approx(0.0)


def test_a_law_that_cannot_be_the_true_one_is_not_compared_by_its_numbers() -> None:
    truth = Truth(np.zeros(1), np.zeros(1), HuntCrossley(3000.0, 1500.0, 1.4))
    assert parameter_errors("kelvin-voigt", {"stiffness": 1.0, "damping": 1.0}, truth) == {}
    between = Truth(np.zeros(1), np.zeros(1), ContinuousSwitching(3000.0, 1500.0, 0.7, 0.5))
    assert parameter_errors("hunt-crossley", {"stiffness": 1.0}, between) == {}
    assert parameter_errors("continuous-switching", {"stiffness": 1.0}, Truth(np.zeros(1), np.zeros(1), None)) == {}


def test_the_slope_of_laws_of_different_form_can_be_compared() -> None:
    law = HuntCrossley(3000.0, 1500.0, 1.4)
    assert local_stiffness(law, 0.01) == pytest.approx(1.4 * 3000.0 * 0.01**0.4, rel=1e-5)
    same = LinearisedContinuousSwitching(math.log(3000.0), 1.4, 0.5, 0.0)
    assert local_stiffness(same, 0.01) == pytest.approx(local_stiffness(law, 0.01), rel=1e-6)

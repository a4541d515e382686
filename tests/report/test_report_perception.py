"""Jumps by new models and the time to accuracy, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from report_sessions import make_session

from foretouch.identification import Learner, LearntModel, make_estimator
from foretouch.messages import SessionLog
from foretouch.models import HuntCrossley
from foretouch.quantities import Recording
from foretouch.rendering import ForceLimiter
from foretouch.report import (
    LargestJump,
    forces_under_delay,
    largest_jump,
    render_text,
    rendered_jump,
    score_prediction,
    session_figures,
    time_to_accuracy,
)

QUICK = settings(derandomize=True, deadline=None, max_examples=10)
PERIOD = 0.001


class Told(Learner):
    """A learner that says one law before a time and another from it on."""

    def __init__(self, first: HuntCrossley, second: HuntCrossley, at: float) -> None:
        super().__init__(make_estimator("kelvin-voigt", "rls"))
        self.laws, self.at = (first, second), at

    def learnt(self) -> LearntModel:
        return LearntModel(self.laws[self.sample.time >= self.at], 0.0, (), "told")


@QUICK
@given(factor=st.floats(0.1, 3.0), at=st.floats(0.2, 1.6), delay=st.sampled_from([0.0, 0.1, 0.3]))
def test_two_laws_switched_at_a_known_sample(factor: float, at: float, delay: float) -> None:
    """The jump is the difference of both laws at the sample at which the second one arrives."""
    time = np.arange(2000) * PERIOD
    depth = 0.01 + 0.002 * np.sin(20.0 * time)
    velocity = 0.04 * np.cos(20.0 * time)
    first, second = HuntCrossley(3000.0, 1500.0, 1.4), HuntCrossley(3000.0 * factor, 500.0, 1.4)
    recording = Recording(time, depth, first.force(depth, velocity), velocity=velocity)
    forces = forces_under_delay(recording, Told(first, second, at), delay)
    switch = int(np.searchsorted(time, time[np.searchsorted(time, at)] + delay - 1e-7))
    start = max(1, int(np.searchsorted(time, delay - 1e-7)))
    expected = np.zeros(time.size)
    expected[start] = first.force(depth[start], velocity[start])
    expected[switch] = second.force(depth[switch], velocity[switch]) - first.force(depth[switch], velocity[switch])
    np.testing.assert_allclose(forces.jump, expected, rtol=1e-9, atol=1e-12)
    scores = score_prediction(time, forces.measured, forces.predicted, forces.delayed, contact_floor=0.05, offset=0.0)
    figures = forces.perception(scores)
    where = int(np.abs(expected).argmax())
    assert figures["largest_update_jump_N"] == pytest.approx(abs(expected[where]))
    assert figures["largest_update_jump_N_per_s"] == pytest.approx(abs(expected[where]) / PERIOD)
    assert figures["largest_update_jump_at_s"] == pytest.approx(time[where])


def test_size_and_rate_may_be_of_different_jumps() -> None:
    time = np.array([5.0, 5.1, 5.2, 5.201, 5.3])
    period = np.concatenate(([np.nan], np.diff(time)))
    result = largest_jump(time, np.array([0.0, 0.0, -2.0, 0.5, 0.0]), period)
    assert result == pytest.approx((2.0, 500.0, 0.2))
    assert result.figures("x") == {"x_N": result.force, "x_N_per_s": result.rate, "x_at_s": result.time}


def test_where_there_is_no_jump() -> None:
    clock = np.arange(3.0)
    assert largest_jump(clock, np.zeros(3), np.ones(3)) == LargestJump(0.0, 0.0, None)
    assert largest_jump(np.zeros(0), np.zeros(0), np.zeros(0)) == LargestJump(None, None, None)
    assert largest_jump(clock, np.full(3, np.nan), np.ones(3)) == LargestJump(None, None, None)
    assert largest_jump(clock, np.array([np.nan, -1.0, 0.0]), np.full(3, np.nan)) == LargestJump(1.0, None, 1.0)


@QUICK
@given(
    jumps=st.lists(st.tuples(st.integers(1, 199), st.floats(-3.0, 3.0)), max_size=8),
    wave=st.floats(0.0, 2.0),
    largest_force=st.sampled_from([1.5, 1e6]),
    largest_rate=st.sampled_from([50.0, 1e9]),
)
def test_the_rendered_part_of_a_jump(
    jumps: list[tuple[int, float]], wave: float, largest_force: float, largest_rate: float
) -> None:
    """Never more than the jump, never against it; all of it where nothing cuts."""
    tick = np.arange(200)
    jump = np.zeros(200)
    for where, size in jumps:
        jump[where] = size
    moved = (1.0 if largest_force < 2.0 else 30.0) + wave * np.sin(0.1 * tick)  # by the hand
    predicted = moved + np.cumsum(jump)
    limiter = ForceLimiter(largest_force, largest_rate)
    rendered = np.array([limiter.update(max(force, 0.0), PERIOD) for force in predicted])
    part = rendered_jump(tick, predicted, rendered, jump)
    assert (part * jump >= 0.0).all()
    assert (np.abs(part) <= np.abs(jump)).all()
    if largest_force > 2.0 and largest_rate > 1e6:
        np.testing.assert_allclose(part, jump, atol=1e-9)
    if largest_rate < 1e6:
        assert (np.abs(part) <= largest_rate * PERIOD + np.abs(np.diff(moved, prepend=moved[0])) + 1e-9).all()


def test_a_step_through_the_rate_limit_counts_its_first_tick() -> None:
    jump = np.array([0.0, 0.0, 5.0, 0.0, 0.0])
    predicted = np.array([1.0, 1.0, 6.0, 6.0, 6.0])
    rendered = np.array([1.0, 1.0, 1.2, 1.4, 1.6])
    np.testing.assert_allclose(rendered_jump(np.arange(5), predicted, rendered, jump), [0, 0, 0.2, 0, 0], atol=1e-12)
    held = np.array([1.0, 1.0, 1.0, 1.0, 1.0])  # a clamp that lets nothing through
    assert not rendered_jump(np.arange(5), predicted, held, jump).any()


def test_after_a_missing_tick_the_rendered_part_is_unknown() -> None:
    jump, predicted = np.array([1.0, 2.0, 3.0]), np.array([1.0, 3.0, 6.0])
    part = rendered_jump(np.array([4, 6, 7]), predicted, predicted, jump)
    np.testing.assert_array_equal(part, [np.nan, np.nan, 3.0])


def presses(duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half a second of contact in each second, from 0.25 s on: time, force, contact."""
    time = 40.0 + np.arange(round(duration / PERIOD)) * PERIOD
    touching = np.abs((time % 1.0) - 0.5) < 0.25 - 1e-9
    return time, np.where(touching, 2.0, 0.0), touching


@QUICK
@given(switch=st.floats(0.0, 5.0), error=st.floats(0.101, 1e4), rest=st.floats(0.0, 0.099))
def test_time_to_accuracy_is_that_of_the_switch(switch: float, error: float, rest: float) -> None:
    """Wrong by one share before a moment, by a smaller one after it."""
    time, force, touching = presses(8.0)
    wrong = np.where(time - 40.0 < switch, error, rest)
    result = time_to_accuracy(time, force, (1.0 + wrong) * force, touching)
    contact = np.flatnonzero(touching)
    squares = np.minimum(wrong[contact], 1e3) ** 2
    means = np.lib.stride_tricks.sliding_window_view(squares, 500).mean(axis=1)
    first = int(np.argmax(means <= 0.01 * (1.0 + 1e-9)))
    assert result == pytest.approx(time[contact[first]] - time[contact[0]], abs=1.5 * PERIOD)
    assert result <= max(0.0, switch - 0.25) + 0.5 + PERIOD


def test_accuracy_that_does_not_last_does_not_count() -> None:
    time, force, touching = presses(4.0)
    crossing = np.where((time - 40.0) % 1.0 < 0.7, force, 1.5 * force)  # wrong in a tenth of each press
    assert time_to_accuracy(time, force, crossing, touching) is None
    assert time_to_accuracy(time, force, crossing, touching, lasting=0.3) == 0.0
    assert time_to_accuracy(time, force, 1.05 * force, touching) == 0.0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_one_absurd_sample_spoils_its_window_and_no_other(bad: float) -> None:
    time, force, touching = presses(4.0)
    predicted = 1.05 * force
    predicted[400] = bad
    result = time_to_accuracy(time, force, predicted, touching)
    assert result == pytest.approx(time[401] - time[touching][0])


def test_too_little_contact_is_never_accurate() -> None:
    time, force, touching = presses(1.0)
    touching[600:] = False
    assert time_to_accuracy(time, force, force, touching) is None
    assert time_to_accuracy(time, force, force, np.zeros(time.size, dtype=np.bool_)) is None
    assert time_to_accuracy(time[:1], force[:1], force[:1], touching[:1]) is None


def test_a_session_whose_first_model_comes_in_free_air() -> None:
    log = make_session()
    report = session_figures(log)
    assert report["largest_update_jump_N"] == pytest.approx(np.abs(log.leader["model_jump"]).max())
    assert 0.0 < report["time_to_ten_percent_s"] < 0.5  # the models arrive 0.32 s after the start
    assert "within 10 % over half a second of contact" in render_text(report)


def switching_session(limit: float = 1e9) -> SessionLog:
    """Models twice too stiff in the first half: one jump by half of what was predicted."""
    log = make_session(4.0, limit=limit)
    leader = log.leader.copy()
    came = np.flatnonzero(np.diff(leader["model_sequence"]) > 0) + 1
    half = int(came[(leader["predicted_force"][came] > 3.0) & (came > 2000)][0])
    leader["predicted_force"][:half] *= 2.0
    leader["rendered_force"][:] = np.minimum(leader["predicted_force"], limit)
    leader["model_jump"][:] = 0.0
    leader["model_jump"][half] = -leader["predicted_force"][half]
    return replace(log, leader=leader)


def test_a_session_whose_model_is_halved() -> None:
    log = switching_session()
    where = int(np.flatnonzero(log.leader["model_jump"])[0])
    size = float(log.leader["predicted_force"][where])
    assert size > 0.5
    report = session_figures(log)
    assert report["largest_update_jump_N"] == pytest.approx(size)
    assert report["largest_update_jump_N_per_s"] == pytest.approx(1e3 * size)
    assert report["largest_update_jump_at_s"] == pytest.approx(1e-3 * where)
    assert report["largest_rendered_update_jump_N"] == pytest.approx(size)
    assert report["time_to_ten_percent_s"] > 1.0
    held = session_figures(switching_session(limit=0.5 * size))
    assert held["largest_rendered_update_jump_N"] < 0.2 * size


def test_a_model_that_is_wrong_throughout_is_never_accurate() -> None:
    report = session_figures(make_session(stiffness=1.2))
    assert report["time_to_ten_percent_s"] is None
    assert "never" in render_text(report)


def test_a_session_without_models_has_no_jump() -> None:
    report = session_figures(make_session(2.5, models=False))
    assert report["largest_update_jump_N"] == report["largest_rendered_update_jump_N"] == 0.0
    assert report["largest_update_jump_at_s"] is None
    assert "moved the force by at most 0.00 N (0.00 N/s)\n" in render_text(report)

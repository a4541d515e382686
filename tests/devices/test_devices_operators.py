"""What each operator promises beyond the conformance suite."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.devices import BrowserOperator, RecordedOperator, ScriptedOperator
from foretouch.devices.device import minimum_jerk, quintic_move
from foretouch.errors import SettingError
from foretouch.recordings import DATASETS, read_leader_motion

TICK = 1_000_000
quick = settings(derandomize=True, deadline=None, max_examples=25)


def run(device, seconds, start=0):
    return np.array([device.read(start + i * TICK) for i in range(int(seconds * 1000))])


# --- moves ------------------------------------------------------------------------------------------------------------


def test_minimum_jerk_is_the_quintic_between_two_rests():
    rest_to_rest = quintic_move((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.0)
    for t in np.linspace(0.0, 2.0, 21):
        assert rest_to_rest(t) == pytest.approx(minimum_jerk(t / 2.0), abs=1e-12)


@quick
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.floats(0.2, 2.0))
def test_quintic_meets_both_ends(ends, duration):
    move = quintic_move(ends[:3], ends[3:], duration)
    for at, (x, v, a) in ((0.0, ends[:3]), (duration, ends[3:])):
        position = np.polynomial.Polynomial(move)
        assert position(at) == pytest.approx(x, abs=1e-9)
        assert position.deriv()(at) == pytest.approx(v, abs=1e-8)
        assert position.deriv(2)(at) == pytest.approx(a, abs=1e-7)


# --- scripted ---------------------------------------------------------------------------------------------------------


@quick
@given(st.floats(0.004, 0.03), st.floats(0.003, 0.03), st.integers(0, 2**31))
def test_script_touches_in_time_slowly_and_leaves_between_presses(surface, press_depth, seed):
    position = run(ScriptedOperator(surface, press_depth, seed), 20.0)
    inside = position > surface
    first = int(np.argmax(inside))
    assert 1.0 < first * 1e-3 < 1.5
    assert np.abs(np.diff(position)).max() / 1e-3 < 0.06
    assert surface + 0.25 * press_depth < position.max() <= surface + press_depth
    starts = np.flatnonzero(np.diff(inside.astype(int)) == 1)
    for begin, end in pairwise(starts):
        assert surface - 0.0045 < position[begin:end].min() < surface - 0.0015


def test_script_varies_its_presses_and_follows_its_seed():
    position = run(ScriptedOperator(0.01, 0.01, seed=1), 60.0)
    inside = np.concatenate([[0], (position > 0.01).astype(int), [0]])
    begins, ends = np.flatnonzero(np.diff(inside) == 1), np.flatnonzero(np.diff(inside) == -1)
    depths = np.array([position[b:e].max() - 0.01 for b, e in zip(begins, ends, strict=True)])
    assert len(depths) > 15
    assert np.ptp(depths) > 0.005
    assert not np.array_equal(position, run(ScriptedOperator(0.01, 0.01, seed=2), 60.0))


def test_script_has_a_continuous_acceleration():
    position = run(ScriptedOperator(0.01, 0.01, seed=4), 30.0)
    acceleration = np.diff(position, 2) / 1e-6
    # The jerk of a move of 10 mm in 0.25 s is below 60 D / T^3 = 40 m/s^3, so 1 ms changes the acceleration by little.
    assert np.abs(np.diff(acceleration)).max() < 0.06


@pytest.mark.parametrize(
    ("surface", "press_depth", "seed"),
    [(0.0, 0.01, 0), (math.nan, 0.01, 0), (0.01, 0.0, 0), (0.01, 1.0, 0), (0.01, 0.01, -1)],
)
def test_script_refuses_what_makes_no_sense(surface, press_depth, seed):
    with pytest.raises(SettingError):
        ScriptedOperator(surface, press_depth, seed)


# --- recorded ---------------------------------------------------------------------------------------------------------


def hand(seconds=4.0, rate=2000):
    t = np.arange(0.0, seconds, 1.0 / rate)
    return t, 0.004 * np.sin(2 * np.pi * 1.3 * t + 0.5) + 0.001 * np.sin(2 * np.pi * 0.37 * t)


def test_recording_is_offset_and_scaled_to_the_material():
    position = run(RecordedOperator(*hand(), surface=0.02, press_depth=0.007), 30.0)
    assert position.max() == pytest.approx(0.027, abs=1e-5)
    assert position[1600:].min() == pytest.approx(0.017, abs=1e-5)


def test_recording_repeats_without_a_seam():
    operator = RecordedOperator(*hand(), surface=0.02, press_depth=0.007)
    position = run(operator, 20.0)
    loop = round(operator.period * 1000)
    assert 4000 < loop < 5000
    assert np.allclose(position[3000 : 3000 + loop], position[3000 + loop : 3000 + 2 * loop], rtol=0, atol=1e-12)
    assert np.abs(np.diff(position, 2)).max() / 1e-6 < 3.0


def test_recording_is_followed_in_between():
    t, x = hand()
    operator = RecordedOperator(t, x, surface=0.02, press_depth=0.007)
    position = run(operator, 15.0)[2000:]
    # Somewhere in the played motion is the whole recording, but for scale, offset, and what the smoothing takes.
    want = np.interp(np.arange(0.05, 3.9, 0.001), t, x)
    best = max(
        np.corrcoef(want, position[lag : lag + len(want)])[0, 1] for lag in range(0, round(operator.period * 1000), 2)
    )
    assert best > 0.9999


def test_steps_of_an_encoder_are_gone():
    t, x = hand()
    coarse = RecordedOperator(t, np.round(x / 2e-5) * 2e-5, surface=0.02, press_depth=0.007)
    fine = RecordedOperator(t, x, surface=0.02, press_depth=0.007)
    a, b = run(coarse, 10.0), run(fine, 10.0)
    # Single steps of 20 um in 1 ms would be 20 mm/s.
    assert np.abs(np.diff(a[1600:5000])).max() < 1.05 * np.abs(np.diff(b[1600:5000])).max()


@pytest.mark.parametrize(
    ("time", "position"),
    [
        (np.arange(10.0), np.zeros(10)),
        (np.arange(10.0), np.arange(9.0)),
        (np.arange(10.0)[::-1], np.arange(10.0)),
        (np.arange(10.0), np.where(np.arange(10) == 3, np.nan, np.arange(10.0))),
        (np.linspace(0.0, 0.1, 10), np.arange(10.0)),
        (np.zeros((2, 2)), np.zeros((2, 2))),
    ],
)
def test_recording_refuses_what_makes_no_sense(time, position):
    with pytest.raises(SettingError):
        RecordedOperator(time, position, surface=0.02, press_depth=0.007)


@pytest.mark.parametrize("name", [name for name in DATASETS if name.startswith("tue/")])
def test_every_measured_leader_lever_can_press(measured, name):
    time, lever = read_leader_motion(measured(name))
    position = run(RecordedOperator(time, lever, surface=0.012, press_depth=0.009), 30.0)
    assert 0.0205 < position.max() <= 0.021001
    assert np.abs(np.diff(position)).max() / 1e-3 < 0.3
    assert np.abs(np.diff(position, 2)).max() / 1e-6 < 30.0
    assert not (position[:1000] > 0.012).any()


# --- browser ----------------------------------------------------------------------------------------------------------


def browser():
    return BrowserOperator(ScriptedOperator(0.012, 0.009, seed=3), deepest=0.04)


def drag(operator, start, seconds, path, rate, held=True, jitter=0.0, seed=0):
    """Positions read at 1 kHz while `path(t)` arrives as handle messages at about `rate` a second."""
    random = np.random.default_rng(seed)
    due, positions = 0.0, []
    for i in range(int(seconds * 1000)):
        if i * 1e-3 >= due:
            operator.take(path(i * 1e-3), held, start + i * TICK)
            due += (1.0 + jitter * random.uniform(-1.0, 1.0)) / rate
        positions.append(operator.read(start + i * TICK))
    return np.array(positions)


def test_nobody_at_the_mouse_is_the_script():
    assert np.array_equal(run(browser(), 10.0), run(ScriptedOperator(0.012, 0.009, seed=3), 10.0))


@pytest.mark.parametrize("rate", [10, 20, 60])
def test_held_hand_follows_a_moving_handle_within_its_lag(rate):
    operator = browser()
    begin = run(operator, 5.0)[-1]
    speed = 0.02
    got = drag(operator, 5_000_000_000, 1.0, lambda t: begin + speed * t, rate, jitter=0.3)
    lag = (begin + speed * np.arange(1000) * 1e-3 - got)[400:] / speed
    newest = 1.3 / rate  # what nobody can know: the handle since its newest message
    assert lag.mean() < 0.06 + 0.5 / rate
    assert lag.max() < 0.07 + 1.5 * newest
    assert np.diff(got)[300:].min() >= -1e-9


def test_hand_does_not_overshoot_where_the_handle_stops():
    operator = browser()
    run(operator, 5.0)
    got = drag(operator, 5_000_000_000, 2.0, lambda t: 0.01 + min(t, 0.5) * 0.03, 20)
    assert got[600:].max() <= 0.025 + 1e-9
    assert got[-1] == pytest.approx(0.025, abs=1e-6)


@quick
@given(
    st.lists(
        st.tuples(st.integers(1, 400), st.floats(-1.0, 1.0) | st.just(math.nan) | st.just(math.inf), st.booleans()),
        max_size=30,
    )
)
def test_whatever_the_browser_says_the_hand_moves_smoothly_and_in_range(messages):
    operator = browser()
    now, got = 0, [operator.read(0)]
    for wait, position, held in messages:
        for _ in range(wait):
            now += TICK
            got.append(operator.read(now))
        operator.take(position, held, now)
    got.extend(operator.read(now + i * TICK) for i in range(1, 6000))
    got = np.array(got)
    assert np.isfinite(got).all()
    assert got.min() >= -1e-3
    assert got.max() <= 0.041
    assert np.abs(np.diff(got)).max() / 1e-3 < 0.3
    assert np.abs(np.diff(got, 2)).max() / 1e-6 < 30.0


def test_let_go_it_stays_for_three_seconds_and_eases_back():
    operator, script = browser(), ScriptedOperator(0.012, 0.009, seed=3)
    run(operator, 5.0)
    drag(operator, 5_000_000_000, 1.0, lambda t: 0.015, 20)
    assert operator.held
    operator.take(0.015, False, 6_000_000_000)
    assert not operator.held
    after = run(operator, 6.0, 6_000_000_000)
    assert after[:3000] == pytest.approx(np.full(3000, 0.015), abs=1e-6)
    assert np.abs(np.diff(after)).max() / 1e-3 < 0.2
    whole = run(script, 12.0)
    assert after[-1000:] == pytest.approx(whole[11000:12000], abs=1e-12)


def test_a_browser_that_falls_silent_lets_go():
    operator = browser()
    run(operator, 5.0)
    operator.take(0.015, True, 5_000_000_000)
    run(operator, 0.9, 5_000_000_000)
    assert operator.held
    run(operator, 0.2, 5_900_000_000)
    assert not operator.held


def test_a_release_out_of_nothing_changes_nothing():
    operator = browser()
    run(operator, 3.0)
    operator.take(0.03, False, 3_000_000_000)
    assert np.array_equal(run(operator, 2.0, 3_000_000_000), run(ScriptedOperator(0.012, 0.009, seed=3), 5.0)[3000:])


def test_browser_refuses_a_range_that_makes_no_sense():
    with pytest.raises(SettingError):
        BrowserOperator(ScriptedOperator(0.012, 0.009), deepest=0.0)

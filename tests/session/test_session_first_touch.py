"""Guarded contact: what the robot does where it touches what the leader does not know yet."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.session.safety.force_guard import FirstTouch

TICK = 1e-3
SPEED, FORCE = 0.02, 2.0
SURFACE = 0.004
LAG = 3
"""Ticks by which the sensor is late."""
DRIVE = 2e-3
"""Time constant of the robot [s]."""
springs = st.floats(2.0, 5.0).map(lambda exponent: 10.0**exponent)


def touch(stiffness, desired, known=lambda tick: math.nan, surface=SURFACE, ticks=3000, guard=None):
    """A robot that follows as a first-order lag presses a spring; what it was told, where it was, and the forces."""
    guard = FirstTouch(SPEED, FORCE, TICK) if guard is None else guard
    position, forces, places, told = 0.0, [0.0] * LAG, [], []
    for tick in range(ticks):
        felt = forces[-LAG]
        told.append(guard.update(desired(tick), position, felt, felt > 0.02, known(tick)))
        position += (told[-1] - position) * -math.expm1(-TICK / DRIVE)
        places.append(position)
        forces.append(stiffness * max(position - surface, 0.0))
    return np.array(told), np.array(places), np.array(forces[LAG:])


@settings(derandomize=True, deadline=None, max_examples=20)
@given(springs, st.floats(0.05, 0.5))
def test_an_unknown_surface_is_approached_slowly_and_held_at_two_newtons(stiffness, speed):
    told, places, forces = touch(stiffness, lambda tick: min(speed * tick * TICK, 0.08), ticks=4000)
    assert np.diff(told).max() <= SPEED * TICK * (1.0 + 1e-9)
    # What is told and felt late carries it on at the speed of the approach: K v (lag + drive).
    late = (LAG + 1) * TICK + DRIVE
    assert forces.max() <= FORCE + stiffness * SPEED * late
    if stiffness * (0.08 - SURFACE) > FORCE:
        assert forces[-500:] == pytest.approx(FORCE, rel=0.02)
        # No chatter: at the end nothing moves.
        assert np.ptp(places[-500:]) < max(2e-6, 0.02 * FORCE / stiffness)
    assert (told <= [min(speed * tick * TICK, 0.08) + 1e-12 for tick in range(4000)]).all()


@pytest.mark.parametrize("stiffness", [300.0, 1e4, 1e5])
def test_it_comes_to_the_held_force_and_does_not_swing(stiffness):
    _, places, forces = touch(stiffness, lambda tick: 0.05)
    contact = np.flatnonzero(forces > 0.0)[0]
    assert (forces[contact + 1 :] > 0.0).all()  # it never leaves again
    turns = np.diff(np.sign(np.diff(places[contact:])[np.abs(np.diff(places[contact:])) > 1e-9]))
    assert np.count_nonzero(turns) <= 2  # over the held force and back, and no more


def test_it_follows_outwards_at_once():
    told, _, forces = touch(2000.0, lambda tick: 0.05 if tick < 1500 else 0.0)
    assert told[1499] > SURFACE
    assert (told[1500:] == 0.0).all()
    assert forces[1530:].max() == 0.0


@pytest.mark.parametrize("stiffness", [600.0, 1e4, 1e5])
def test_once_the_surface_is_known_the_way_back_is_slow_and_without_a_step(stiffness):
    guard = FirstTouch(SPEED, FORCE, TICK)
    told, _, _ = touch(stiffness, lambda tick: 0.009, lambda tick: math.nan if tick < 1500 else SURFACE, guard=guard)
    steps = np.diff(told)
    assert np.abs(steps).max() <= SPEED * TICK * (1.0 + 1e-9)
    assert told[1499] < 0.009
    assert told[-1] == pytest.approx(0.009, abs=1e-12)
    back = (0.009 - told[1499]) / SPEED
    assert told[1500 + math.ceil(back / TICK) + 1] == pytest.approx(0.009, abs=1e-9)
    assert not guard.guarded


def test_while_it_comes_back_the_commands_motion_passes():
    """What is held back shrinks by the approach speed; the rest of the way is the hand's."""
    guard = FirstTouch(SPEED, FORCE, TICK)
    for _ in range(100):
        guard.update(0.01, 0.0, 0.0, False, math.nan)
    held = 0.01 - guard.update(0.01, 0.002, 0.0, False, 0.005)
    assert held == pytest.approx(0.008 - SPEED * TICK)
    assert guard.update(0.013, 0.002, 0.0, False, 0.005) == pytest.approx(0.013 - held + SPEED * TICK)
    assert guard.guarded


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.0, 100.0), st.booleans()), max_size=50)
)
def test_where_all_is_known_commands_pass_as_they_are(ticks):
    guard = FirstTouch(SPEED, FORCE, TICK)
    for desired, position, force, in_contact in ticks:
        position = max(position, 0.0)
        assert guard.update(desired, position, force, in_contact, 0.0) == desired
        assert not guard.guarded


def test_contact_with_something_else_further_out_is_guarded_too():
    """The leader knows a surface at 20 mm; something is at 4 mm."""
    told, _, forces = touch(5000.0, lambda tick: min(1e-5 * tick, 0.012), lambda tick: 0.020, ticks=4000)
    assert told[300] == pytest.approx(1e-5 * 300)  # up to there nothing is held back
    assert forces.max() < 3.5
    assert forces[-500:] == pytest.approx(FORCE, rel=0.02)
    # Within a millimetre of the surface it is that surface.
    told, _, _ = touch(5000.0, lambda tick: min(1e-5 * tick, 0.012), lambda tick: SURFACE + 0.9e-3, ticks=4000)
    assert told[-1] == 0.012


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    st.lists(
        st.tuples(
            st.floats(-0.05, 0.05),
            st.floats(-0.05, 0.05) | st.just(math.nan),
            st.floats(-5.0, 50.0) | st.sampled_from((math.nan, math.inf, -math.inf)),
            st.booleans(),
        ),
        max_size=60,
    )
)
def test_whatever_the_sensors_say_an_unknown_surface_is_never_approached_faster(ticks):
    guard, told = FirstTouch(SPEED, FORCE, TICK), None
    for desired, position, force, in_contact in ticks:
        now = guard.update(desired, position, force, in_contact, math.nan)
        assert math.isfinite(now)
        assert now <= desired
        if told is not None:
            assert now <= told + SPEED * TICK * (1.0 + 1e-9)
            if not math.isfinite(force):
                assert now <= told
        told = now


@pytest.mark.parametrize("numbers", [(0.0, 2.0, TICK), (0.02, -1.0, TICK), (0.02, 2.0, math.nan)])
def test_speed_force_and_period_must_be_positive(numbers):
    with pytest.raises(SettingError):
        FirstTouch(*numbers)


def test_commands_that_step_out_as_the_guard_ends_take_the_robot_along_slowly():
    """What the index makes of the commands when the leader has met the surface is no step of the robot's."""
    touch = FirstTouch(0.02, 2.0, 1e-3)
    told = [touch.update(0.02, 0.011, 1.0, True, math.nan) for _ in range(300)]
    told += [touch.update(0.0101, told[-1], 1.0, True, 0.0101) for _ in range(500)]
    assert np.abs(np.diff(told)).max() <= 0.02e-3 + 1e-12
    assert told[-1] == pytest.approx(0.0101)

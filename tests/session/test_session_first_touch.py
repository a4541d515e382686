"""Guards of the force: at a first touch, by what the own motion has proven, and in space."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.quantities.pose import Vector
from foretouch.session.safety import force_guard
from foretouch.session.safety.force_guard import AIMED, PATIENCE, STEEPER, ForceCap, guarded_position, observe_force
from foretouch.session.safety.proven_way import CELL, GROWTH, ProvenWay, forget_way, observe_way, proven_speed
from foretouch.session.safety.safety import SafetyLimits

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
    guard = force_guard.first_touch(SPEED, FORCE, TICK) if guard is None else guard
    position, forces, places, told = 0.0, [0.0] * LAG, [], []
    for tick in range(ticks):
        felt = forces[-LAG]
        told.append(guarded_position(guard, desired(tick), position, felt, felt > 0.02, known(tick)))
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
    guard = force_guard.first_touch(SPEED, FORCE, TICK)
    told, _, _ = touch(stiffness, lambda tick: 0.009, lambda tick: math.nan if tick < 1500 else SURFACE, guard=guard)
    steps = np.diff(told)
    assert np.abs(steps).max() <= SPEED * TICK * (1.0 + 1e-9)
    assert told[1499] < 0.009
    assert told[-1] == pytest.approx(0.009, abs=1e-12)
    back = (0.009 - told[1499]) / SPEED
    assert told[1500 + math.ceil(back / TICK) + 1] == pytest.approx(0.009, abs=1e-9)
    assert guard["held_back"] == 0.0


def test_while_it_comes_back_the_commands_motion_passes():
    """What is held back shrinks by the approach speed; the rest of the way is the hand's."""
    guard = force_guard.first_touch(SPEED, FORCE, TICK)
    for _ in range(100):
        guarded_position(guard, 0.01, 0.0, 0.0, False, math.nan)
    held = 0.01 - guarded_position(guard, 0.01, 0.002, 0.0, False, 0.005)
    assert held == pytest.approx(0.008 - SPEED * TICK)
    assert guarded_position(guard, 0.013, 0.002, 0.0, False, 0.005) == pytest.approx(0.013 - held + SPEED * TICK)
    assert guard["held_back"] != 0.0


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.0, 100.0), st.booleans()), max_size=50)
)
def test_where_all_is_known_commands_pass_as_they_are(ticks):
    guard = force_guard.first_touch(SPEED, FORCE, TICK)
    for desired, position, force, in_contact in ticks:
        position = max(position, 0.0)
        assert guarded_position(guard, desired, position, force, in_contact, 0.0) == desired
        assert guard["held_back"] == 0.0


def test_contact_with_something_else_further_out_is_guarded_too():
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
    guard, told = force_guard.first_touch(SPEED, FORCE, TICK), None
    for desired, position, force, in_contact in ticks:
        now = guarded_position(guard, desired, position, force, in_contact, math.nan)
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
        force_guard.first_touch(*numbers)


def test_commands_that_step_out_as_the_guard_ends_take_the_robot_along_slowly():
    """What the index makes of the commands when the leader has met the surface is no step of the robot's."""
    touch = force_guard.first_touch(0.02, 2.0, 1e-3)
    told = [guarded_position(touch, 0.02, 0.011, 1.0, True, math.nan) for _ in range(300)]
    told += [guarded_position(touch, 0.0101, told[-1], 1.0, True, 0.0101) for _ in range(500)]
    assert np.abs(np.diff(told)).max() <= 0.02e-3 + 1e-12
    assert told[-1] == pytest.approx(0.0101)


# --- what the own motion proves of the way in: no more than it has gone through, as fast as it went -------------------


def gone(way: ProvenWay, places: list[float], damping: float, stiffness: float = 0.0) -> None:
    """Go through places [m], feeling a spring and a damper from 0 on."""
    before = places[0]
    for place in places:
        speed, before = (place - before) / TICK, place
        observe_way(way, place, max(stiffness * place + damping * speed, 0.0) if place > 0.0 else 0.0, TICK)


def ramp(begin: float, end: float, speed: float) -> list[float]:
    count = max(round(abs(end - begin) / speed / TICK), 2)
    return np.linspace(begin, end, count).tolist()


@pytest.mark.parametrize("speed", [0.002, 0.02, 0.2])
def test_a_cell_that_was_crossed_may_be_crossed_at_what_the_damping_allows(speed: float) -> None:
    way = ProvenWay.new()[0]
    gone(way, ramp(-2e-3, 5e-3, speed), damping=100.0)
    assert proven_speed(way, 2.1e-3, 10.0) == pytest.approx(
        min(10.0 / 100.0, GROWTH * speed) if speed < 0.1 else speed, rel=0.1
    )
    assert proven_speed(way, 7e-3, 10.0) == 0.0, "it has not been there"
    assert proven_speed(way, -3e-3, 10.0) == 0.0


def test_what_comes_back_out_is_elastic_and_no_damping() -> None:
    """10 N at 2 mm, of which a spring makes 8: next time the speed may double what it makes."""
    allowed = []
    for comes_back in (False, True):
        way = ProvenWay.new()[0]
        gone(way, ramp(-2e-3, 4e-3, 0.02), damping=100.0, stiffness=4000.0)
        if comes_back:
            gone(way, ramp(4e-3, -1e-3, 0.002), damping=100.0, stiffness=4000.0)
        allowed.append(proven_speed(way, 2.1e-3, 13.0))
    assert allowed[1] > 1.2 * allowed[0] > 0.02
    force = 4000.0 * 2.25e-3 + 100.0 * allowed[1]
    assert force <= 13.0 + 0.5


@pytest.mark.parametrize("noise", [lambda n: 15e-6 * (n.random() < 0.5), lambda n: 5e-6 * n.standard_normal()])
def test_an_encoder_that_trembles_is_no_motion(noise: object) -> None:
    numbers, way = np.random.default_rng(1), ProvenWay.new()[0]
    for place in ramp(-5e-4, 1.5e-3, 3e-4):
        observe_way(way, place + noise(numbers), 0.3, TICK)  # type: ignore[operator]
    result = [proven_speed(way, place, 0.3) for place in np.arange(0.1e-3, 1.1e-3, CELL)]
    assert np.max(result) < 3e-4 * 1.2


def test_a_way_that_is_harder_than_was_proven_counts_from_then_on_and_one_that_is_softer_too() -> None:
    way = ProvenWay.new()[0]
    gone(way, ramp(-2e-3, 4e-3, 0.02), damping=10.0)
    quick = proven_speed(way, 2.1e-3, 10.0)
    gone(way, ramp(4e-3, -2e-3, 0.02) + ramp(-2e-3, 4e-3, 0.02), damping=400.0)
    assert proven_speed(way, 2.1e-3, 10.0) < 0.5 * quick
    gone(way, ramp(4e-3, -2e-3, 0.02) + ramp(-2e-3, 4e-3, 0.02), damping=10.0)
    assert proven_speed(way, 2.1e-3, 10.0) == pytest.approx(quick, rel=0.1)


def test_a_jump_is_no_motion_and_another_place_is_unknown() -> None:
    way = ProvenWay.new()[0]
    for tick in range(60):
        observe_way(way, -0.01 if tick < 30 else 0.01, 0.0, TICK)
    assert proven_speed(way, 0.0, 10.0) == 0.0
    gone(way, ramp(-2e-3, 4e-3, 0.02), damping=10.0)
    assert proven_speed(way, 2.1e-3, 10.0) > 0.02
    forget_way(way)
    assert proven_speed(way, 2.1e-3, 10.0) == 0.0
    for nonsense in (math.nan, 1e300, -math.inf):
        assert proven_speed(way, nonsense, 10.0) == 0.0


# --- the force on the probe in space ----------------------------------------------------------------------------------


CEILING, STIFFNESS, MOST_DAMPED = 15.0, 2000.0, SafetyLimits().most_damped
UP: Vector = (0.0, 0.0, 1.0)


def pressed(normal: Vector) -> ForceCap:
    cap: ForceCap = ForceCap.new(ceiling=CEILING, most_damped=MOST_DAMPED, speed=0.25, period=1e-3)[0]
    for tick in range(200):
        depth = 1e-5 * tick
        observe_force(cap, (0.0, 0.0, -depth), (0.0, 0.0, STIFFNESS * depth), normal)
    return cap


def test_the_cap_goes_as_a_guard_along_the_believed_normal_and_takes_what_that_does_not_explain_for_damped() -> None:
    missing = AIMED * CEILING - STIFFNESS * 199e-5
    assert pressed(UP).fastest == pytest.approx(missing / (STEEPER * STIFFNESS * PATIENCE), rel=0.3)
    assert 0.0 < pressed((1.0, 0.0, 0.0)).fastest <= missing / MOST_DAMPED

"""The account of energy against exact sums, and the ceiling."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.rendering import EnergyAccount

TICK = 1e-3


def press(force_of, positions, account):
    """Positions one after the other; the force asked for, held to the ceiling. Returns the forces."""
    forces = []
    for position in positions:
        account.observe(position)
        forces.append(min(force_of(position), account.ceiling))
        account.hold(forces[-1])
    return np.array(forces)


def test_energy_is_the_sum_of_the_held_forces_work():
    account, positions = EnergyAccount(), np.cumsum(np.abs(np.random.default_rng(0).normal(0.0, 1e-4, 200)))
    forces = press(lambda x: 3.0 + 100.0 * x, positions, account)
    assert account.energy == pytest.approx(np.sum(forces[:-1] * np.diff(positions)), rel=1e-12)
    # And that sum is, but for the held samples, the integral of 3 + 100 x.
    begin, end = positions[0], positions[-1]
    assert account.energy == pytest.approx(3.0 * (end - begin) + 50.0 * (end**2 - begin**2), rel=0.02)


@pytest.mark.parametrize("speed", [0.01, 0.1])
@pytest.mark.parametrize("stiffness", [200.0, 3000.0])
@pytest.mark.parametrize("ticks", [20, 57])
def test_a_spring_let_go_gives_back_a_tick_more_than_it_took_and_is_not_cut(speed, stiffness, ticks):
    step = speed * TICK
    way = np.concatenate((np.arange(ticks + 1), np.arange(ticks - 1, -1, -1))) * step
    account = EnergyAccount(0.0)
    forces = press(lambda x: stiffness * x, way, account)
    assert forces == pytest.approx(stiffness * way, rel=1e-12)
    # Going in each tick holds the force of its begin, K i s, going out K (i + 1) s: the difference is K s^2 a tick.
    assert account.energy == pytest.approx(-stiffness * (ticks * step) * step, rel=1e-9)
    assert account.largest_force == pytest.approx(stiffness * ticks * step, rel=1e-12)
    # F D, with D a tick and the smallest count.
    assert account.bound == pytest.approx(stiffness * ticks * step * (step + 1e-6), rel=1e-9)
    assert account.bound > -account.energy


def test_whoever_takes_more_than_that_meets_the_ceiling():
    """2 N on the way in, 3 N asked for on the way out: it holds until what was put in is gone, and ends."""
    step, count = 1e-4, 1e-5
    account = EnergyAccount(count)
    press(lambda x: 2.0, np.arange(101) * step, account)
    assert account.energy == pytest.approx(0.02)
    forces = press(lambda x: 3.0, np.arange(99, -1, -1) * step, account)
    assert (forces[:66] == 3.0).all()
    assert forces[-1] < 0.1
    # The first tick out still was the 2 N of before; (200 - 2) / 3 ticks of 3 N are paid.
    cut = int(np.argmax(forces < 3.0))
    assert cut == 66
    assert account.energy >= -account.bound * (1.0 + 1e-12)
    assert account.energy == pytest.approx(-3.0 * (step + 0.5 * count), rel=0.01)


motions = st.lists(st.tuples(st.floats(-1e-2, 1e-2) | st.floats(-5.0, 5.0), st.floats(0.0, 20.0)), max_size=80)


@given(motions, st.sampled_from((0.0, 1e-6, 1e-5, 1e-3)))
@example([(0.0, 1.0)] + [(-1.0, 1e9)] * 60, 1e-6)
def test_whatever_is_asked_for_the_account_stays_above_its_bound(motion, resolution):
    account = EnergyAccount(resolution)
    energy = largest_force = position = held = 0.0
    largest_step = max(resolution, 1e-6)
    account.observe(0.0)
    for way, asked in motion:
        energy += held * way
        if held > 0.0:
            largest_step = max(largest_step, abs(way) + max(resolution, 1e-6))
        position += way
        account.observe(position)
        assert energy >= -largest_force * largest_step * (1.0 + 1e-9) - 1e-12
        assert account.energy == pytest.approx(energy, rel=1e-6, abs=1e-9)
        held = min(asked, account.ceiling)
        assert held >= 0.0
        account.hold(held)
        largest_force = max(largest_force, held)


@given(motions)
def test_the_ceiling_lets_the_hand_be_given_what_it_gave(motion):
    """No force is cut while the hand has put in more than it got."""
    account = EnergyAccount()
    for way, force in motion:
        account.observe(way)
        if account.energy >= 0.0:
            assert account.ceiling == math.inf
        account.hold(min(force, account.ceiling))


def test_positions_that_are_no_numbers_are_left_out():
    account = EnergyAccount(1e-6)
    account.hold(2.0)
    for position in (math.nan, 0.0, math.inf, math.nan, -math.inf, 3e-3):
        account.observe(position)
    assert account.energy == pytest.approx(6e-3)
    assert account.largest_step == pytest.approx(3e-3 + 1e-6)


def test_a_contact_that_ends_pays_for_nothing_in_the_next():
    account = EnergyAccount(1e-5)
    press(lambda x: 5.0, (0.0, 0.01), account)
    assert account.energy == pytest.approx(0.05)
    account.close()
    assert account.energy == account.largest_force == account.bound == 0.0
    assert account.largest_step == 1e-5
    account.hold(0.0)
    account.observe(0.02)
    assert account.energy == 0.0


@pytest.mark.parametrize("resolution", [-1e-6, math.nan, math.inf])
def test_a_count_must_be_a_length(resolution):
    with pytest.raises(SettingError, match="resolution"):
        EnergyAccount(resolution)

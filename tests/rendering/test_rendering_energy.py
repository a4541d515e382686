"""The account of energy against exact sums, and the ceiling."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from renderer_runs import Books

from foretouch.devices import DeviceSpecification
from foretouch.devices.hand import HeldForce
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
    assert -3.0 * (step + count) <= account.energy <= -3.0 * (step + 0.5 * count)


motions = st.lists(
    st.tuples(
        st.floats(-2e-3, 2e-3) | st.floats(-5.0, 5.0),
        st.floats(0.0, 20.0),
        st.sampled_from((TICK,) * 6 + (0.05,)),
        st.integers(0, 9),
    ),
    max_size=80,
)
BACK_AND_FORTH = [(2e-3 * (-1) ** n, 1e9 * (n % 2), TICK, 9) for n in range(80)]


@given(
    motions, st.sampled_from((0.0, 1e-6, 1e-5, 1e-3)), st.sampled_from((0.0, 5e-4, TICK)), st.sampled_from((0.0, 0.02))
)
@example([(0.0, 1.0, TICK, 9)] + [(-1.0, 1e9, TICK, 9)] * 60, 1e-6, 0.0, 0.0)
@example(BACK_AND_FORTH, 1e-6, TICK, 0.0)
@example([(5e-4, 10.0, TICK, 9)] * 20 + [(-0.2, 10.0, 0.12, 9)] + BACK_AND_FORTH, 1e-5, 5e-4, 0.02)
@example([(5e-5, 5.0, TICK, 9)] * 9 + [(-1e-3, 5.0, TICK, 0), (-1e-3, 0.0, TICK, 9)], 1e-6, 5e-4, 0.0)
def test_over_a_whole_session_no_more_comes_out_than_one_bound_and_what_late_ticks_gave(
    session, resolution, delay, watchdog
):
    """Taps, late ticks, lost positions and contacts that end; while it has put in more than it got, nothing is cut."""
    account, position = EnergyAccount(resolution, delay=delay, watchdog=watchdog), 0.0
    books = Books(DeviceSpecification(damping=2.0, resolution=resolution, delay=delay, watchdog=watchdog))
    for way, asked, period, event in [(0.0, 0.0, TICK, 9), *session]:
        position += way
        seen = math.nan if event == 0 else position
        account.observe(seen, period)
        books.move((seen, 0.0, 0.0), period)
        books.check(account.energy, account.bound, account.late_energy)
        if event == 1:
            account.close()
        held = min(asked, account.ceiling)
        assert held >= 0.0
        assert held == asked or account.energy < 0.0 or event == 0
        account.hold(held)
        books.hold((-held, 0.0, 0.0))


def test_positions_lost_one_at_a_time_are_booked_as_the_force_acted():
    """A thousand times one position is lost while the hand leaves evenly and the force falls: nothing is left out."""
    account, device, now, whole = EnergyAccount(delay=5e-4), HeldForce(0.0, 5e-4, 0.0), 0, 0.0
    account.observe(0.0)
    position = 0.0
    for _ in range(1000):
        for way, asked, seen in ((4e-5, 5.0, True), (-1e-5, 5.0, False), (-1e-5, 0.0, True), (0.0, 0.0, True)):
            force = min(asked, account.ceiling)
            account.hold(force)
            device.render(force, now)
            whole += sum(lasted * acting for lasted, acting in device.over(now, now + 1_000_000)) * way / TICK
            now, position = now + 1_000_000, position + way
            account.observe(position if seen else math.nan, TICK)
    assert whole >= account.energy + account.late_energy - 1e-12
    assert account.late_energy < -1e-3


def test_the_bound_is_come_near_to():
    account, least = EnergyAccount(1e-6), 0.0
    press(lambda x: 2.0, np.arange(11) * 1e-4, account)
    for position in np.arange(9, -30, -1) * 1e-4:
        press(lambda x: 2.0, [position], account)
        least = min(least, account.energy / account.bound)
    assert -1.0 <= least < -0.95


def test_taps_do_not_add_up():
    """A model that is 1.6 times as stiff on the way out, 25 taps a second for a minute: one bound, not 1,500."""
    account, whole, held = EnergyAccount(1e-5), 0.0, 0.0
    places = 5e-4 * np.sin(2.0 * np.pi * 25.0 * np.arange(0.0, 60.0, TICK)) - 1e-4
    for before, place in itertools.pairwise(places):
        whole += held * (place - before)
        account.observe(place)
        asked = 1500.0 * max(place, 0.0) * (1.6 if place < before else 1.0)
        if asked == 0.0:
            account.close()
        held = min(asked, account.ceiling)
        account.hold(held)
    assert whole >= -account.bound
    assert account.bound < 1e-4


def test_a_debt_is_kept_over_contacts_and_paid_by_the_next_press():
    account = EnergyAccount(1e-6)
    press(lambda x: 2.0, np.arange(11) * 1e-4, account)
    press(lambda x: 3.0, np.arange(9, -6, -1) * 1e-4, account)
    debt = account.energy
    assert debt < 0.0
    account.close()
    assert account.energy == debt
    account.hold(0.0)
    press(lambda x: 1.0, np.arange(-4, 40) * 1e-4, account)
    assert account.energy > 0.0


def test_a_late_tick_is_told_and_widens_no_bound():
    """10 mm pressed with 5 N, and a tick that comes 120 ms late while the hand leaves at 0.25 m/s."""
    account = EnergyAccount(1e-5)
    press(lambda x: 500.0 * x, np.arange(0.0, 1.0001e-2, 5e-5), account)
    bound, put_in = account.bound, account.energy
    account.observe(-0.02, 0.12)
    assert account.bound <= 5.0 * (0.25e-3 + 1e-5) * 1.01
    assert account.bound >= bound
    assert account.energy == pytest.approx(put_in - 5.0 * 0.25e-3, rel=1e-6)
    assert account.late_energy == pytest.approx(-5.0 * (0.03 - 0.25e-3), rel=1e-3)


def test_a_watchdog_ends_what_a_late_tick_may_give():
    account = EnergyAccount(1e-5, watchdog=0.02)
    press(lambda x: 500.0 * x, np.arange(0.0, 1.0001e-2, 5e-5), account)
    account.observe(-0.02, 0.12)
    assert account.late_energy == pytest.approx(-5.0 * 0.25 * 0.019, rel=1e-3)


def test_with_a_delay_the_force_of_before_is_booked_until_the_new_one_acts():
    account = EnergyAccount(1e-6, delay=2.5e-4)
    account.observe(0.0)
    account.hold(4.0)
    account.observe(1e-4)
    assert account.energy == pytest.approx(0.75 * 4.0 * 1e-4)
    account.hold(2.0)
    account.observe(2e-4)
    assert account.energy == pytest.approx(0.75 * 4.0 * 1e-4 + (0.25 * 4.0 + 0.75 * 2.0) * 1e-4)


def test_positions_that_are_no_numbers_are_left_out():
    account = EnergyAccount(1e-6)
    account.hold(2.0)
    for position in (math.nan, 0.0, math.inf, math.nan, -math.inf, 3e-3):
        account.observe(position)
    assert account.energy == pytest.approx(2.0 * 0.75e-3)  # of one tick out of four; the rest is late, and a surplus
    assert account.late_energy == 0.0
    assert account.largest_step == pytest.approx(0.75e-3 + 1e-6)


def test_a_contact_that_ends_pays_for_nothing_in_the_next():
    account = EnergyAccount(1e-5)
    press(lambda x: 5.0, (0.0, 1e-3), account)
    assert account.energy == pytest.approx(5e-3)
    account.close()
    assert account.energy == 0.0
    assert account.bound == pytest.approx(5.0 * 1.01e-3)  # of the session
    account.hold(0.0)
    account.observe(0.02)
    assert account.energy == 0.0


@pytest.mark.parametrize("resolution", [-1e-6, math.nan, math.inf])
def test_a_count_must_be_a_length(resolution):
    with pytest.raises(SettingError, match="resolution"):
        EnergyAccount(resolution)

"""The account of energy in three dimensions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.devices.held_force import HeldForce
from foretouch.errors import SettingError
from foretouch.rendering import EnergyAccount, SpatialEnergyAccount
from foretouch.report.booked import BookedDevice, book

small = st.floats(-1e-3, 1e-3)
force = st.floats(-10.0, 10.0)
tick = st.tuples(st.tuples(small, small, small), st.tuples(force, force, force))


@given(st.lists(tick, min_size=1, max_size=60))
def test_whatever_is_asked_for_no_more_comes_out_than_the_bound(ticks: list) -> None:
    account = SpatialEnergyAccount(1e-5)
    place, given_out, held = np.zeros(3), 0.0, np.zeros(3)
    for step, wanted in ticks:
        place = place + step
        given_out += float(held @ np.array(step)) if account.force != (0.0, 0.0, 0.0) else 0.0
        account.observe(tuple(place))
        assert account.energy == pytest.approx(-given_out, abs=1e-12)  # the work itself
        assert account.energy >= -account.bound - 1e-12
        held = np.array(account.hold(wanted))


lost = st.tuples(st.tuples(small, small, small), force, st.sampled_from((1e-3, 0.05)), st.booleans())


@given(st.lists(lost, max_size=60), st.sampled_from((0.0, 5e-4, 1e-3)), st.sampled_from((0.0, 0.02)))
def test_what_is_booked_is_what_the_device_did_where_positions_are_missing(
    ticks: list, delay: float, watchdog: float
) -> None:
    account, device = (
        SpatialEnergyAccount(1e-5, delay=delay, watchdog=watchdog),
        HeldForce(np.zeros(3), delay, watchdog),
    )
    place, known, impulse, now, elapsed, whole = np.zeros(3), np.zeros(3), np.zeros(3), 0, 0.0, 0.0
    account.observe((0.0, 0.0, 0.0))
    places, forces, periods = [np.zeros(3)], [], [0.0]
    for step, wanted, period, missing in ticks:
        forces.append(np.array(account.hold((wanted, -wanted, 0.5 * wanted))))
        device.render(forces[-1], now)
        ends = now + round(period * 1e9)
        impulse = impulse + sum(lasted * acting for lasted, acting in device.over(now, ends))
        now, place, elapsed = ends, place + step, elapsed + period
        places.append(np.full(3, math.nan) if missing else place)
        periods.append(period)
        account.observe(tuple(places[-1]), period)
        if not missing:
            whole -= float(impulse @ (place - known)) / elapsed
            known, impulse, elapsed = place, np.zeros(3), 0.0
        assert whole >= account.energy + account.late_energy - 1e-9
    forces.append(np.zeros(3))
    booked = book(np.array(forces), np.array(places), np.array(periods), BookedDevice(1e-5, delay, watchdog))
    assert booked.work.sum() + booked.late.sum() == pytest.approx(whole, abs=1e-9)
    assert booked.work.sum() == pytest.approx(account.energy, abs=1e-9)


def test_on_a_straight_line_it_is_the_account_along_it() -> None:
    whole, line = SpatialEnergyAccount(0.0), EnergyAccount(0.0)
    depth = 3e-3 * np.sin(np.linspace(0.0, 3.0, 200))
    for x in depth:
        whole.observe((0.0, 0.0, -x))
        line.observe(x)
        assert whole.energy == pytest.approx(line.energy, abs=1e-15)
        pressed = 500.0 * max(x, 0.0)
        whole.hold((0.0, 0.0, pressed))
        line.hold(pressed)


def test_a_force_that_turns_late_in_a_hollow_is_cut() -> None:
    """Round and round in a hollow of 5 mm: a held normal force gives out a little in every tick, for ever."""
    radius, account, least = 5e-3, SpatialEnergyAccount(1e-5), 0.0
    cut = 0
    for number in range(4000):
        a = 0.06 * number
        place = (radius * math.cos(a), radius * math.sin(a), 0.0)
        account.observe(place)
        least = min(least, account.energy + account.bound)
        account.hold((-2.0 * math.cos(a), -2.0 * math.sin(a), 0.0))
        cut += account.cut
    assert least >= -1e-12
    assert cut > 100


@pytest.mark.parametrize("wrong", [(math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0)])
def test_what_is_no_number_is_no_force_and_no_motion(wrong: tuple) -> None:
    account = SpatialEnergyAccount(0.0)
    account.observe((0.0, 0.0, 0.0))
    assert account.hold(wrong) == (0.0, 0.0, 0.0)
    account.hold((0.0, 0.0, 1.0))
    account.observe(wrong)
    assert account.energy == 0.0


def test_contact_lost_closes_it() -> None:
    account = SpatialEnergyAccount(0.0)
    account.observe((0.0, 0.0, 0.0))
    account.hold((0.0, 0.0, 1.0))
    account.observe((0.0, 0.0, -1e-3))
    assert account.energy == pytest.approx(1e-3)
    account.close()
    assert account.energy == 0.0
    assert account.largest_force == 1.0


def test_a_count_below_zero_is_refused() -> None:
    with pytest.raises(SettingError, match="resolution"):
        SpatialEnergyAccount(-1.0)

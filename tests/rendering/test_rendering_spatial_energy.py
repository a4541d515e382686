"""The account of energy in three dimensions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from renderer_runs import Books

from foretouch.devices import DeviceSpecification
from foretouch.devices.hand import HeldForce
from foretouch.rendering import SpatialEnergyAccount
from foretouch.report.energy import BookedDevice, book

small = st.floats(-1e-3, 1e-3)
force = st.floats(-10.0, 10.0, allow_subnormal=False)  # so small a force times a tick would be no impulse
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
        assert account.energy >= -account.bound - 1e-12
    forces.append(np.zeros(3))
    booked = book(np.array(forces), np.array(places), np.array(periods), BookedDevice(1e-5, delay, watchdog))
    assert booked.work.sum() + booked.late.sum() == pytest.approx(whole, abs=1e-9)
    assert booked.work.sum() == pytest.approx(account.energy, abs=1e-9)


NOMINAL, COUNT = 1e-3, 1e-5
LAWS = ("fixed", "with", "against", "latch")


def asked(law: str, step: np.ndarray, size: float) -> np.ndarray:
    """What a material wants to push with [N] while the hand goes this step: with or against it, or as a latch."""
    if law == "fixed":
        return np.array((size, -size, 0.5 * size))
    if law == "latch":  # soft on the way in, stiff on the way out
        return np.array((0.0, 0.0, abs(size) * (0.2 if step[2] < 0.0 else 1.0)))
    way = step / max(float(np.linalg.norm(step)), 1e-12)
    return abs(size) * (way if law == "with" else -way)


class Session:
    """A hand with an account, and its books beside it; `largest_debt` is a fraction of the bound."""

    def __init__(self, delay: float, watchdog: float) -> None:
        self.account = SpatialEnergyAccount(COUNT, delay=delay, watchdog=watchdog)
        self.books = Books(DeviceSpecification(damping=2.0, resolution=COUNT, delay=delay, watchdog=watchdog), 3)
        self.place, self.largest_debt = np.zeros(3), 0.0
        self.account.observe((0.0, 0.0, 0.0))
        self.books.position = (0.0, 0.0, 0.0)

    def tick(self, step: tuple, wanted: np.ndarray, period: float, *, missing: bool, closes: bool) -> None:
        self.books.hold(self.account.hold(tuple(wanted.tolist())))
        self.place = self.place + step
        seen = (math.nan,) * 3 if missing else tuple(self.place.tolist())
        self.books.move(seen, period)
        self.account.observe(seen, period)
        if closes:
            self.account.close()
        account, bound = self.account, self.account.bound
        self.books.check(account.energy, bound, account.late_energy)
        self.largest_debt = max(self.largest_debt, -account.energy / bound if bound > 0.0 else 0.0)


ticks = st.tuples(
    st.tuples(small, small, small),
    force,
    st.sampled_from((NOMINAL,) * 4 + (3e-3, 0.05)),
    st.integers(0, 6).map(lambda number: number == 0),
    st.integers(0, 9).map(lambda number: number == 0),
)
sessions = given(
    st.lists(st.tuples(st.sampled_from(LAWS), st.lists(ticks, min_size=1, max_size=30)), min_size=1, max_size=6),
    st.sampled_from((0.0, 5e-4, 1e-3)),
    st.sampled_from((0.0, 0.02)),
)


def held(parts: list, delay: float, watchdog: float) -> None:
    session = Session(delay, watchdog)
    for law, some in parts:
        for step, size, period, missing, closes in some:
            session.tick(step, asked(law, np.array(step), size), period, missing=missing, closes=closes)


@sessions
def test_over_a_whole_session_the_hand_is_given_no_more_than_the_bound(
    parts: list, delay: float, watchdog: float
) -> None:
    """With contacts lost, late ticks and positions that are missing; what these gave out is told beside it."""
    held(parts, delay, watchdog)


@pytest.mark.long
@settings(max_examples=250)
@sessions
def test_nor_in_hundreds_of_them(parts: list, delay: float, watchdog: float) -> None:
    held(parts, delay, watchdog)


@pytest.mark.parametrize("law", LAWS[1:])
@pytest.mark.parametrize("delay", [0.0, 1e-3])
def test_a_material_that_gives_out_comes_near_to_the_bound_and_one_that_takes_does_not(law: str, delay: float) -> None:
    session, random = Session(delay, 0.0), np.random.default_rng(1)
    for number in range(400):
        step = 5e-4 * np.array((0.1, 0.1, math.cos(0.2 * number))) + 1e-5 * random.normal(size=3)
        session.tick(step, asked(law, step, 5.0), NOMINAL, missing=False, closes=number % 50 == 0)
    assert session.largest_debt > 0.6 if law != "against" else session.largest_debt < 0.5


def test_a_force_that_turns_late_in_a_hollow_is_cut() -> None:
    """Round and round in a hollow of 5 mm: a held normal force gives out a little in every tick, for ever."""
    radius, account, least = 5e-3, SpatialEnergyAccount(1e-5), 0.0
    cut = 0
    for number in range(4000):
        a = 0.06 * number
        place = (radius * math.cos(a), radius * math.sin(a), 0.0)
        account.observe(place)
        least = min(least, account.energy + account.bound)
        wanted = (-2.0 * math.cos(a), -2.0 * math.sin(a), 0.0)
        cut += account.hold(wanted) != wanted
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

"""Which commands are fresh, by number and by how long they travelled."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.session.network.playout import Arrival, Freshness

MS, S = 1_000_000, 1_000_000_000
FAR = 10**15  # between both clocks [ns]


def judge(freshness: Freshness, sequence: int, transit_ms: float, *, offset: int = FAR) -> Arrival:
    sent = sequence * MS
    return freshness.judge(sequence, sent, sent + offset + round(transit_ms * MS))


@pytest.mark.parametrize("offset", [FAR, -FAR, 0])
def test_what_waited_longer_than_the_allowance_is_stale_whatever_the_clocks(offset: int) -> None:
    freshness = Freshness(0.2, 1e-3)
    for sequence in range(1, 500):
        assert judge(freshness, sequence, 300.0 + sequence % 7, offset=offset) is Arrival.FRESH
    assert judge(freshness, 500, 300.0 + 199.0, offset=offset) is Arrival.FRESH
    assert judge(freshness, 501, 300.0 + 202.0, offset=offset) is Arrival.STALE
    assert judge(freshness, 502, 310.0, offset=offset) is Arrival.FRESH
    assert freshness.counts == [501, 1, 0, 0]


def test_copies_and_what_was_overtaken_are_refused() -> None:
    freshness = Freshness(0.2, 1e-3)
    for sequence, found in ((5, Arrival.FRESH), (5, Arrival.OVERTAKEN), (3, Arrival.OVERTAKEN), (6, Arrival.FRESH)):
        assert judge(freshness, sequence, 10.0) is found


def test_numbers_and_clocks_that_run_ahead_are_from_the_future() -> None:
    freshness = Freshness(0.2, 1e-3)
    assert judge(freshness, 100, 10.0) is Arrival.FRESH
    assert freshness.judge(5000, 101 * MS, 111 * MS + FAR) is Arrival.FUTURE
    assert freshness.judge(101, 101 * MS + 20 * S, 111 * MS + FAR) is Arrival.FUTURE
    assert judge(freshness, 101, 10.0) is Arrival.FRESH, "what was refused leaves no trace"


def test_a_leader_that_lost_ticks_is_not_from_the_future() -> None:
    freshness = Freshness(0.2, 1e-3)
    assert freshness.judge(1, 0, FAR) is Arrival.FRESH
    assert freshness.judge(2, 30 * S, FAR + 30 * S) is Arrival.FRESH
    assert freshness.judge(3, 30 * S + MS, FAR + 30 * S + MS) is Arrival.FRESH


def test_a_slower_network_is_believed_after_a_minute() -> None:
    freshness = Freshness(0.2, 1e-3)
    assert judge(freshness, 1, 50.0) is Arrival.FRESH
    found = [judge(freshness, 1000 * second, 1050.0) for second in range(1, 90)]
    assert set(found[:59]) == {Arrival.STALE}
    assert set(found[61:]) == {Arrival.FRESH}


def test_another_way_begins_anew() -> None:
    freshness = Freshness(0.2, 1e-3)
    assert judge(freshness, 1000, 50.0) is Arrival.FRESH
    freshness.begin()
    assert judge(freshness, 1, 2050.0) is Arrival.FRESH


@given(st.lists(st.floats(0.0, 900.0), min_size=1, max_size=300), st.integers(0, 2**32))
def test_what_is_fresh_grows_in_number_and_never_waited_longer_than_allowed(waits: list[float], seed: int) -> None:
    freshness, numbers = Freshness(0.2, 1e-3), random.Random(seed)
    arrivals = sorted(
        (5.0 * number + wait, number)
        for number, wait in enumerate(waits, 1)
        for _ in range(1 + (numbers.random() < 0.2))
    )
    newest, smallest = 0, float("inf")
    for when, number in arrivals:
        smallest = min(smallest, when - 5.0 * number)
        found = freshness.judge(number, 5 * number * MS, round(when * MS))
        if number <= newest:
            assert found is Arrival.OVERTAKEN
        elif abs(when - 5.0 * number - smallest - 200.0) > 1e-3:
            stale = when - 5.0 * number > smallest + 200.0
            assert found is (Arrival.STALE if stale else Arrival.FRESH)
        if found is Arrival.FRESH:
            newest = number
    assert sum(freshness.counts) == len(arrivals)


def test_an_allowance_that_is_none_is_refused() -> None:
    with pytest.raises(SettingError, match="queueing_allowance"):
        Freshness(0.0, 1e-3)

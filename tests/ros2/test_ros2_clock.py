"""When a message was made, and whose turn it is, as properties."""

from __future__ import annotations

import random
import time
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.ros2 import Pace, SessionClock, wall_offset_ns

TICK, SECOND = 1_000_000, 1_000_000_000
WAYS = st.lists(st.integers(0, 400_000_000), min_size=1, max_size=200)


@given(WAYS, st.integers(-(10**15), 10**15))
def test_a_stamp_is_late_by_the_shortest_way_so_far_whatever_the_clocks_differ_by(ways: list[int], ahead: int) -> None:
    clock = SessionClock()
    for tick, way in enumerate(ways):
        made = 10**16 + tick * TICK
        stamp = clock.local_ns("follower", made + ahead, made + way)
        assert stamp == made + min(ways[: tick + 1])
        assert stamp <= made + way  # never later than it came


def test_stamps_keep_the_senders_spacing_where_the_network_does_not() -> None:
    clock, draw = SessionClock(), random.Random(1)
    stamps = [
        clock.local_ns("leader", tick * TICK, tick * TICK + draw.randrange(10**5, 10**8)) for tick in range(20_000)
    ]
    gaps = {late - early for early, late in pairwise(stamps[5000:])}
    assert max(abs(gap - TICK) for gap in gaps) < 50_000


def test_senders_have_clocks_of_their_own() -> None:
    clock = SessionClock()
    assert clock.local_ns(("follower", 1), 500, 7_000_000) == 7_000_000
    assert clock.local_ns(("follower", 2), 9 * 10**17, 8_000_000) == 8_000_000
    assert clock.local_ns(("follower", 1), 500 + TICK, 9_000_000) == 7_000_000 + TICK
    for other in range(1000):  # no sender fills the memory
        clock.local_ns(other, 0, 0)
    assert len(clock._transits) == 64


@pytest.mark.parametrize("drift", [50e-6, -50e-6])
def test_a_clock_that_drifts_is_followed(drift: float) -> None:
    clock = SessionClock()
    errors = []
    for made in range(0, 600 * SECOND, 10 * TICK):
        sent = round(made * (1.0 + drift))
        errors.append(clock.local_ns("follower", sent, made + TICK) - made)
    assert max(map(abs, errors)) < 3_000_000 + TICK
    assert min(errors[-6000:]) > -3_000_000 + TICK


def test_both_clocks_of_this_machine_are_put_together() -> None:
    before, now, after = time.time_ns(), time.monotonic_ns() + wall_offset_ns(), time.time_ns()
    assert before - 1_000_000 < now < after + 1_000_000


@given(st.floats(0.5, 2000.0), st.lists(st.integers(0, 20 * TICK), min_size=2, max_size=300))
def test_never_more_than_the_rate_and_always_forward(rate: float, gaps: list[int]) -> None:
    pace, now, out = Pace(rate), 0, []
    for gap in gaps:
        now += gap
        if pace.is_due(now):
            out.append(now)
    assert all(late > early for early, late in pairwise(out))
    assert len(out) <= (now - gaps[0]) * 1e-9 * rate + 2  # one at the beginning, one early


@pytest.mark.parametrize(
    ("rate", "most"), [(100.0, 1000), (10.0, 100), (333.0, 3330), (1000.0, 10_000), (5000.0, 10_000)]
)
def test_even_ticks_come_at_the_rate_or_all(rate: float, most: int) -> None:
    pace, draw = Pace(rate), random.Random(2)
    count = sum(pace.is_due(tick * TICK + draw.randrange(100_000)) for tick in range(10_000))
    assert 0.99 * most <= count <= most + 1


def test_a_pause_is_not_made_up_for() -> None:
    pace = Pace(100.0)
    assert pace.is_due(0)
    assert sum(pace.is_due(10 * SECOND + tick * TICK) for tick in range(100)) <= 11


def test_what_is_older_than_what_went_out_stays() -> None:
    pace = Pace(1000.0)
    assert pace.is_due(5 * TICK)
    assert not pace.is_due(5 * TICK)
    assert not pace.is_due(4 * TICK)
    assert pace.is_due(6 * TICK)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(SettingError, match=r"rate = .*: must be above 0 messages a second"):
        Pace(rate)

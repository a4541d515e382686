"""An even stream from uneven arrivals, and which of them are fresh."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.session.network.freshness import Arrival, Freshness
from foretouch.session.network.playout import LONGEST_BRIDGE, Playout


def path(sequence: float) -> float:
    return 0.01 * math.sin(2 * math.pi * 1e-3 * sequence)


def play(arrivals: dict[int, list[int]], ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and applied numbers of each tick; arrivals: tick to the sequence numbers that come in it."""
    playout, positions, applied = Playout(), [], []
    for tick in range(ticks):
        for sequence in arrivals.get(tick, []):
            playout.push(sequence, path(sequence))
        positions.append(playout.advance())
        applied.append(playout.applied)
    return np.array(positions), np.array(applied)


def jittered(jitter: int, ticks: int, loss: float = 0.0, seed: int = 0) -> dict[int, list[int]]:
    random = np.random.default_rng(seed)
    arrivals: dict[int, list[int]] = {}
    for sequence in range(1, ticks):
        if random.random() >= loss:
            arrivals.setdefault(sequence + int(random.integers(0, jitter + 1)), []).append(sequence)
    return arrivals


def test_an_even_stream_passes_untouched_and_at_once() -> None:
    positions, applied = play({n: [n] for n in range(1, 500)}, 500)
    assert math.isnan(positions[0])
    np.testing.assert_array_equal(applied, np.arange(500))
    np.testing.assert_array_equal(positions[1:], [path(n) for n in range(1, 500)])


def test_beating_arrivals_are_evened_out_after_the_first_gap() -> None:
    """0, then 2 in a tick: without a playout the robot would be told steps of 0 and 2 periods in turn."""
    arrivals = {n + (n % 2): [] for n in range(1, 1000)}
    for n in range(1, 1000):
        arrivals[n + (n % 2)].append(n)
    positions, applied = play(arrivals, 999)
    steps = np.diff(applied[10:])
    assert set(steps.tolist()) == {1}
    assert np.abs(np.diff(positions[10:], 2)).max() < 1e-6


@pytest.mark.parametrize(("jitter", "loss"), [(3, 0.0), (10, 0.0), (10, 0.1), (0, 0.2)])
def test_jitter_and_loss_leave_a_smooth_path(jitter: int, loss: float) -> None:
    positions, applied = play(jittered(jitter, 6000, loss), 5900)
    late = slice(1500, None)
    assert np.abs(np.diff(positions[late], 2)).max() < 1.5e-4  # a hand at 63 mm/s that is held for a tick: 6.3e-5
    assert np.mean(np.abs(np.diff(positions[late], 2)) > 1e-5) < 0.02
    lag = np.arange(5900)[late] - applied[late]
    assert lag.min() >= 0
    assert lag.max() <= jitter + 10  # lost ones wait for the next


def test_lead_that_is_no_longer_needed_is_played_off() -> None:
    arrivals = {n: [n] for n in range(1, 500)}
    arrivals[600] = list(range(500, 601))  # held up for 100 ticks
    arrivals |= {n: [n] for n in range(601, 12_000)}
    positions, applied = play(arrivals, 11_900)
    lag = np.arange(11_900) - applied
    assert lag[599] == 100
    assert lag[620] >= 90
    assert lag[-1] <= 3
    # Never faster than twice the pace.
    assert np.abs(np.diff(positions[1:])).max() < 2.0 * 0.01 * 2 * math.pi * 1e-3 * 1.01


def test_an_outage_is_bridged_and_not_replayed() -> None:
    arrivals = {n: [n] for n in range(1, 500)} | {n: [n] for n in range(3250, 6000)}
    positions, applied = play(arrivals, 5900)
    assert set(positions[499:3250].tolist()) == {path(499)}
    far = abs(path(3250) - path(499))
    assert np.abs(np.diff(positions[3249:3300])).max() < 1.5 * (far / LONGEST_BRIDGE) + 1e-4
    assert applied[3250 + LONGEST_BRIDGE + 2] >= 3250
    np.testing.assert_allclose(positions[-1], path(applied[-1]), atol=7e-5)


@given(st.lists(st.lists(st.tuples(st.integers(1, 400), st.floats()), max_size=4), max_size=150))
def test_nothing_raises_goes_back_or_leaves_what_was_said(arrivals: list[list[tuple[int, float]]]) -> None:
    playout, applied = Playout(), 0
    output: list[float] = []
    for commands in arrivals:
        for sequence, position in commands:
            playout.push(sequence, position)
            if abs(position) <= 1.0:
                output.append(position)
        position = playout.advance()
        assert playout.applied >= applied
        applied = playout.applied
        if output:
            assert min(output) <= position <= max(output)
        else:
            assert math.isnan(position)


# --- which commands are fresh, by number and by how long they travelled -----------------------------------------------


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


def test_copies_and_what_was_overtaken_are_refused_and_another_way_begins_anew() -> None:
    freshness = Freshness(0.2, 1e-3)
    for sequence, result in ((5, Arrival.FRESH), (5, Arrival.OVERTAKEN), (3, Arrival.OVERTAKEN), (6, Arrival.FRESH)):
        assert judge(freshness, sequence, 10.0) is result
    freshness = Freshness(0.2, 1e-3)
    assert judge(freshness, 1000, 50.0) is Arrival.FRESH
    freshness.begin()
    assert judge(freshness, 1, 2050.0) is Arrival.FRESH


def test_numbers_and_clocks_that_run_ahead_are_from_the_future_and_lost_ticks_are_not() -> None:
    freshness = Freshness(0.2, 1e-3)
    assert judge(freshness, 100, 10.0) is Arrival.FRESH
    assert freshness.judge(5000, 101 * MS, 111 * MS + FAR) is Arrival.FUTURE
    assert freshness.judge(101, 101 * MS + 20 * S, 111 * MS + FAR) is Arrival.FUTURE
    assert judge(freshness, 101, 10.0) is Arrival.FRESH, "what was refused leaves no trace"
    freshness = Freshness(0.2, 1e-3)
    assert freshness.judge(1, 0, FAR) is Arrival.FRESH
    assert freshness.judge(2, 30 * S, FAR + 30 * S) is Arrival.FRESH
    assert freshness.judge(3, 30 * S + MS, FAR + 30 * S + MS) is Arrival.FRESH


def test_a_slower_network_is_believed_after_a_minute() -> None:
    freshness = Freshness(0.2, 1e-3)
    assert judge(freshness, 1, 50.0) is Arrival.FRESH
    result = [judge(freshness, 1000 * second, 1050.0) for second in range(1, 90)]
    assert set(result[:59]) == {Arrival.STALE}
    assert set(result[61:]) == {Arrival.FRESH}


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
        result = freshness.judge(number, 5 * number * MS, round(when * MS))
        if number <= newest:
            assert result is Arrival.OVERTAKEN
        elif abs(when - 5.0 * number - smallest - 200.0) > 1e-3:
            stale = when - 5.0 * number > smallest + 200.0
            assert result is (Arrival.STALE if stale else Arrival.FRESH)
        if result is Arrival.FRESH:
            newest = number
    assert sum(freshness.counts) == len(arrivals)


def test_an_allowance_that_is_none_is_refused() -> None:
    with pytest.raises(SettingError, match="queueing_allowance"):
        Freshness(0.0, 1e-3)

"""An even stream from uneven arrivals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
    said: list[float] = []
    for commands in arrivals:
        for sequence, position in commands:
            playout.push(sequence, position)
            if abs(position) <= 1.0:
                said.append(position)
        position = playout.advance()
        assert playout.applied >= applied
        applied = playout.applied
        if said:
            assert min(said) <= position <= max(said)
        else:
            assert math.isnan(position)
        assert len(playout._commands) <= 1 + len(said)

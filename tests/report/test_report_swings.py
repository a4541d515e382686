"""Swings of a hand, against motions whose swings are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from foretouch.messages import LEADER_DTYPE
from foretouch.report import oscillation, swings, turning_points

QUICK = settings(derandomize=True, deadline=None, max_examples=60)
Array = NDArray[np.float64]
TIME = np.arange(30_000) * 1e-3
MEANT = 0.01 * np.sin(2 * np.pi * 0.5 * TIME)  # 30 turning points in 30 s


def rows(hand: Array, meant: Array) -> NDArray[np.void]:
    table = np.zeros(hand.size, LEADER_DTYPE)
    table["time_ns"] = np.arange(hand.size) * 1_000_000
    table["exact_hand_position"], table["intended_position"] = hand, meant
    return table


@pytest.mark.parametrize(("size", "expected"), [(4e-3, 20), (3e-4, 18), (2e-4, 0)])
def test_turning_points_of_a_sine(size: float, expected: int) -> None:
    """Ten periods; a swing is twice the amplitude, the first and the last are half of one."""
    turns = turning_points(size * np.sin(2 * np.pi * np.arange(10_000) * 1e-3))
    assert turns.size == expected
    assert (turns % 500 == 250).all()


def test_the_position_of_a_turn_is_its_extreme() -> None:
    assert turning_points(1e-3 * np.array([0.0, 3.0, 2.9, 1.0, 1.2, 0.8, 4.0, 3.9, 0.0])).tolist() == [1, 5, 6]
    assert turning_points(np.zeros(0)).size == turning_points(np.ones(5)).size == 0


@QUICK
@given(st.lists(st.floats(-5e-3, 5e-3), max_size=40))
def test_turns_alternate_and_lie_a_swing_apart_both_ways(positions: list[float]) -> None:
    position = np.array(positions)
    # Rounding decides about positions that are just a swing apart, one way or the other.
    assume(not np.isclose(np.abs(np.subtract.outer(position, position)), 5e-4, rtol=1e-9, atol=0.0).any())
    turns = turning_points(position)
    legs = np.diff(position[turns])
    assert (np.abs(legs) > 5e-4).all()
    assert (legs[1:] * legs[:-1] < 0.0).all()
    assert turning_points(position[::-1]).size == turns.size


@pytest.mark.parametrize("lag", [0, 50, 300])
def test_a_hand_that_lags_and_gives_way_does_not_oscillate(lag: int) -> None:
    hand = 0.7 * np.roll(MEANT, lag)
    hand[:lag] = 0.0
    figures = oscillation(rows(hand, MEANT))
    assert figures["free_swings"] == 30
    assert figures["extra_swings"] <= 1
    assert not figures["oscillates"]


@pytest.mark.parametrize(("left", "dies"), [(0.4, True), (0.6, True), (0.9, False), (1.0, False), (1.1, False)])
def test_a_rebound_that_dies_away_is_none(left: float, dies: bool) -> None:
    """Ten presses into something hard, each with six swings that shrink by one ratio."""
    push = np.linspace(0.0, 0.01, 500)
    ways = 2e-3 * left ** np.arange(6) * np.array([-1, 1] * 3)
    ring = 0.01 + np.concatenate(([0.0], np.cumsum(ways)))
    ringing = np.interp(np.arange(600), 100 * np.arange(7), ring)
    back = np.linspace(ring[-1], 0.0, 500)
    hand = np.tile(np.concatenate((push, ringing, back)), 10)
    meant = np.tile(np.concatenate((push, np.full(600, 0.01), back)), 10)
    figures = oscillation(rows(hand, meant))
    assert figures["free_swings"] == 19
    assert figures["oscillates"] is not dies
    assert turning_points(hand).size > 30


def test_swings_of_a_press_with_a_rebound() -> None:
    position = 1e-3 * np.array([0.0, 10.0, 8.0, 8.6, 0.0, 10.0, 0.0])
    assert turning_points(position).tolist() == [1, 2, 3, 4, 5]
    assert swings(position).tolist() == [1, 2, 4, 5]
    assert swings(np.zeros(0)).size == 0


def test_a_hand_that_trembles_throughout_oscillates() -> None:
    figures = oscillation(rows(MEANT + 1e-3 * np.sin(2 * np.pi * 6.0 * TIME), MEANT))
    assert figures["oscillates"]
    assert figures["extra_swings"] > 100


def test_a_short_burst_in_a_long_session_is_not_hidden() -> None:
    long = np.tile(MEANT, 4)
    hand = long.copy()
    hand[50_000:50_600] += 2e-3 * np.sin(2 * np.pi * 10.0 * TIME[:600])
    figures = oscillation(rows(hand, long))
    assert figures["extra_swings"] <= 2 + 0.1 * figures["free_swings"]
    assert figures["largest_burst"] > 4
    assert figures["oscillates"]


def test_slow_swings_that_add_up_are_found_too() -> None:
    """One more every 2.4 s is no burst."""
    still = np.zeros(30_000)
    figures = oscillation(rows(2e-3 * np.sin(2 * np.pi * TIME / 4.8), still))
    assert figures["largest_burst"] <= 4
    assert figures["oscillates"]


def test_what_is_not_known_is_not_judged() -> None:
    figures = oscillation(rows(MEANT, np.full(MEANT.size, np.nan)))
    assert set(figures.values()) == {None}

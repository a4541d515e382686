"""Clocks around functions, and where the time of a step goes."""

from __future__ import annotations

import time

import numpy as np
import pytest

from foretouch.bench.benchmarks.profile import (
    ELSE,
    PARTS,
    STEP,
    WITHOUT,
    Clocks,
    Cost,
    Timed,
    middle,
    near,
    profile,
    replaced,
    timed_round,
    without_cost,
)
from foretouch.bench.benchmarks.steps import TapedSession


def spin(microseconds: float) -> None:
    end = time.perf_counter_ns() + round(1e3 * microseconds)
    while time.perf_counter_ns() < end:
        pass


class Work:
    """Some work whose parts are known."""

    def whole(self) -> None:
        self.first(twice=True)
        self.second()

    def first(self, *, twice: bool) -> None:
        spin(30.0)
        self.inner()

    def inner(self) -> None:
        spin(50.0)

    def second(self) -> str:
        spin(20.0)
        return "done"


def test_parts_have_their_own_time() -> None:
    clocks, work = Clocks({name: [(Work, name)] for name in ("first", "inner", "second")}), Work()
    took, spent, calls = [], [], []
    with clocks.running():
        for _ in range(200):
            start = time.perf_counter_ns()
            work.whole()
            took.append(time.perf_counter_ns() - start)
            booked, counted = clocks.take()
            spent.append(booked)
            calls.append(counted)
    assert calls == [[1, 1, 1]] * 200
    whole, own = without_cost(np.array(took, float), np.array(spent, float), np.array(calls), Clocks.cost(), {1: 0})
    assert np.percentile(own, 25, axis=0) == pytest.approx([30e3, 50e3, 20e3], rel=0.15)
    assert np.percentile(whole, 25) == pytest.approx(100e3, rel=0.1)


def test_functions_are_as_before_afterwards() -> None:
    before = Work.second
    with Clocks({"second": [(Work, "second")]}).running():
        assert Work.second is not before
        assert Work().second() == "done"
    assert Work.second is before

    def failing() -> None:
        with replaced({(Work, "second"): lambda function: None, (Work, "no such"): lambda function: None}):
            pass

    with pytest.raises(AttributeError):
        failing()
    assert Work.second is before


def test_what_clocks_take_is_taken_off() -> None:
    cost = Cost(inside=2.0, whole=5.0)
    # Part 1 took 30, part 2 took 10 within it, the step 100 without clocks: three calls in all.
    spent, calls = np.array([[30.0 + 10.0 + 5.0 + 2.0, 10.0 + 2 * 2.0]]), np.array([[1, 2]])
    spent[0, 0] += 5.0  # of the second inner call
    took, own = without_cost(np.array([100.0 + 3 * 5.0]), spent, calls, cost, {1: 0})
    assert took == pytest.approx([100.0])
    assert own == pytest.approx(np.array([[30.0, 10.0]]))
    assert cost.among(60.0, 3.0) == Cost(2.0, 20.0)
    assert cost.among(3.0, 3.0) == cost == cost.among(1.0, 0.0)
    assert 0.0 < Clocks.cost().inside < Clocks.cost().whole < 100e3


def test_ticks_near_a_percentile_stand_for_it() -> None:
    took = np.random.default_rng(0).permutation(np.arange(1000.0))
    for percentile in (50, 99):
        chosen = took[near(took, percentile)]
        assert chosen.mean() == pytest.approx(np.percentile(took, percentile), abs=1.0)
        assert chosen.size == pytest.approx(200 if percentile == 50 else 10, abs=2)


def test_each_tick_counts_in_its_middle_round() -> None:
    rounds = [Timed(np.array([a, b]), np.array([[a, 0.0], [0.0, b]])) for a, b in ((1.0, 9.0), (3.0, 5.0), (2.0, 7.0))]
    result = middle(rounds)
    assert result.took.tolist() == [2.0, 7.0]
    assert result.parts.tolist() == [[2.0, 0.0], [0.0, 7.0]]


@pytest.fixture(scope="module")
def session() -> TapedSession:
    return TapedSession(2.0)


@pytest.mark.long
def test_the_parts_add_up_and_each_is_there(session: TapedSession) -> None:
    timed = timed_round(session, session.times())
    for side, parts in PARTS.items():
        assert timed[side].took.size > 100
        assert timed[side].parts.sum(axis=1) == pytest.approx(timed[side].took)
        for place, part in enumerate(parts):
            # What is left over is a difference, which a busy machine makes negative.
            assert part.name == ELSE or timed[side].parts[:, place].sum() > 0.0, f"{side}: nothing calls {part.name}"


@pytest.mark.long
def test_a_profile_says_where_the_time_goes(session: TapedSession) -> None:
    result = profile(session, 1)
    for (side, _), times in result.items():
        names = [part.name for part in PARTS[side]]
        assert list(times) == [STEP, *names, WITHOUT]
        assert sum(times[name] for name in names) == pytest.approx(times[STEP])
        assert names[-1] == ELSE
    for side in PARTS:
        assert result[side, 50][STEP] < result[side, 99][STEP]
        assert 0.2 < result[side, 50][STEP] / result[side, 50][WITHOUT] < 5.0

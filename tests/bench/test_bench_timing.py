"""Contestants in turns: ratios are ratios, whatever the machine does meanwhile."""

from __future__ import annotations

import gc
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from foretouch.bench.timing import Contestant, interleave, once, ratio, spread


@njit(cache=True)
def chain(count: int) -> float:
    """A chain of divisions that no compiler shortens."""
    value = 1.5
    for _ in range(count):
        value = 1.0 / value + 1e-9
    return value


def work(count: int) -> Callable[[], object]:
    return lambda: chain(count)


@pytest.mark.flaky(reruns=2)  # what else a core does may slow the longer work in all of its rounds
def test_what_is_three_times_as_slow_shows_a_three() -> None:
    times = interleave({"one": Contestant(work(50_000)), "three": Contestant(work(150_000))}, 41)
    assert times["three"].min() / times["one"].min() == pytest.approx(3.0, rel=0.1)
    assert ratio(times, "three", "one").median == pytest.approx(3.0, rel=0.5)  # other work shares the cores


@pytest.mark.flaky(reruns=2)
def test_times_are_of_one_unit_of_work() -> None:
    times = interleave({"few": Contestant(work(50_000), 100), "many": Contestant(work(200_000), 400)}, 41)
    assert times["many"].min() / times["few"].min() == pytest.approx(1.0, rel=0.1)


def test_a_machine_that_slows_down_between_rounds_does_not_change_a_ratio() -> None:
    slowness = np.random.default_rng(0).uniform(1.0, 10.0, 50)
    result = ratio({"ours": 2.0 * slowness, "theirs": 6.0 * slowness}, "theirs", "ours")
    assert (result.lower, result.median, result.upper) == pytest.approx((3.0, 3.0, 3.0))


def test_all_take_turns_after_a_round_to_warm_up() -> None:
    order: list[str] = []
    contestants = {name: Contestant(lambda name=name: order.append(name)) for name in "abc"}  # type: ignore[misc]
    interleave(contestants, 3)
    assert "".join(order) == "abc" + "abc" + "bca" + "cab"


def test_the_collector_is_off_inside_and_on_again_after() -> None:
    seen: list[bool] = []
    once(Contestant(lambda: seen.append(gc.isenabled()), prepare=lambda: seen.append(gc.isenabled())))
    assert seen == [True, False]
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError):
        once(Contestant(lambda: 1 / 0))
    assert gc.isenabled()


@given(st.lists(st.floats(1e-9, 1e9), min_size=1, max_size=30))
def test_a_spread_is_in_order_and_among_the_figures(figures: list[float]) -> None:
    result = spread(figures)
    assert min(figures) == result.least
    assert result.least <= result.lower <= result.median <= result.upper <= max(figures)
    assert spread(figures, 2.0).median == pytest.approx(2.0 * result.median)

"""Seeded faults: exact without randomness, as asked on average with it, the same on repeat."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.link import Faults, FaultStage, SequenceCounter

MS = 1_000_000


def run(faults: Faults, messages: int = 5000) -> list[tuple[int, int]]:
    """Send one message a millisecond; return (arrival tick, message) in order of arrival."""
    stage: FaultStage[int] = FaultStage(faults)
    arrived = []
    for tick in range(messages + 2000):
        if tick < messages:
            stage.push(tick * MS, tick)
        arrived += [(tick, message) for message in stage.pop_due(tick * MS)]
    return arrived


def test_without_faults_everything_arrives_at_once_and_in_order() -> None:
    assert run(Faults(), 100) == [(n, n) for n in range(100)]


@given(st.integers(0, 500))
def test_a_delay_is_exact(delay_ms: int) -> None:
    assert run(Faults(delay=delay_ms * 1e-3), 20) == [(n + delay_ms, n) for n in range(20)]


def test_jitter_spreads_within_its_bounds_and_reorders() -> None:
    arrived = run(Faults(delay=0.08, jitter=0.01, seed=1))
    late = np.array([tick - message for tick, message in arrived])
    assert len(arrived) == 5000
    assert late.min() >= 70
    assert late.max() <= 91
    assert abs(late.mean() - 80.5) < 0.5  # arrivals wait for the next tick
    order = [message for _, message in arrived]
    assert order != sorted(order)


def test_loss_takes_its_share() -> None:
    assert 0.045 < 1 - len(run(Faults(loss=0.05, seed=2))) / 5000 < 0.055
    assert run(Faults(loss=1.0), 100) == []


def test_an_outage_takes_its_length_out_of_every_ten_seconds() -> None:
    messages = {message for _, message in run(Faults(outage=0.5, seed=3), 30_000)}
    for window in range(3):
        lost = sorted(set(range(window * 10_000, (window + 1) * 10_000)) - messages)
        assert abs(len(lost) - 500) <= 1
        assert lost[-1] - lost[0] == len(lost) - 1


def test_the_seed_decides_everything() -> None:
    faults = Faults(delay=0.05, jitter=0.02, loss=0.1, outage=0.2, seed=7)
    assert run(faults) == run(faults)
    assert run(faults) != run(Faults(delay=0.05, jitter=0.02, loss=0.1, outage=0.2, seed=8))


def test_one_fault_does_not_shift_the_draws_of_another() -> None:
    with_loss = {message: tick for tick, message in run(Faults(delay=0.05, jitter=0.02, loss=0.2, seed=4))}
    without = {message: tick for tick, message in run(Faults(delay=0.05, jitter=0.02, seed=4))}
    assert all(without[message] == tick for message, tick in with_loss.items())


def test_the_delay_may_change_on_the_way() -> None:
    stage: FaultStage[str] = FaultStage(Faults(delay=0.1))
    stage.push(0, "slow")
    stage.delay = 0.01
    stage.push(0, "fast")
    assert stage.pop_due(10 * MS) == ["fast"]
    assert stage.pop_due(100 * MS) == ["slow"]


@pytest.mark.parametrize(
    ("name", "value"), [("delay", -0.1), ("delay", 11.0), ("jitter", -1.0), ("loss", 1.5), ("outage", 20.0)]
)
def test_bad_faults_are_refused(name: str, value: float) -> None:
    settings: dict[str, Any] = {name: value}
    with pytest.raises(SettingError, match=f"{name} = {value}: .*must lie between"):
        Faults(**settings)


def test_counting_by_sequence() -> None:
    counter = SequenceCounter()
    assert [counter.is_newest(n) for n in (1, 2, 5, 4, 6)] == [True, True, True, False, True]
    assert (counter.newest, counter.received, counter.late, counter.lost) == (6, 5, 1, 1)

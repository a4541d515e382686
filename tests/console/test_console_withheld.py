"""The console says in a sentence that the hand is not given the model's force, and why."""

from __future__ import annotations

from typing import Any

import msgspec

from foretouch.console.sentences import session_status
from foretouch.console.watched import Watched
from foretouch.messages import VERSION, Hello, LeaderState
from foretouch.rendering.limits import OWED, UNPAID

NOW = 100.0
STATE = LeaderState(
    VERSION, 1, 1_000_000, 0.01, 0.0, 4.0, 0.0, 0.5, 1, 1, 0.0, False, 1_000_000, 50_000, hand_position=0.01, epoch=7
)


def hears(heard: Watched, ticks: int, **changes: Any) -> None:
    """As many ticks of the leader as these, after those before."""
    begin = 0 if heard.leader is None else heard.leader.sequence
    for sequence in range(begin + 1, begin + ticks + 1):
        changed = msgspec.structs.replace(STATE, sequence=sequence, time_ns=sequence * 1_000_000, **changes)
        heard.take(changed, NOW)


def session(**texts: str) -> Watched:
    received, output = Watched(), {"grip": "normal", "operator": "browser"} | texts
    received.take(Hello(VERSION, 1, 1, "leader", tuple(output), tuple(output.values())), NOW)
    return received


def status(heard: Watched) -> str:
    return session_status(heard, NOW, held=True, clutched=False)


def test_force_that_is_withheld_is_said_after_half_a_second_and_no_more_once_it_is_back() -> None:
    received = session()
    hears(received, 450, energy=-2e-3)
    assert "withheld" not in status(received)
    hears(received, 100, energy=-2e-3)
    assert status(received).startswith(f"The force is withheld: {OWED}; leave the surface and press again. You press.")
    hears(received, 300, predicted_force=0.0)  # between two presses
    assert "withheld" in status(received)
    hears(received, 1, rendered_force=3.0)
    assert "withheld" not in status(received)


def test_why_it_is_withheld_is_told() -> None:
    received = session()
    hears(received, 600, energy=1e-5)
    assert UNPAID in status(received)


def test_a_hand_that_has_gone_is_not_told_for_long() -> None:
    received = session()
    hears(received, 600)
    hears(received, 2100, predicted_force=0.0)
    assert "withheld" not in status(received)


def test_a_scaled_force_a_clutch_and_an_open_loop_are_none() -> None:
    for received, changes in (
        (session(force_scale="0.1"), {"rendered_force": 0.4}),
        (session(), {"engaged": False}),
        (session(grip="none"), {}),
        (session(baseline="delayed"), {}),
    ):
        hears(received, 600, **changes)
        assert "withheld" not in status(received)


def test_a_force_reduced_by_less_than_half_is_said_with_its_part() -> None:
    received = session()
    hears(received, 600, rendered_force=2.8, energy=1e-5)
    assert status(received).startswith(f"The force is reduced by about 30 %: {UNPAID}; leave the surface")
    hears(received, 1, rendered_force=3.9, energy=1e-5)
    assert "reduced" not in status(received)

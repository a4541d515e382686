"""A session along a line in simulated time, with the settings that a user gets, on one core."""

from __future__ import annotations

from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import one_core, spread
from foretouch.session import SessionSettings, SimulatedSession, simulate

DURATION, ROUNDS = 10.0, 5


def run_session(duration: float, settings: SessionSettings | None = None) -> SimulatedSession:
    """A fresh session.

    Args:
        duration: Simulated [s].
        settings: The defaults where none are given.
    """
    settings = SessionSettings() if settings is None else settings
    return simulate(settings, duration=duration, say=lambda text: None)


def measure(scope: Scope) -> list[Row]:
    """How many times as fast as real time."""
    with one_core():
        run_session(0.5)
        faster = [DURATION / run_session(DURATION).elapsed for _ in range(ROUNDS)]
    what = f"simulate, {DURATION:g} s with default settings on one core, over real time"
    return [Row.of(what, spread(faster), "x", 15.0, at_least=True)]

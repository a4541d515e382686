"""One session of a sweep, from its case to its row."""

from __future__ import annotations

from typing import Any

from foretouch.messages import SessionLog
from foretouch.session import simulate
from foretouch.sweep.cases import Case
from foretouch.sweep.measure import measure
from foretouch.sweep.outcome import Outcome

__all__ = ["failed", "log_of", "run_case"]


def log_of(case: Case) -> tuple[SessionLog, float]:
    """Run the session: what was said in it, and the real time that it took [s]."""
    settings = case.settings()
    session = simulate(settings, duration=case.duration, say=lambda _: None)
    return session.log, session.elapsed


def run_case(case: Case) -> Outcome:
    """Run the session and measure it; one that fails, however, is a row that says why."""
    try:
        log, elapsed = log_of(case)
        figures = measure(log, case.settings())
    except Exception as error:  # a sweep goes on, whatever one session meets
        return failed(case, f"{type(error).__name__}: {error}")
    return Outcome(**_facts(case), **figures, elapsed_s=elapsed)


def failed(case: Case, reason: str) -> Outcome:
    """The row of a session that gave no result."""
    return Outcome(**_facts(case), error=" ".join(reason.split()))


def _facts(case: Case) -> dict[str, Any]:
    return {
        "number": case.number,
        "baseline": case.baseline,
        "command": case.command,
        "duration_s": case.duration,
        "network": case.network,
        "round_trip_s": case.round_trip,
        "options": case.options,
    }

"""What a check found."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Finding", "failed", "guarded", "percentile_time", "skipped"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One check.

    Attributes:
        check: Its name.
        passed: Whether the rule is kept; None where it could not be looked at.
        found: What was found, with its unit; where it could not be looked at, why not.
        rule: What is asked for, and so what to mend.
    """

    check: str
    passed: bool | None
    found: str
    rule: str

    def __post_init__(self) -> None:
        if self.passed is not None:  # NumPy's truth is no bool
            object.__setattr__(self, "passed", bool(self.passed))


def skipped(check: str, why: str, rule: str) -> Finding:
    """A check that could not be made."""
    return Finding(check, None, why, rule)


def failed(findings: Iterable[Finding]) -> list[Finding]:
    """Those whose rule is not kept."""
    return [finding for finding in findings if finding.passed is False]


def guarded(checks: Sequence[tuple[str, Callable[[], Finding | list[Finding]]]]) -> list[Finding]:
    """Make each check; one in which what is checked raises has failed by that.

    Args:
        checks: Name and check.
    """
    findings: list[Finding] = []
    for name, check in checks:
        try:
            made = check()
        except Exception as error:
            said = " ".join(f"{type(error).__name__}: {error}".split())
            made = Finding(name, False, f"raises {said}", "nothing raises while a session runs")
        findings += made if isinstance(made, list) else [made]
    return findings


def percentile_time(call: Callable[[int], object], calls: int, percentile: float, rounds: int = 3) -> float:
    """How long one call takes [s] at a percentile; of some rounds the best, for other processes want the machine too.

    Args:
        call: Given its number.
        calls: In a round.
        percentile: 0 to 100.
        rounds: Of them.
    """
    best = math.inf
    for repeat in range(rounds):
        taken = np.empty(calls)
        for index in range(calls):
            begin = time.perf_counter()
            call(repeat * calls + index)
            taken[index] = time.perf_counter() - begin
        best = min(best, float(np.percentile(taken, percentile)))
    return best

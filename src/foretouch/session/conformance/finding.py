"""Findings of conformance checks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

LONGEST_LOOK = 2.0
"""Time over which slow calls are timed, at least ten of them [s]."""


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
    """Findings whose rule is not kept."""
    return [finding for finding in findings if finding.passed is False]


def nobody(finding: Finding) -> None:
    """Ignore a finding."""


def told(findings: list[Finding], tell: Callable[[Finding], None]) -> list[Finding]:
    """Pass the findings to `tell`, and return them."""
    for finding in findings:
        tell(finding)
    return findings


def guarded(
    checks: Sequence[tuple[str, Callable[[], Finding | list[Finding]]]], tell: Callable[[Finding], None] = nobody
) -> list[Finding]:
    """Run each check; one in which what is checked raises has failed.

    Args:
        checks: Name and check.
        tell: Called with each finding as soon as it is known.
    """
    findings: list[Finding] = []
    for name, check in checks:
        try:
            made = check()
        except Exception as error:
            said = " ".join(f"{type(error).__name__}: {error}".split())
            made = Finding(name, False, f"raises {said}", "nothing raises while a session runs")
        for finding in made if isinstance(made, list) else [made]:
            findings.append(finding)
            tell(finding)
    return findings


def too_slow(
    check: str, call: Callable[[], object], limit: float, gross: float, rule: str, others: Iterable[str]
) -> list[Finding]:
    """Findings of something so slow that checking all of it would take minutes; none where it is not.

    Args:
        check: Name of the check of the time.
        call: Call that is timed, a hundred times.
        limit: Limit of its time [s].
        gross: Median time above which no other check is run [s].
        rule: Rule of the check.
        others: Names of the checks that are then left out.
    """
    begin = time.perf_counter()
    taken: list[float] = []
    while len(taken) < 100 and (len(taken) < 10 or time.perf_counter() - begin < LONGEST_LOOK):
        before = time.perf_counter()
        call()
        taken.append(time.perf_counter() - before)
    median = float(np.median(taken))
    if median <= gross:
        return []
    found = f"{1e3 * median:.4g} ms at the median of {len(taken)}, {median / limit:.0f} times as long"
    why = f"not looked at, for a call takes {1e3 * median:.4g} ms"
    return [Finding(check, False, found, rule), *(skipped(name, why, "mend the time first") for name in others)]


def percentile_time(call: Callable[[int], object], calls: int, percentile: float, rounds: int = 3) -> float:
    """How long one call takes [s] at a percentile; of some rounds the best, for other processes want the machine too.

    Args:
        call: Called with its number.
        calls: Number of calls in a round.
        percentile: 0 to 100.
        rounds: Number of rounds.
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

"""Checks of conformance, how they are declared and run, and what they find."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from foretouch.devices import SpatialDevice
from foretouch.errors import ForetouchError
from foretouch.robot import SpatialRobot

LONGEST_LOOK = 2.0  # Time over which slow calls are timed, at least ten of them [s]


@dataclass(frozen=True, slots=True)
class Finding:
    """One check.

    Attributes:
        check: Its name.
        passed: Whether the rule is kept; None where it could not be looked at.
        summary: The result, with its unit; where it could not be looked at, why not.
        rule: What is asked for, and so what to mend.
    """

    check: str
    passed: bool | None
    summary: str
    rule: str

    def __post_init__(self) -> None:
        if self.passed is not None:  # NumPy's truth is no bool
            object.__setattr__(self, "passed", bool(self.passed))


def failed(findings: Iterable[Finding]) -> list[Finding]:
    """Findings whose rule is not kept."""
    return [finding for finding in findings if finding.passed is False]


def ignore(finding: Finding) -> None:
    """Ignore a finding."""


Subject = TypeVar("Subject")
Result = tuple[bool | None, str] | tuple[bool | None, str, str] | None
"""`Finding.passed`, `Finding.summary` and, where it depends on what is checked, `Finding.rule`; None for no finding."""
Look = Callable[[Subject], Result]


class Checks(Generic[Subject]):
    """The checks of one kind, in the order in which they are declared: each a function of a subject.

    Args:
        kind: Class of what is checked.
        public: Name by which authors import that class.
        subject: Makes the subject of the object, the function that made it and options; or a finding, where it cannot
            be checked at all.
        slow: Findings of a subject so slow that nothing else of it is checked, given the names of all checks.
    """

    def __init__(
        self,
        kind: type[Any],
        public: str,
        subject: Callable[..., Subject | Finding],
        slow: Callable[[Subject, list[str]], list[Finding]] = lambda subject, names: [],
    ) -> None:
        self._kind, self._public, self._subject, self._slow = kind, public, subject, slow
        self._checks: list[tuple[str, str, Look[Subject]]] = []

    def __call__(self, name: str, rule: str = "") -> Callable[[Look[Subject]], Look[Subject]]:
        """Declare a check."""

        def declare(look: Look[Subject]) -> Look[Subject]:
            self._checks.append((name, rule, look))
            return look

        return declare

    def run(self, make: Callable[[], Any], tell: Callable[[Finding], None] = ignore, **options: Any) -> list[Finding]:
        """All findings, each told as soon as it is known; what was made is closed at the end."""
        findings: list[Finding] = []
        for finding in self._findings(make, options):
            findings.append(finding)
            tell(finding)
        return findings

    def _findings(self, make: Callable[[], Any], options: Mapping[str, Any]) -> Iterator[Finding]:
        try:
            made: Any = make()
        except ForetouchError:
            raise  # its message states what is missing
        except Exception as error:
            yield Finding("made", False, f"raises {type(error).__name__}: {error}", "it can be made")
            return
        if isinstance(made, SpatialDevice | SpatialRobot):
            yield Finding("made", None, f"a {type(made).__name__}", "these checks are of what moves along one axis")
            return
        if not isinstance(made, self._kind):
            yield Finding("made", False, f"a {type(made).__name__}", f"it is a {self._public}")
            return
        subject = self._subject(made, make, **options)
        if isinstance(subject, Finding):
            yield subject
            return
        try:
            if slow := self._slow(subject, [name for name, _, _ in self._checks]):
                yield from slow
                return
            for name, rule, look in self._checks:
                try:
                    result = look(subject)
                except Exception as error:
                    text = " ".join(f"{type(error).__name__}: {error}".split())
                    result = (False, f"raises {text}", "nothing raises while a session runs")
                if result is not None:
                    yield Finding(name, *result) if len(result) == 3 else Finding(name, *result, rule)
        finally:
            with contextlib.suppress(Exception):  # what it raises has been found; some have nothing to close
                made.close()


def name_result(own: object, name: str, more: str = "") -> tuple[bool, str, str]:
    """Whether a name is a text, and the one that is asked for, if any."""
    kept = isinstance(own, str) and bool(own) and (not name or own == name)
    return kept, f"name = {own!r}", (f"name is {name!r}" if name else "name is a text") + more


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
    text = f"{1e3 * median:.4g} ms at the median of {len(taken)}, {median / limit:.0f} times as long"
    why = f"not looked at, for a call takes {1e3 * median:.4g} ms"
    return [Finding(check, False, text, rule), *(Finding(name, None, why, "mend the time first") for name in others)]


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

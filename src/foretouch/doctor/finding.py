"""What one check found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

__all__ = ["Finding", "Verdict", "worst"]


class Verdict(StrEnum):
    """How it stands, from the best to the worst; a check that cannot be made here says why, and nothing else."""

    GOOD = "good"
    UNKNOWN = "not checked"
    WARNING = "warning"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the examination.

    Attributes:
        name: Of what was looked at.
        verdict: How it stands.
        found: What was found, for people, in one line.
        mend: The one command that mends it, "" where there is nothing to mend or no command would.
        figures: The same for programs, SI units; times end with ``_s``.
    """

    name: str
    verdict: Verdict
    found: str
    mend: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict)

    def as_row(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "verdict": self.verdict.value,
            "found": self.found,
            "mend": self.mend,
            "figures": dict(self.figures),
        }


def worst(findings: Iterable[Finding]) -> Verdict:
    """The worst verdict of all; good where there is none, and what could not be checked counts as good."""
    order = list(Verdict)
    found = max((order.index(finding.verdict) for finding in findings), default=0)
    return Verdict.GOOD if order[found] is Verdict.UNKNOWN else order[found]

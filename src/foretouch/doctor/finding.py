"""What one check found, and the findings as a table for people: the verdict is a word; colour only helps to find it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table


class Verdict(StrEnum):
    """The outcome of a check, from the best to the worst; a check that cannot be made here gives its reason only."""

    GOOD = "good"
    UNKNOWN = "not checked"
    WARNING = "warning"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the examination.

    Attributes:
        name: Name of what was examined.
        verdict: Outcome of the check.
        summary: The result, for people, in one line.
        mend: The one command that mends it, "" where there is nothing to mend or no command would.
        figures: The same for programs, SI units; times end with ``_s``.
    """

    name: str
    verdict: Verdict
    summary: str
    mend: str = ""
    figures: Mapping[str, Any] = field(default_factory=dict)

    def as_row(self) -> dict[str, Any]:
        """The finding as a row of JSON."""
        return asdict(self)


def percentile(values: Sequence[float], fraction: float) -> float:
    """The least of some values that this fraction of them does not exceed; NaN where there are none."""
    return sorted(values)[math.ceil(fraction * (len(values) - 1))] if values else math.nan


def worst(findings: Iterable[Finding]) -> Verdict:
    """The worst verdict of all; good where there is none, and what could not be checked counts as good."""
    found = max((finding.verdict for finding in findings), key=list(Verdict).index, default=Verdict.GOOD)
    return Verdict.GOOD if found is Verdict.UNKNOWN else found


STYLES = {
    Verdict.GOOD: "#56b4e9",
    Verdict.UNKNOWN: "dim",
    Verdict.WARNING: "bold #e69f00",
    Verdict.BAD: "bold #d55e00",
}
"""Colours of Okabe and Ito, which red-green colour-blind readers distinguish too."""


def render_findings(findings: Iterable[Finding]) -> Table:
    """A table of three columns; what mends a finding stands below it, behind an arrow."""
    from rich.box import SIMPLE
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE, pad_edge=False, title=None)
    table.add_column("verdict", no_wrap=True)
    table.add_column("what", no_wrap=False, min_width=8, max_width=22, overflow="fold")
    table.add_column("result, and the command that helps", overflow="fold")
    for finding in findings:
        text = Text(finding.summary)
        if finding.mend:
            text.append(f"\n→ {finding.mend}", style="bold")
        table.add_row(Text(finding.verdict.value, style=STYLES[finding.verdict]), finding.name, text)
    return table

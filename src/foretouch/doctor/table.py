"""The findings as a table for people: the verdict is a word; colour only helps to find it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from foretouch.doctor.finding import Finding, Verdict

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["STYLES", "render_findings"]

STYLES = {
    Verdict.GOOD: "#56b4e9",
    Verdict.UNKNOWN: "dim",
    Verdict.WARNING: "bold #e69f00",
    Verdict.BAD: "bold #d55e00",
}
"""Colours of Okabe and Ito, which those who do not tell red from green tell apart too."""


def render_findings(findings: Iterable[Finding]) -> Table:
    """A table of three columns; what mends a finding stands below it, behind an arrow."""
    from rich.box import SIMPLE
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE, pad_edge=False, title=None)
    table.add_column("verdict", no_wrap=True)
    table.add_column("what", no_wrap=False, min_width=8, max_width=22, overflow="fold")
    table.add_column("found, and the command that helps", overflow="fold")
    for finding in findings:
        said = Text(finding.found)
        if finding.mend:
            said.append(f"\n→ {finding.mend}", style="bold")
        table.add_row(Text(finding.verdict.value, style=STYLES[finding.verdict]), finding.name, said)
    return table

"""The report of a session as plain text, to be read at a glance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from foretouch.report.numbers import Finding
from foretouch.report.scene.section import SCENE
from foretouch.report.sections.energy import ENERGY
from foretouch.report.sections.forces import FORCES
from foretouch.report.sections.hand import HAND
from foretouch.report.sections.model import MODEL
from foretouch.report.sections.robot import LOOPS, ROBOT
from foretouch.report.sections.safety import SAFETY
from foretouch.report.sections.session import SESSION, heading

SECTIONS = (SESSION, FORCES, ENERGY, HAND, SCENE, SAFETY, MODEL, ROBOT, LOOPS)
"""In the order in which they are written and drawn."""

URGENT_FIRST = (SESSION, SAFETY, LOOPS, ENERGY, HAND, SCENE, FORCES, ROBOT, MODEL)
"""In the order of what they have to tell: what is worst comes first."""


def render_text(report: Mapping[str, Any]) -> str:
    """The report of a session for a terminal.

    Args:
        report: What `session_figures` gave.

    Returns:
        Lines of at most about 100 characters, without a last line break.
    """
    blocks = (line for section in SECTIONS for line in section.lines(report))
    return "\n".join([*heading(report), *(finding.text for finding in findings(report)), "", *blocks])


def findings(report: Mapping[str, Any]) -> list[Finding]:
    """What the numbers of a session say, one plain sentence each; what is worst comes first."""
    return [finding for section in URGENT_FIRST for finding in section.findings(report)]

"""The report of a session as text, and as an object whose attributes an editor completes and a checker knows."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, NoReturn

from foretouch.messages import SessionLog
from foretouch.quantities import brief_text
from foretouch.report.numbers import Finding
from foretouch.report.sections import sections_of
from foretouch.report.sections.energy import ENERGY
from foretouch.report.sections.forces import FORCES, LOOP
from foretouch.report.sections.hand import HAND
from foretouch.report.sections.heard import HEARD
from foretouch.report.sections.latency import LATENCY
from foretouch.report.sections.model import MODEL
from foretouch.report.sections.robot import LOOPS, ROBOT, TRACKING
from foretouch.report.sections.safety import SAFETY
from foretouch.report.sections.scene import SCENE
from foretouch.report.sections.session import SESSION, heading
from foretouch.report.session import session_figures

SECTIONS = (SESSION, FORCES, LOOP, ENERGY, HAND, SCENE, SAFETY, MODEL, ROBOT, TRACKING, LATENCY, HEARD, LOOPS)
"""In the order in which they are written and drawn."""

URGENT_FIRST = (SESSION, SAFETY, LOOPS, ENERGY, HAND, SCENE, FORCES, LATENCY, HEARD, ROBOT, MODEL)
"""In the order of what they have to tell: what is worst comes first."""


def render_text(report: Mapping[str, Any]) -> str:
    """The report of `session_figures`: lines of at most about 100 characters, without a last line break."""
    blocks = (line for section in sections_of(report, SECTIONS) for line in section.lines(report))
    return "\n".join([*heading(report), *(finding.text for finding in findings(report)), "", *blocks])


def findings(report: Mapping[str, Any]) -> list[Finding]:
    """Findings of a session, one plain sentence each; the worst come first."""
    return [finding for section in sections_of(report, URGENT_FIRST) for finding in section.findings(report)]


class Figures:
    """Figures by name, read as attributes and never written; groups of figures are `Figures` again."""

    def __init__(self, figures: dict[str, Any]) -> None:
        vars(self)["_figures"] = figures

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError("the figures of a report are read only", name=name, obj=self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Figures) and self._figures == other._figures

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._figures:
            raise AttributeError(f"no figure {name!r}", name=name, obj=self)
        value = self._figures[name]
        return Figures(value) if isinstance(value, dict) and name not in BY_NAME else value

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._figures]

    def __repr__(self) -> str:
        return brief_text(type(self).__name__, self._figures.items())

    def to_dict(self) -> dict[str, Any]:
        """A copy as plain numbers, texts, lists, dictionaries and None, as ``--json`` prints it."""
        return copy.deepcopy(self._figures)


BY_NAME = ("parameters", "standard_errors", "settings", "counts")
"""Groups whose names are data, and which are dictionaries therefore."""


class SessionReport(Figures):
    """What `foretouch.report.session_figures` finds, which says what each figure is; printed, it is a text for people.

    ``report.hand.peak_force_hand_N`` is a figure of a group. One that could not be measured is None.
    """

    status: str
    recording: str | None
    segments: Figures
    safety: Figures
    duration_s: float
    samples: int
    scored_samples: int
    guarded_samples: int
    away_samples: int
    faulty_samples: int
    nowhere_samples: int
    score_from_s: float
    score_to_s: float | None
    contact_force_rms_N: float | None
    prediction_rmse_N: float | None
    prediction_error_percent: float | None
    delayed_force_rmse_N: float | None
    delayed_force_error_percent: float | None
    rendered_rmse_N: float | None
    rendered_error_percent: float | None
    within_jnd_percent: float | None
    rendered_within_jnd_percent: float | None
    phantom_force_rms_N: float | None
    rendered_phantom_force_rms_N: float | None
    missed_contact_percent: float | None
    largest_model_jump_N: float | None
    largest_model_jump_N_per_s: float | None
    largest_model_jump_at_s: float | None
    largest_update_jump_N: float | None
    largest_update_jump_N_per_s: float | None
    largest_update_jump_at_s: float | None
    largest_rendered_update_jump_N: float | None
    largest_rendered_update_jump_N_per_s: float | None
    largest_rendered_update_jump_at_s: float | None
    time_to_ten_percent_s: float | None
    equal_position: Figures
    exact_force: Figures
    stable: bool | None
    net_energy_J: float | None
    energy_bound_J: float | None
    energy_margin_J: float | None
    energy_used_percent: float | None
    late_energy_J: float | None
    net_energy_exact_J: float | None
    guarded_contacts: int
    guarded_s: float
    engaged_percent: float | None
    hand: Figures
    max_rendered_force_N: float | None
    largest_rendered_jump_N: float | None
    max_follower_force_N: float | None
    clipped_ticks: int
    clipped: Figures
    tracking_error: Figures
    latency: Figures
    heard: Figures
    commands: Figures
    parameters: dict[str, float | None] | None
    standard_errors: dict[str, float | None] | None
    map: Figures | None
    models: Figures
    model_bytes: Figures
    standard_deviation: Figures
    messages: Figures
    counts: dict[str, int]
    timing: Figures
    operator: str | None
    loop: str
    baseline: str
    settings: dict[str, str]
    scene: Figures

    def __str__(self) -> str:
        return render_text(self._figures)


def session_report(log: SessionLog, *, score_from: float = 1.5, score_to: float | None = None) -> SessionReport:
    """The figures of a session, as attributes of one object.

    Args:
        log: The recorded session.
        score_from: Start of the scoring window [s] after the first row.
        score_to: Its end [s]; None for the last row.

    Raises:
        SettingError: A window that ends before it begins.
        ArgumentTypeError: No log.
    """
    return SessionReport(session_figures(log, score_from=score_from, score_to=score_to))

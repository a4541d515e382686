"""That a hand was not given the model's force, how long and why; and that this was worse than a delayed force."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from report_sessions import make_session

from foretouch.messages import SessionLog
from foretouch.rendering.withheld import OWED, UNPAID
from foretouch.report import render_text, session_report
from foretouch.report.withheld import withheld_figures
from foretouch.report.writing.text import scoring_findings


def without_force(log: SessionLog, begin: int, end: int, energy: float = -1e-3, **settings: str) -> SessionLog:
    """The same with a hand that is given nothing in these ticks."""
    leader = log.leader.copy()
    leader["rendered_force"] = leader["predicted_force"]
    leader["hand_position"] = leader["position"]
    leader["energy"][begin:end], leader["rendered_force"][begin:end] = energy, 0.0
    return replace(log, leader=leader, settings=log.settings | {"grip": "normal"} | settings)


def test_withheld_force_is_told_with_share_stretch_and_reason() -> None:
    log = without_force(make_session(), 500, 3500)
    report = session_report(log)
    hand, felt = report["hand"], np.flatnonzero(log.leader["predicted_force"] >= 0.5)
    inside = felt[(felt >= 500) & (felt < 3500)]
    assert hand["withheld_percent"] == pytest.approx(100.0 * inside.size / felt.size)
    assert hand["longest_withheld_s"] == pytest.approx(1e-3 * (inside[-1] - inside[0]))
    assert hand["longest_withheld_at_s"] == pytest.approx(1e-3 * inside[0])
    assert hand["withheld_because"] == OWED
    said = render_text(report)
    assert "% of contact the force was withheld: the hand was given less than half of the model's. At longest" in said
    assert OWED in said
    assert "  withheld   in " in said


def test_what_is_not_paid_for_has_another_reason() -> None:
    log = without_force(make_session(), 500, 3500, energy=1e-6)
    assert withheld_figures(log.leader, 1.0)["withheld_because"] == UNPAID


def test_a_short_cut_is_not_withheld() -> None:
    log = make_session()
    first = int(np.flatnonzero(log.leader["predicted_force"] >= 0.5)[0])
    report = session_report(without_force(log, first, first + 400))
    assert report["hand"]["withheld_percent"] == 0.0
    assert report["hand"]["longest_withheld_s"] is None
    assert "was withheld" not in render_text(report)


@pytest.mark.parametrize("settings", [{"grip": "none"}, {"baseline": "delayed"}])
def test_where_no_hand_feels_a_model_nothing_is_withheld(settings: dict[str, str]) -> None:
    assert session_report(without_force(make_session(), 500, 3500, **settings))["hand"]["withheld_percent"] is None


@pytest.mark.parametrize(("rendered", "said"), [(76.4, True), (63.9, False), (12.0, False)])
def test_a_rendered_force_that_is_worse_than_the_delayed_one_is_said_to_be(rendered: float, said: bool) -> None:
    figures: dict[str, Any] = {
        "status": "ok",
        "prediction_error_percent": 4.5,
        "rendered_error_percent": rendered,
        "delayed_force_error_percent": 63.8,
        "rendered_within_jnd_percent": 68.0,
        "within_jnd_percent": 92.0,
        "missed_contact_percent": 0.0,
    }
    found = [finding for finding in scoring_findings(figures) if "rendered force is worse" in finding.text]
    assert len(found) == said
    assert not any(finding.good for finding in found)

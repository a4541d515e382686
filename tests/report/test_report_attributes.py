"""The report of a session as an object: every figure is an attribute, declared, completed, and no other."""

from __future__ import annotations

import copy
import pickle
from typing import get_type_hints

import pytest
from report_sessions import make_session

import foretouch
from foretouch.report import Figures, SessionReport, render_text, session_figures, session_report


@pytest.fixture(scope="module")
def log() -> foretouch.SessionLog:
    return make_session(2.5)


def test_its_attributes_are_the_figures(log: foretouch.SessionLog) -> None:
    report, figures = session_report(log), session_figures(log)
    assert report.to_dict() == figures
    assert report == session_report(log)
    for name, value in figures.items():
        result = getattr(report, name)
        assert (result.to_dict() if isinstance(result, Figures) else result) == value
    assert report.timing.leader.period_ms.p50 == figures["timing"]["leader"]["period_ms"]["p50"]
    assert report.settings["material"] == figures["settings"]["material"]
    assert str(report) == render_text(figures)
    assert len(repr(report).splitlines()) <= 10


@pytest.mark.long
def test_what_is_declared_is_there_and_what_is_there_is_declared() -> None:
    declared = set(get_type_hints(SessionReport))
    line = foretouch.session_report(foretouch.simulate(foretouch.SessionSettings(), duration=2.0).log)
    assert set(line.to_dict()) == declared - {"scene"}
    assert set(line.to_dict()) <= set(dir(line))
    assert {"p50", "p99", "max"} <= set(dir(line.timing.leader.period_ms))
    settings = foretouch.SessionSettings(scene="plane", material="hunt-crossley")
    scene = foretouch.session_report(foretouch.simulate(settings, duration=2.0).log)
    assert set(scene.to_dict()) == declared
    groups = {name for name, value in scene.to_dict().items() if isinstance(getattr(scene, name), Figures)}
    hints = get_type_hints(SessionReport)
    assert {name for name in declared if "Figures" in str(hints[name])} - groups <= {"map"}
    assert all("Figures" in str(hints[name]) for name in groups)


def test_it_is_read_only_and_survives_copies(log: foretouch.SessionLog) -> None:
    report = session_report(log)
    with pytest.raises(AttributeError, match="read only"):
        report.status = "good"
    report.to_dict()["hand"]["grip"] = "changed"
    assert report.hand.grip != "changed"
    assert copy.deepcopy(report) == report
    assert pickle.loads(pickle.dumps(report)) == report
    with pytest.raises(AttributeError, match="no figure 'stabel'"):
        _ = report.stabel
    with pytest.raises(AttributeError, match="no figure 'scene'"):
        _ = report.scene

"""The report of a session, against sessions whose every number is known."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from report_sessions import MATERIAL, make_session

from foretouch.messages import FOLLOWER_DTYPE, LEADER_DTYPE, SessionLog
from foretouch.report import STATUSES, force_at_follower, pair, render_text, session_figures
from foretouch.report.numbers import figure
from foretouch.report.sections.forces import scoring_findings

KEYS = {
    "contact_force_rms_N",
    "prediction_rmse_N",
    "prediction_error_percent",
    "delayed_force_error_percent",
    "rendered_error_percent",
    "within_jnd_percent",
    "phantom_force_rms_N",
    "max_rendered_force_N",
    "max_follower_force_N",
    "clipped_ticks",
    "messages",
    "recording",
    "status",
    "timing",
}
EMPTY = SessionLog(np.zeros(0, LEADER_DTYPE), np.zeros(0, FOLLOWER_DTYPE), ())


@pytest.fixture(scope="module")
def perfect() -> SessionLog:
    return make_session()


def test_a_right_model_predicts_the_force(perfect: SessionLog) -> None:
    report = session_figures(perfect, recording="session.mcap")
    assert set(report) >= KEYS
    assert report["status"] == "ok"
    assert report["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["rendered_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["exact_force"]["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["equal_position"]["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["within_jnd_percent"] == 100.0
    assert report["phantom_force_rms_N"] < 0.05 * perfect.follower["exact_force"].max()  # below the threshold
    assert report["missed_contact_percent"] == 0.0
    assert report["delayed_force_error_percent"] > 50.0
    assert report["clipped_ticks"] == 0
    assert report["commands"] == {"sent": 4000, "applied": 3920, "never_applied": 80}
    assert report["samples"] == 3920
    assert report["messages"]["lost"] == 5
    assert report["messages"]["late"] is None
    assert report["messages"]["sent"] == 8000 + 200
    assert report["models"] == {"sent": 200, "valid": 200, "used": 185}
    assert report["recording"] == "session.mcap"
    assert "open loop" in report["loop"]


def test_true_force_is_the_sensor_less_its_zero(perfect: SessionLog) -> None:
    report = session_figures(perfect)
    force = perfect.follower["exact_force"]
    assert report["max_follower_force_N"] == pytest.approx(force.max())
    rows = pair(perfect)
    exact = rows.follower["exact_force"][rows.time >= 1.5 - 1e-9]
    threshold = max(0.05, 0.05 * np.percentile(exact, 98))
    assert report["contact_force_rms_N"] == pytest.approx(np.sqrt(np.mean(exact[exact > threshold] ** 2)), rel=1e-3)


def test_delayed_force_is_what_had_arrived_when_the_command_was_sent(perfect: SessionLog) -> None:
    """At equal command it is one whole round trip old: 380 ticks on this link."""
    rows = pair(perfect)
    force = rows.follower["exact_force"]
    known = rows.leader["delayed_force"]
    np.testing.assert_allclose(known[1000:], force[1000 - 380 : -380], atol=1e-12)


@pytest.mark.parametrize("factor", [1.1, 0.9])
def test_a_model_wrong_by_ten_percent_is_wrong_by_ten_percent(factor: float) -> None:
    report = session_figures(make_session(stiffness=factor))
    assert report["prediction_error_percent"] == pytest.approx(10.0, abs=0.05)
    assert report["prediction_rmse_N"] == pytest.approx(0.1 * report["contact_force_rms_N"], rel=0.01)
    assert report["equal_position"]["prediction_error_percent"] == pytest.approx(10.0, abs=0.05)


def test_the_error_at_equal_position_leaves_the_robot_out() -> None:
    lagging = session_figures(make_session(lag=12))
    assert lagging["prediction_error_percent"] > 5.0
    assert lagging["equal_position"]["prediction_error_percent"] == pytest.approx(0.0, abs=0.1)
    tracking = lagging["tracking_error"]
    assert tracking["lag_ms"] == pytest.approx(12.0, abs=0.05)
    speed = 0.010 * 4 * np.pi  # of the hand, largest [m/s]
    assert tracking["rms_mm"] == pytest.approx(12.0 * speed / np.sqrt(2), rel=0.01)
    assert tracking["max_mm"] == pytest.approx(12.0 * speed, rel=0.01)


def test_force_at_follower_is_the_model_at_its_own_motion(perfect: SessionLog) -> None:
    rows = pair(perfect)
    late = rows.leader["model_sequence"] > 0
    forces = force_at_follower(perfect, rows)
    depth, velocity = rows.follower["position"][late], rows.follower["velocity"][late]
    by_hand = np.maximum(depth, 0.0) ** MATERIAL.exponent * (MATERIAL.stiffness + MATERIAL.damping * velocity)
    np.testing.assert_allclose(forces[late], np.maximum(by_hand, 0.0), rtol=1e-9, atol=1e-12)
    assert not forces[~late].any()


def test_clamps_count_and_show_in_the_rendered_error() -> None:
    log = make_session(limit=2.0)
    report = session_figures(log)
    assert report["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["rendered_error_percent"] > 20.0
    assert report["max_rendered_force_N"] == 2.0
    assert report["clipped_ticks"] == report["clipped"]["leader"] == int((log.leader["predicted_force"] > 2.0).sum())
    steps = np.abs(np.diff(log.leader["rendered_force"]))
    assert report["largest_rendered_jump_N"] == pytest.approx(steps.max())


def test_timing_by_hand(perfect: SessionLog) -> None:
    leader = perfect.leader.copy()
    leader["period_ns"][100] = 7_000_000
    timing = session_figures(replace(perfect, leader=leader))["timing"]
    assert timing["leader"]["period_ms"] == {"p50": 1.0, "p99": 1.0, "max": 7.0}
    assert timing["leader"]["late_ticks"] == 1
    assert timing["follower"]["late_ticks"] == 0
    assert timing["follower"]["compute_us"]["max"] == pytest.approx(229.0)
    assert timing["follower"]["compute_us"]["p50"] == pytest.approx(204.5, abs=1.0)


def test_the_window() -> None:
    log = make_session(2.0)
    leader = log.leader.copy()
    leader["predicted_force"][:500] = 100.0
    bad = replace(log, leader=leader)
    assert session_figures(bad, score_from=0.6)["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert session_figures(bad, score_from=0.4)["prediction_error_percent"] > 500.0
    assert session_figures(bad, score_from=0.6, score_to=0.7)["scored_samples"] <= 101


@pytest.mark.parametrize(
    ("chosen", "status"),
    [
        (None, "nothing_to_score"),
        ({"duration": 0.05}, "nothing_to_score"),
        ({"duration": 0.2}, "nothing_to_score"),
        ({"duration": 2.5, "touching": False}, "no_contact"),
        ({"duration": 2.5, "models": False}, "ok"),
        ({"duration": 2.5, "valid": False}, "ok"),
        ({"duration": 2.5, "exact": False}, "ok"),
    ],
    ids=["empty", "nothing applied", "short", "no contact", "no models", "no valid model", "a robot"],
)
def test_odd_sessions_have_a_report(chosen: dict[str, Any] | None, status: str) -> None:
    report = session_figures(EMPTY if chosen is None else make_session(**chosen))
    assert report["status"] == status
    assert status in STATUSES
    text = json.dumps(report, allow_nan=False)
    assert set(json.loads(text)) >= KEYS
    assert render_text(report)


def test_no_model_misses_all_contact_and_says_so() -> None:
    for log in (make_session(2.5, models=False), make_session(2.5, valid=False)):
        report = session_figures(log)
        assert report["prediction_error_percent"] == pytest.approx(100.0, abs=0.1)
        assert report["missed_contact_percent"] == 100.0
        assert "No valid contact model" in render_text(report)


def test_a_robot_has_no_exact_force() -> None:
    report = session_figures(make_session(2.5, exact=False))
    assert report["exact_force"]["prediction_error_percent"] is None
    assert report["max_follower_force_N"] > 1.0


def test_a_prediction_that_is_not_finite(perfect: SessionLog) -> None:
    leader = perfect.leader.copy()
    leader["predicted_force"][2000] = np.nan
    report = session_figures(replace(perfect, leader=leader))
    assert report["status"] == "prediction_not_finite"
    assert report["prediction_error_percent"] is None
    json.dumps(report, allow_nan=False)


def test_ticks_without_a_force_are_left_out(perfect: SessionLog) -> None:
    follower = perfect.follower.copy()
    follower["sensor_force"][3000:3010] = np.nan
    assert session_figures(replace(perfect, follower=follower))["samples"] == 3910


def test_text_says_the_bad_news_first() -> None:
    report = session_figures(make_session(3.0, stiffness=20.0, noise=0.02))
    text = render_text(report)
    ratio = report["prediction_error_percent"] / report["delayed_force_error_percent"]
    assert f"worse than the delayed force (error x {ratio:.1f})" in text
    assert "wrong by more than the force itself" in text
    assert text.index("worse than") < text.index("Forces at equal command")
    good = render_text(session_figures(make_session(3.0)))
    assert "better than the delayed force" in good
    assert max(map(len, good.splitlines())) <= 110


@pytest.mark.parametrize(
    ("error", "word"), [(99.4, "better"), (99.6, "no better"), (100.4, "no better"), (100.6, "worse")]
)
def test_what_is_the_same_is_no_better(error: float, word: str) -> None:
    figures = {"status": "ok", "within_jnd_percent": None, "missed_contact_percent": None}
    findings = scoring_findings(figures | {"prediction_error_percent": error, "delayed_force_error_percent": 100.0})[0]
    assert findings.text.startswith(f"The predicted force is {word} than the delayed force (error x ")
    assert findings.good is (word == "better")


def test_figures_as_people_read_them() -> None:
    shown = [figure(value) for value in (0.0, -0.0, -3e-5, 0.0512, -0.5, 12.34, -1234.6, 3e6)]
    assert shown == ["0.00", "0.00", "0.00", "0.051", "-0.50", "12.3", "-1,235", "3.00e+06"]


def test_same_log_same_report(perfect: SessionLog) -> None:
    assert json.dumps(session_figures(perfect)) == json.dumps(session_figures(perfect))

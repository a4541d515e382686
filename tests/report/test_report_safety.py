"""What the robot did beside following, and which of it is scored: against sessions whose every number is known."""

from __future__ import annotations

import json
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from report_sessions import make_session

from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import STATUS_SENTENCES, VERSION, EmergencyStop, SessionLog, Status
from foretouch.recordings import follower_samples
from foretouch.report import left_out, pair, render_text, session_figures, write_page
from foretouch.report.drawing import thinned
from foretouch.report.energy import energy_account
from foretouch.report.rows import follower_away, trusted

TITLE = "What the robot did beside following"


@pytest.fixture(scope="module")
def quiet() -> SessionLog:
    return make_session(4.0, noise=0.01)


def with_status(log: SessionLog, *segments: tuple[int, int, Status]) -> SessionLog:
    """The same, the follower's ticks of these ranges having another status."""
    follower = log.follower.copy()
    for begin, end, status in segments:
        follower["status"][begin:end] = status
    return replace(log, follower=follower)


def with_fault(log: SessionLog, begin: int, end: int, state: SensorState, force: float) -> SessionLog:
    follower = log.follower.copy()
    follower["validity"][begin:end] = state
    follower["status"][begin:end] = Status.SENSOR_FAULT
    follower["sensor_force"][begin:end] = force
    return replace(log, follower=follower)


def test_a_session_in_which_nothing_happened_says_nothing(quiet: SessionLog) -> None:
    report = session_figures(with_status(quiet, (0, 80, Status.UNLOADING), (80, 82, Status.RETURNING)))
    assert report["safety"] == {
        "statuses": {},
        "sensor_faults": {},
        "refused_commands": {},
        "control": [],
        "contests": [],
        "emergency_stops": [],
        "step_failures": 0,
    }
    assert report["away_samples"] == report["faulty_samples"] == 0
    assert report["segments"]["count"] == 1
    assert TITLE not in render_text(report)
    assert render_text(report) == render_text(session_figures(quiet))
    assert left_out(follower_samples(quiet)) == []


def test_times_and_seconds_of_what_the_robot_did(quiet: SessionLog) -> None:
    log = with_status(
        quiet,
        (80, 300, Status.RETURNING),  # not done in a moment
        (1000, 1200, Status.HOLDING),
        (1250, 1300, Status.HOLDING),  # 50 ms later: the same time
        (2000, 2100, Status.HOLDING),
        (2100, 2500, Status.UNLOADING),
        (3000, 3100, Status.SHADOW),
    )
    report = session_figures(log)
    statuses = report["safety"]["statuses"]
    assert set(statuses) == {"returning", "holding", "unloading"}
    assert statuses["holding"]["times"] == 2
    assert statuses["holding"]["seconds"] == pytest.approx(0.35)
    assert statuses["unloading"] == {
        "times": 1,
        "seconds": pytest.approx(0.4),
        "sentence": STATUS_SENTENCES[Status.UNLOADING],
    }
    assert statuses["returning"]["seconds"] == pytest.approx(0.22)
    text = render_text(report)
    assert TITLE in text
    assert f"holding    2 times, 0.35 s: {STATUS_SENTENCES[Status.HOLDING]}" in text
    json.dumps(report, allow_nan=False)


@pytest.mark.parametrize("status", list(Status))
def test_only_where_the_robot_is_with_the_commands_is_scored(quiet: SessionLog, status: Status) -> None:
    leader = quiet.leader.copy()
    leader["predicted_force"][2000:2500] += 30.0
    log = with_status(replace(quiet, leader=leader), (2080, 2580, status))
    error = session_figures(log)["prediction_error_percent"]
    if status in (Status.FOLLOWING, Status.SHADOW):
        assert error > 200.0
    elif status is not Status.GUARDED:  # which its own flag tells
        assert error < 1.0


def test_a_failing_sensor_is_left_out_with_the_moment_before_it_was_found(quiet: SessionLog) -> None:
    log = with_fault(quiet, 2500, 3000, SensorState.SPIKE, -20.0)
    follower = log.follower.copy()
    follower["sensor_force"][2499] = -20.0  # the first spike is seen one sample late
    log = replace(log, follower=follower)
    report = session_figures(log)
    assert report["faulty_samples"] == 500
    assert report["samples"] == session_figures(quiet)["samples"] - 600
    assert report["prediction_error_percent"] == pytest.approx(
        session_figures(quiet)["prediction_error_percent"], abs=0.2
    )
    times = pair(log).follower["sequence"]
    assert not ((times > 2400) & (times <= 3000)).any()
    fault = report["safety"]["sensor_faults"]["spike"]
    assert fault == {"times": 1, "seconds": pytest.approx(0.5), "sentence": SENSOR_SENTENCES[SensorState.SPIKE]}
    text = render_text(report)
    assert f"Faulty sensors for 0.50 s: {fault['sentence']}." in text
    assert "500 with sensors not to be trusted" in text
    assert "sensor fault" not in text  # its kind says it
    assert left_out(follower_samples(log)) == ["500 samples were left out: the sensors were not to be trusted (spike)"]


@pytest.mark.parametrize("force", [float("nan"), float("inf"), 50.0])
def test_whatever_a_failing_sensor_shows_there_is_a_report(quiet: SessionLog, force: float, tmp_path: Path) -> None:
    log = with_fault(quiet, 1500, 4000, SensorState.NOT_FINITE, force)
    report = session_figures(log)
    json.dumps(report, allow_nan=False)
    assert render_text(report)
    everything = with_fault(quiet, 0, 4000, SensorState.STUCK, force)
    assert session_figures(everything)["status"] == "nothing_to_score"
    assert "nothing_to_score" in render_text(session_figures(everything))


def test_two_faults_have_a_moment_each(quiet: SessionLog) -> None:
    log = with_fault(with_fault(quiet, 1000, 1100, SensorState.SPIKE, 9.0), 2000, 2100, SensorState.STUCK, 9.0)
    good = trusted(log.follower, log.follower)
    bad = np.flatnonzero(~good)
    assert bad.tolist() == [*range(900, 1100), *range(1900, 2100)]
    assert set(session_figures(log)["safety"]["sensor_faults"]) == {"spike", "stuck"}


def test_refusals_control_and_stops_are_said(quiet: SessionLog) -> None:
    counts = {"commands_stale": 12, "commands_overtaken": 0, "commands_future": 1, "commands_of_others": 2011}
    counts |= {"commands_before_release": 380, "step_failures": 1234}
    stop = EmergencyStop(VERSION, 1, 0, "somebody shouted at anna")
    log = replace(
        quiet,
        counts=counts,
        emergencies=(stop, msgspec.structs.replace(stop, sequence=2)),
        news={"control": ("anna", "bert"), "stopped": ("somebody shouted at anna", "asked for by signal")},
    )
    report = session_figures(log)
    assert report["safety"]["refused_commands"] == {
        "stale": 12,
        "future": 1,
        "of_others": 2011,
        "before_release": 380,
    }
    assert report["safety"]["emergency_stops"] == ["somebody shouted at anna", "asked for by signal"]
    text = render_text(report)
    assert "refused    commands: 12 stale, 1 from the future, 2,011 of others, 380 from before a release" in text
    assert "failures   1,234 exceptions in the follower's step" in text
    assert "control    was held by anna, then bert" in text
    assert text.count("Emergency stop: somebody shouted at anna; asked for by signal.") == 1
    assert text.index("Emergency stop") < text.index("Forces at equal command")


def twice(first: SessionLog, second: SessionLog) -> SessionLog:
    """Two sessions as one in which both sides began again."""
    parts: list[Any] = []
    for epoch, log in ((5, first), (9, second)):
        leader, follower = log.leader.copy(), log.follower.copy()
        leader["epoch"] = follower["epoch"] = epoch
        leader["run"] = follower["run"] = epoch + 100
        parts.append((leader, follower))
    leader, follower = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
    follower["time_ns"][first.follower.size :] += int(first.follower["time_ns"][-1])
    leader["time_ns"][first.leader.size :] += int(first.leader["time_ns"][-1])
    return SessionLog(leader, follower, (), first.settings, first.counts)


def test_a_stop_is_said_with_the_segment_in_which_it_was_pressed(quiet: SessionLog) -> None:
    """It lasts into the next one, of which the figures are, until somebody releases it."""
    short = make_session(2.0)
    log = twice(with_status(short, (1500, 2000, Status.STOPPED)), with_status(quiet, (0, 300, Status.STOPPED)))
    text = render_text(session_figures(replace(log, news={"stopped": ("pressed in the console",)})))
    assert "Emergency stop in segment 1, for 0.72 s: pressed in the console." in text


def test_many_stops_are_counted_at_the_top_with_how_long_they_lasted(quiet: SessionLog) -> None:
    """Each was pressed in the console, so there is one reason for all of them."""
    many = with_status(quiet, *((begin, begin + 200, Status.STOPPED) for begin in range(500, 3500, 500)))
    log = replace(twice(make_session(2.0), many), news={"stopped": ("pressed in the console",)})
    report = session_figures(log)
    assert report["safety"]["statuses"]["stopped"]["times"] == 6
    top = render_text(report).splitlines()[:6]
    assert "6 emergency stops in segment 2, for 1.20 s in all: pressed in the console." in top
    silent = session_figures(with_status(quiet, (500, 1500, Status.STOPPED)))
    assert "Emergency stop, for 1.00 s: no reason was given." in render_text(silent)


@pytest.mark.long
def test_the_first_line_has_the_length_of_the_whole_session(quiet: SessionLog, tmp_path: Path) -> None:
    log = twice(make_session(2.0), quiet)
    report = session_figures(log)
    assert report["segments"]["duration_s"] == pytest.approx(6.08, abs=0.01)
    text = "6.1 s in 2 segments, of which the longest: 4.0 s, "
    assert render_text(report).startswith(f"Session: {text}material")
    assert text in write_page(tmp_path, log, report).read_text()
    assert render_text(session_figures(quiet)).startswith("Session: 4.0 s, material")


def test_figures_are_of_the_longest_segment_and_it_is_said(quiet: SessionLog) -> None:
    short = make_session(2.0, stiffness=20.0)
    log = twice(short, quiet)
    report, alone = session_figures(log), session_figures(replace(quiet, models=()))
    for name in ("samples", "prediction_error_percent", "duration_s", "net_energy_J", "commands", "tracking_error"):
        assert report[name] == alone[name]
    assert report["segments"]["leader_starts"] == report["segments"]["follower_starts"] == 2
    assert report["segments"]["max_rendered_force_N"] == pytest.approx(short.leader["rendered_force"].max())
    began = "The leader began 2 times, the follower 2 times"
    assert f"{began}; figures are of the longest segment (number 2), 4.00 s of 6.08 s." in render_text(report)
    assert left_out(follower_samples(log)) == [
        "the leader began 2 times, the follower 2 times; used is the longest segment, 4.00 s"
    ]
    assert "began" not in render_text(alone)


def test_a_process_keeps_an_account_of_energy_of_its_own(quiet: SessionLog) -> None:
    leader = np.concatenate([quiet.leader, quiet.leader])
    leader["epoch"][quiet.leader.size :] = 7
    leader["sequence"][quiet.leader.size :] += quiet.leader["sequence"][-1]  # even if the numbers went on
    leader["energy"][quiet.leader.size] = 0.25
    energy = energy_account(leader).energy
    assert energy[quiet.leader.size] == 0.25


def test_the_page_marks_what_was_not_following(quiet: SessionLog, tmp_path: Path, monkeypatch: Any) -> None:
    pytest.importorskip("matplotlib")

    log = with_fault(with_status(quiet, (1000, 1400, Status.HOLDING)), 3000, 3400, SensorState.SATURATED, 50.0)
    drawn: dict[str, Any] = {}

    def keep(figure: Any, caption: str) -> str:
        drawn[caption] = figure
        return caption

    monkeypatch.setattr("foretouch.report.writing.pages.embedded", keep)
    path = write_page(tmp_path, log, session_figures(log))
    assert escape(SENSOR_SENTENCES[SensorState.SATURATED]) in path.read_text()
    forces = next(figure for caption, figure in drawn.items() if caption.startswith("True, predicted"))
    labels = forces.axes[0].get_legend_handles_labels()[1]
    assert {"not following", "faulty sensors"} <= set(labels)
    spans = follower_away(log, int(pair(log).follower["time_ns"][0]))
    assert [(round(span.begin, 2), round(span.end, 2), span.failing) for span in spans] == [
        (0.92, 1.32, False),
        (2.92, 3.32, True),
    ]
    assert forces.axes[0].get_ylim()[1] < 30.0  # what a saturated sensor shows is no force


def test_no_line_is_drawn_over_a_gap() -> None:
    time = np.concatenate([np.arange(0.0, 1.0, 1e-3), np.arange(2.0, 3.0, 1e-3)])
    for buckets in (100, 5000):
        kept, values = thinned(time, np.ones(time.size), buckets)
        assert np.isnan(values).sum() == 1
        assert (np.diff(kept) >= 0.0).all()
        assert kept[np.isnan(values)] == pytest.approx(0.999)

"""Sessions whose material, grip or network changed: each part is reported with its own settings and figures."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from report_sessions import make_session

from foretouch.messages import (
    PROCESS,
    SINCE,
    VERSION,
    Hello,
    Hellos,
    LeaderState,
    Message,
    SessionLog,
    Status,
    Telemetry,
)
from foretouch.recordings import SessionWriter, read_session
from foretouch.report import render_text, session_figures
from foretouch.report.numbers import figure

MS = 1_000_000
SHORT, LONG = 3.0, 5.0


def as_process(log: SessionLog, epoch: int, run: int, since_ms: int) -> list[Message]:
    """The messages of a session of two processes that began so long after another."""
    messages: list[Message] = [LeaderState(VERSION, *row) for row in log.leader.tolist()]
    messages += [Telemetry(VERSION, *row) for row in log.follower.tolist()]
    return [
        msgspec.structs.replace(message, time_ns=message.time_ns + since_ms * MS, epoch=epoch, run=run)
        for message in (*messages, *log.models)
    ]


def hello(role: str, process: int, time_ns: int, **texts: str) -> Hello:
    return Hello.of(role, 1, time_ns, {PROCESS: str(process), **texts})


@pytest.fixture(scope="module")
def regripped(tmp_path_factory: pytest.TempPathFactory) -> SessionLog:
    """As a console does it: the leader begins again with a grip and another material, both sides with new processes."""
    first, second = make_session(LONG, stiffness=1.0), make_session(SHORT, stiffness=2.0)
    path = tmp_path_factory.mktemp("phases") / "grip.mcap"
    begun = round(LONG * 1000) + 2000
    with SessionWriter(path) as writer:
        numbered = [
            hello("follower", 105, 0, material="foam-measured", position_delay="0.08"),
            hello("leader", 5, 0, grip="none", operator="scripted", force_delay="0.3"),
            *as_process(first, 5, 105, 0),
            hello("follower", 109, 0, material="hunt-crossley", position_delay="0.08"),
            hello("leader", 9, 0, grip="normal", operator="scripted", force_delay="0.3"),
            *as_process(second, 9, 109, begun),
        ]
        for number, message in enumerate(numbered):
            writer.write(message, number)
    return read_session(path)


def test_each_segment_has_what_its_own_processes_said(regripped: SessionLog) -> None:
    settings = [(one.settings["grip"], one.settings["material"]) for one in regripped.segments()]
    assert settings == [("none", "foam-measured"), ("normal", "hunt-crossley")]
    assert regripped.settings["grip"] == "normal"  # as it was said last
    assert regripped.longest().settings["material"] == "foam-measured"


def test_the_report_is_about_its_segment_and_tells_of_each(regripped: SessionLog) -> None:
    report = session_figures(regripped)
    assert report["settings"]["grip"] == "none"
    assert report["settings"]["material"] == "foam-measured"
    assert report["prediction_error_percent"] < 1.0
    text = render_text(report)
    assert "Open loop" in text
    assert "Unstable" not in text
    assert "material foam-measured" in text.splitlines()[0]
    first, second = report["segments"]["each"]
    assert [first["reported"], second["reported"]] == [True, False]
    assert second["settings"]["material"] == "hunt-crossley"
    assert second["settings"]["grip"] == "normal"
    assert second["begin_s"] == pytest.approx(LONG + 2.0, abs=0.01)
    assert second["duration_s"] == pytest.approx(SHORT, abs=0.01)
    assert second["prediction_error_percent"] == pytest.approx(100.0, abs=3.0)  # twice as stiff
    assert first["prediction_error_percent"] == report["prediction_error_percent"]
    assert "material hunt-crossley, grip normal" in text


def test_a_network_that_changed_divides_a_segment(tmp_path: Path) -> None:
    log = make_session(6.0)
    path, changed = tmp_path / "delay.mcap", 2000
    led, followed = (int(rows["time_ns"][changed]) for rows in (log.leader, log.follower))
    with SessionWriter(path) as writer:
        numbered = [
            hello("follower", 105, 0, position_delay="0.08", material="hunt-crossley"),
            hello("leader", 5, 0, force_delay="0.3", grip="none"),
            *as_process(log, 5, 105, 0),
            hello(
                "follower",
                105,
                followed + 400 * MS,
                position_delay="0.5",
                material="hunt-crossley",
                **{SINCE: str(followed)},
            ),
            hello("leader", 5, led + 90 * MS, force_delay="0.6", grip="none", **{SINCE: str(led)}),
        ]
        for number, message in enumerate(numbered):
            writer.write(message, number)
    read = read_session(path)
    assert len(read.segments()) == 1
    before, after = read.phases()
    assert (before.settings["position_delay"], before.settings["force_delay"]) == ("0.08", "0.3")
    assert (after.settings["position_delay"], after.settings["force_delay"]) == ("0.5", "0.6")
    assert SINCE not in after.settings
    assert before.leader.size + after.leader.size == log.leader.size
    assert before.follower.size + after.follower.size == log.follower.size
    assert 2000 <= before.leader.size <= 2100  # both changed within a moment: one change, and after it all is settled
    assert after.follower["command_sequence"][0] == after.leader["sequence"][0]
    report = session_figures(read)
    assert report["settings"]["force_delay"] == "0.6"
    assert report["duration_s"] == pytest.approx(4.0, abs=0.1)
    assert report["prediction_error_percent"] < 1.0  # the models before the change are still known
    assert report["commands"]["never_applied"] == 80
    text = render_text(report)
    assert "position delay 0.5 s, force delay 0.6 s" in text.splitlines()[0]
    assert "settings changed 1 time; figures are of the longest segment (number 2)" in text
    low, high = sorted(one["rendered_error_percent"] for one in report["segments"]["each"])
    assert f"The rendered force was wrong by {figure(low)} to {figure(high)} %, by segment." in text
    assert [one["settings"]["force_delay"] for one in report["segments"]["each"]] == ["0.3", "0.6"]


def test_a_session_without_changes_has_one_phase() -> None:
    log = make_session(2.0)
    assert log.phases() == (log,)
    assert session_figures(log)["segments"]["each"] == []
    assert "each with its own settings" not in render_text(session_figures(log))


def test_who_delays_what_says_how_long() -> None:
    """Of two processes that were started by hand, each knows the delay of what it receives."""
    from foretouch.session import SessionSettings
    from foretouch.settings import LEADER_SETTINGS

    theirs, ours = SessionSettings(position_delay=0.05), SessionSettings(force_delay=0.0)
    hellos = Hellos()
    follower = {name: text for name, text in theirs.as_text().items() if name not in LEADER_SETTINGS}
    leader = {name: text for name, text in ours.as_text().items() if name in LEADER_SETTINGS}
    for role, process, texts in itertools.chain(*[(("leader", 5, leader), ("follower", 105, follower))] * 3):
        hellos.take(hello(role, process, 0, **texts))
    assert hellos.settings["force_delay"] == "0.0"
    assert hellos.settings["position_delay"] == "0.05"


def test_nobody_fills_the_memory_of_what_was_said() -> None:
    hellos = Hellos()
    for number in range(5000):
        hellos.take(hello("leader", number % 7, number, force_delay=str(number)))
        hellos.take(hello("recorder", number, number, recorder_failed=str(number)))
    assert len(hellos.reports) < 300
    assert hellos.reports[0].settings == {"force_delay": "0"}


@pytest.mark.parametrize("late", [1, 2, 150])
def test_one_stop_of_a_late_loop_is_one_stop(late: int) -> None:
    """Ticks that come late are fewer; the robot was stopped for as long."""
    log = make_session(4.0)
    follower = log.follower.copy()
    follower["status"][1000:3000] = Status.STOPPED
    kept = np.ones(follower.size, dtype=np.bool_)
    kept[1000:3000] = np.arange(2000) % late == 0
    log = replace(log, follower=follower[kept])
    stopped = session_figures(log)["safety"]["statuses"]["stopped"]
    assert stopped["times"] == 1
    assert stopped["seconds"] == pytest.approx(2.0, abs=1e-6)


def test_the_headline_is_what_the_hand_feels() -> None:
    """A limit of 2 N: the prediction is right, and what the hand is given is not."""
    report = session_figures(make_session(limit=2.0))
    text = render_text(report)
    rendered, delayed = report["rendered_error_percent"], report["delayed_force_error_percent"]
    assert f"The rendered force is wrong by {figure(rendered)} %, the predicted one by " in text
    assert f" %, the delayed one by {figure(delayed)} %." in text
    outside = 100.0 - report["rendered_within_jnd_percent"]
    assert f"An operator could feel that it is wrong in {outside:.1f} % of the contact time." in text
    assert text.index("The rendered force is wrong") < text.index("The predicted force is better")
    assert text.index("rendered (after") < text.index("predicted (newest")


def test_a_side_says_what_it_does_to_messages_and_since_when() -> None:
    from foretouch.link import FaultStage
    from foretouch.session import SessionSettings
    from foretouch.session.runners.live import fault_texts

    stage: FaultStage[Message] = FaultStage(SessionSettings(force_delay=0.3, loss=0.1).return_faults)
    before = fault_texts(stage, "force_delay", 0, "return_")
    assert before == {"force_delay": "0.3", "return_jitter": "0.0", "return_loss": "0.1", "return_outage": "0.0"}
    stage.change(delay=0.7, jitter=0.02, loss=0.0, outage=0.0)
    after = fault_texts(stage, "force_delay", 12345, "return_")
    assert after["force_delay"] == "0.7"
    assert after["return_jitter"] == "0.02"
    assert after[SINCE] == "12345"
    assert fault_texts(stage, "position_delay", 0)["jitter"] == "0.02"

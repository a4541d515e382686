"""A session and its replay side by side: what differs, each contact's errors, the figure."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_sessions import make_session

from foretouch.messages import SessionLog
from foretouch.report import compare_replay, contacts, render_replay, replay_figure, session_figures, write_replay_page
from foretouch.report.writing.replay import hand_begins_ns

NOTES = ("nobody would have moved otherwise", "the robot is simulated again")


@pytest.fixture(scope="module")
def logs() -> tuple[SessionLog, SessionLog]:
    """A session whose models are right, and one whose models are 10 % too stiff and whose robot is the same."""
    recorded, replayed = make_session(noise=0.002), make_session(noise=0.002, stiffness=1.1)
    texts = {"force_delay": "0.3", "model": "hunt-crossley", "gone": "1"}
    return (
        replace(recorded, settings=texts),
        replace(replayed, settings={"force_delay": "0.6", "model": "hunt-crossley", "replay": "open loop"}),
    )


def test_each_press_is_a_contact_whose_error_is_that_of_its_model(logs: tuple[SessionLog, SessionLog]) -> None:
    right, stiff = (contacts(log) for log in logs)
    assert len(right) == len(stiff) >= 7  # two presses a second for 4 s; the last command is not applied
    starts = np.diff([one.begin for one in right])
    np.testing.assert_allclose(starts, 0.5, atol=0.01)
    assert max(one.predicted for one in right[1:]) < 1.0
    for one in stiff[1:]:
        assert one.predicted == pytest.approx(10.0, abs=1.0)  # stiffness and damping alike scale the force
        assert one.end - one.begin < 0.5
    for one, other in zip(right, stiff, strict=True):
        assert one.delayed == pytest.approx(other.delayed, rel=0.02)
        assert one.force_rms == pytest.approx(other.force_rms, rel=0.01)


def test_without_contact_there_are_none() -> None:
    assert contacts(make_session(touching=False)) == []
    nothing = make_session(1.0)
    assert contacts(replace(nothing, follower=nothing.follower[:0])) == []


def test_both_reports_and_what_differs(logs: tuple[SessionLog, SessionLog]) -> None:
    content = compare_replay(*logs, NOTES)
    assert content["motion"] == NOTES[0]
    assert content["notes"] == [NOTES[1]]
    assert content["settings"] == {"force_delay": {"recorded": "0.3", "replayed": "0.6"}}
    for name, log in zip(("recorded", "replayed"), logs, strict=True):
        assert content[name] == session_figures(log)
    assert content["replayed"]["loop"].startswith("open loop")


def test_what_the_recording_does_not_say_differs_where_it_has_no_default(logs: tuple[SessionLog, SessionLog]) -> None:
    recorded, replayed = logs
    replayed = replace(replayed, settings=replayed.settings | {"loss": "0.0", "jitter": "0.01"})
    assert compare_replay(recorded, replayed, NOTES)["settings"] == {
        "force_delay": {"recorded": "0.3", "replayed": "0.6"},
        "jitter": {"recorded": None, "replayed": "0.01"},
    }


def test_both_reports_can_be_written_as_json(logs: tuple[SessionLog, SessionLog]) -> None:
    content = compare_replay(*logs, NOTES)
    assert json.loads(json.dumps(content))["contacts"]["replayed"][1]["predicted"] == pytest.approx(10.0, abs=1.0)


def test_the_text_shows_both_and_their_ratio(logs: tuple[SessionLog, SessionLog]) -> None:
    content = compare_replay(*logs, NOTES)
    lines = render_replay(content).splitlines()
    assert lines[:3] == [
        "Replay in an open loop.",
        "Nobody would have moved otherwise.",
        "The robot is simulated again.",
    ]
    assert max(map(len, lines)) <= 100
    row = next(line for line in lines if "error of the delayed force" in line).split()
    before, after = (content[name]["delayed_force_error_percent"] for name in ("recorded", "replayed"))
    assert float(row[-1]) == pytest.approx(after / before, abs=0.01)
    delays = next(line for line in lines if "force delay" in line).split()
    assert delays[-2:] == ["0.3", "0.6"]
    assert not any("stable" in line for line in lines)  # of a hand whose motion is fixed
    assert any("stable" in line for line in render_replay(content | {"loop": "closed loop"}).splitlines())


def test_the_time_of_a_hand_that_waits_begins_when_it_is_coupled(logs: tuple[SessionLog, SessionLog]) -> None:
    leader = logs[0].leader.copy()
    leader["engaged"][:40] = False
    assert hand_begins_ns(leader) == leader["time_ns"][0]  # nothing was felt: its time is the session's
    leader["exact_hand_position"] = leader["position"]
    assert hand_begins_ns(leader) == leader["time_ns"][40]
    leader["engaged"] = False
    assert hand_begins_ns(leader) == leader["time_ns"][0]


def test_the_page_has_both_sessions_in_one_figure(logs: tuple[SessionLog, SessionLog], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    content = compare_replay(*logs, NOTES)
    figure = replay_figure(*logs, content["contacts"])
    whole, near, errors = figure.axes
    wanted = {f"{kind}, {name}" for kind in ("true", "delayed", "predicted") for name in ("recorded", "replayed")}
    assert wanted <= {line.get_label() for line in whole.lines}
    assert wanted <= {line.get_label() for line in near.lines}
    points = next(line for line in errors.lines if line.get_label() == "predicted, replayed")
    np.testing.assert_allclose(points.get_ydata(), [one["predicted"] for one in content["contacts"]["replayed"]])
    page = write_replay_page(tmp_path, "<s>.mcap", *logs, content).read_text()
    assert "<h1>Replay of &lt;s&gt;.mcap</h1>" in page
    assert "Nobody would have moved otherwise." in page
    assert page.count("<figure>") == 1
    assert "http" not in page.replace("http-equiv", "")


def test_a_session_in_which_nothing_was_applied_is_drawn_too(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    log = make_session(0.05)  # shorter than its delay
    content = compare_replay(log, log, NOTES)
    assert content["contacts"] == {"recorded": [], "replayed": []}
    assert write_replay_page(tmp_path, "s.mcap", log, log, content).stat().st_size > 1000
    assert "force in contact" in render_replay(content)

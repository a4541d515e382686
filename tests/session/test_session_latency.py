"""Where the time of a loop goes: stages against what a session was told to have, and against its own motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.console.panels.session import stages_html
from foretouch.messages import SessionLog
from foretouch.report import session_figures
from foretouch.report.writing.session_report import findings, render_text
from foretouch.session import SessionSettings, simulate
from foretouch.session.latency import HALVES, IN_THE_LOOP, ONE_CLOCK, STAGES, latency_figures, time_shift


@pytest.fixture(scope="module")
def log() -> SessionLog:
    settings = SessionSettings(position_delay=0.2, force_delay=0.05, jitter=0.01, seed=4)
    return simulate(settings, duration=6.0).log


@given(st.floats(0.0, 0.3), st.floats(-5.0, 5.0))
def test_a_shift_of_time_is_found_whatever_constant_is_between(shift: float, apart: float) -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    motion = 1e-2 * np.sin(7.0 * time) * np.sin(1.3 * time)
    later = apart + np.interp(time - shift, time, motion)
    assert time_shift(time, motion, later, 0.5) == pytest.approx(shift, abs=3e-4)


def test_a_hand_that_rests_says_nothing_of_time() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    assert time_shift(time, np.zeros(time.size), np.zeros(time.size), 0.5) is None
    assert time_shift(np.empty(0), np.empty(0), np.empty(0), 0.5) is None


def test_the_stages_are_those_that_were_set_and_add_up_to_the_loop_of_the_motion(log: SessionLog) -> None:
    found = latency_figures(log.leader, log.follower, log.settings)
    stages = found["stages_ms"]
    assert list(stages) == list(STAGES)
    assert found["clocks"] == ONE_CLOCK
    there = stages["leader"] + stages["link_there"] + stages["playout"]
    assert there == pytest.approx(200.0, abs=11.0)  # within the jitter, which the playout evens out
    assert stages["link_back"] == pytest.approx(50.0, abs=11.0)
    assert stages["device"] == pytest.approx(0.5)
    assert 0.0 < stages["learner"] <= 20.0
    assert found["loop_ms"] == pytest.approx(found["sum_ms"], abs=5.0)


@pytest.mark.parametrize("apart_ns", [10**12, -(10**12)])
def test_clocks_of_two_machines_leave_the_sum_and_are_said(log: SessionLog, apart_ns: int) -> None:
    one = latency_figures(log.leader, log.follower, log.settings)
    follower = log.follower.copy()
    follower["time_ns"] += apart_ns
    two = latency_figures(log.leader, follower, log.settings)
    assert two["clocks"] == HALVES
    assert two["sum_ms"] == pytest.approx(one["sum_ms"], abs=1e-3)
    assert two["stages_ms"]["link_back"] == pytest.approx(0.5 * (one["sum_ms"] - one["stages_ms"]["robot"]), abs=15.0)


def test_a_log_of_nothing_has_no_stage_of_the_loop() -> None:
    nothing = SessionLog.from_messages([])
    found = latency_figures(nothing.leader, nothing.follower, {"device_delay": "none"})
    assert set(found["stages_ms"].values()) == {None}
    assert found["sum_ms"] is found["loop_ms"] is None


def test_a_side_that_counts_on_while_the_other_is_late_says_nothing_of_the_ways(log: SessionLog) -> None:
    follower = log.follower.copy()
    follower["command_sequence"] += 400  # over a thin link: of commands that the leader's late ticks are yet to make
    found = latency_figures(log.leader, follower, log.settings)
    unknown = {"leader", "link_there", "playout", "link_back"}
    assert {name for name in IN_THE_LOOP if found["stages_ms"][name] is None} == unknown
    assert found["sum_ms"] is found["clocks"] is None
    assert "Where the time goes" in stages_html(found)


def test_a_report_tells_them(log: SessionLog) -> None:
    report = session_figures(log)
    text = render_text(report)
    assert "Where the time goes (median / 99 %)" in text
    assert "link back" in text
    assert not any("add up" in finding.text for finding in findings(report))
    report["latency"]["loop_ms"] = 2.0 * report["latency"]["sum_ms"]
    assert any("some of its time is not explained" in finding.text for finding in findings(report))
    assert not math.isnan(report["latency"]["sum_ms"])

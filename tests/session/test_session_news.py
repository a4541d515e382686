"""What the sides say in a terminal: a state once, its repetitions as a number, and a wanted restart as what it is."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import LEAVES, Hello, Status
from foretouch.session import Process, SessionSettings, StopFlag, make_session_robot
from foretouch.session.processes import processes
from foretouch.session.runners import children
from foretouch.session.runners.children import Child
from foretouch.session.runners.housekeeping import NOT_RECORDED, WELCOME, Housekeeper
from foretouch.session.runners.news import ANEW, QUIET, Repeats, follower_news, leader_news
from foretouch.session.steps import follower
from foretouch.session.steps.follower_view import FollowerView

HOLDS = "the robot hears no fresh command: holds its place"


def test_a_state_that_comes_and_goes_is_said_once_and_then_counted() -> None:
    repeats, output = Repeats(), []
    for look in range(41):  # twice a second, as a housekeeper does
        now = 100.0 + 0.5 * look
        output += [(round(now - 100.0, 1), line) for line in repeats.lines(HOLDS if look % 2 == 0 else "", now)]
    assert output == [
        (0.0, HOLDS),
        (QUIET, f"{HOLDS} (9 times more within 10 s)"),
        (2.0 * QUIET, f"{HOLDS} (10 times more within 10 s)"),
    ]
    assert repeats.lines("another", 121.0) == ["another"]
    assert repeats.lines("", 122.0) == []
    assert repeats.lines("", 131.0) == [f"{HOLDS} (1 time more within 10 s)"]
    assert repeats.lines(HOLDS, 200.0) == [HOLDS]  # long after


def test_what_waits_for_a_person_is_said_each_time() -> None:
    repeats, stopped = Repeats(), "emergency stop (somebody): it is unloaded; to release it: foretouch release 1"
    assert [repeats.lines(news, float(now)) for now, news in enumerate((stopped, "", stopped))] == [
        [stopped],
        [],
        [stopped],
    ]


def test_a_wanted_restart_is_said_to_be_that_and_who_shares_the_terminal_says_nothing_twice() -> None:
    settings = SessionSettings(material="hunt-crossley")
    state = follower.start(make_session_robot(settings)[0].specification, settings)
    state.lease.epoch = 7
    state.safety.status = Status.UNLOADING
    assert "for long" in follower_news(state)
    assert follower_news(state, anew=True) == ANEW
    state.safety.status = Status.TOO_SLOW
    assert follower_news(state, anew=True) != ANEW
    state.safety.status = Status.OBSTRUCTED
    assert "has met something" in follower_news(state, anew=True)
    assert follower_news(state, "it goes slower here").endswith("; the robot says: it goes slower here")
    received = FollowerView(1)
    received.in_control = True
    assert leader_news(received, {"trouble": HOLDS}) == HOLDS
    assert leader_news(received, {"trouble": HOLDS}, told_here=True) == ""


SLOW = "import signal, time; signal.signal(15, lambda *_: (time.sleep(0.8), exit())); print(flush=True); time.sleep(9)"


def test_an_end_that_takes_long_says_what_it_waits_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "ENDING_TOLD", 0.2)
    monkeypatch.setattr(children, "GOING", 0.1)
    monkeypatch.setattr(children, "PATIENCE", 1.5)
    output: list[str] = []
    supervisor = processes._Supervisor(SessionSettings(), tmp_path / "a.mcap", None, StopFlag(), output.append)
    process = subprocess.Popen([sys.executable, "-c", SLOW], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    os.set_blocking(process.stdout.fileno(), False)  # as a side has it
    supervisor._children = [Child("record", process)]
    supervisor.end()
    process.stdout.close()
    assert process.returncode == 0
    assert output[0] == "ending: the robot unloads, and the recording is closed"
    assert len(output) > 2
    assert all(re.fullmatch(r"ending, \d+ s: waits for the recorder", line) for line in output[1:])


@pytest.mark.network
def test_a_side_hears_that_its_leader_leaves_and_says_at_the_end_how_to_record() -> None:
    endpoint, output = free_endpoint(), []
    with ZenohLink(listen=[endpoint], subscribe=["hello"]) as link, ZenohLink(connect=[endpoint]) as leader:
        house = Housekeeper(Process(link, StopFlag(), output.append), "follower", dict)
        assert not house.leader_leaves
        house.start()
        for texts, leaves in (({LEAVES: "yes"}, True), ({}, False)):
            end = time.monotonic() + 10.0
            while house.leader_leaves != leaves:
                assert time.monotonic() < end
                leader.publish(Hello.of("leader", 1, 1, texts))
                time.sleep(0.1)
        assert house._greetings >= WELCOME
        house.say_end("interrupted")
        house.close("interrupted")
    assert output[-1] == f"follower: {NOT_RECORDED}"

"""What the console keeps of several speakers, and what it says of the robot."""

from __future__ import annotations

import itertools
import re
import threading
import time
from typing import Any

import msgspec
import pytest

from foretouch.console.history import FASTEST, SLOWEST
from foretouch.console.panels.stop import ASKING_PERIOD, LEAST_ASKED, EmergencyCall
from foretouch.console.sentences import (
    COMPILING_INSTRUCTION,
    FAULT_INSTRUCTION,
    INSECURE,
    NOBODY_YET,
    SILENT_INSTRUCTION,
    STOPPED_INSTRUCTION,
    WAITING_INSTRUCTION,
    doing,
    hindrance,
    lateness,
    robot_alerts,
    session_status,
    warnings,
)
from foretouch.console.watched import GONE, MOST_SPEAKERS, Watched
from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import STATUS_SENTENCES, VERSION, Hello, LeaderState, Status, Telemetry

NOW = 100.0
STATE = LeaderState(VERSION, 1, 1_000_000, 0.01, 0.0, 1.0, 1.0, 0.5, 1, 1, 0.0, False, 1_000_000, 50_000, epoch=7)
TELEMETRY = Telemetry(VERSION, 1, 1, 1, 0.01, 0.01, 0.0, 1.0, 1.0, 1.0, True, False, 1, 1_000_000, 50_000, epoch=7)


def telemetry(**changes: Any) -> Telemetry:
    return msgspec.structs.replace(TELEMETRY, **changes)


def state(sequence: int = 1, epoch: int = 7) -> LeaderState:
    return msgspec.structs.replace(STATE, sequence=sequence, time_ns=sequence * 1_000_000, epoch=epoch)


def hello(role: str, **texts: str) -> Hello:
    return Hello(VERSION, 1, 1, role, tuple(texts), tuple(texts.values()))


def watched(*messages: Any, now: float = NOW) -> Watched:
    seen = Watched()
    for message in messages:
        seen.take(message, now)
    return seen


def test_a_robot_that_follows_is_nothing_to_speak_of() -> None:
    seen = watched(state(), telemetry())
    assert doing(seen) == ()
    assert robot_alerts(seen, NOW) == ()
    assert warnings(seen, NOW) == ()


@pytest.mark.parametrize("status", Status)
def test_every_status_has_its_sentence_in_one_place(status: Status) -> None:
    seen = watched(state(), telemetry(status=status))
    sentences = [*doing(seen), *robot_alerts(seen, NOW)]
    if status is Status.FOLLOWING:
        assert sentences == []
        return
    assert len(sentences) == 1
    assert STATUS_SENTENCES[status][1:] in sentences[0]
    assert sentences[0][0].isupper()
    calm = status in (Status.GUARDED, Status.RETURNING, Status.SHADOW)
    assert doing(seen) == (tuple(sentences) if calm else ())


def test_while_code_is_compiled_nobody_is_said_to_press() -> None:
    watched = Watched()
    names = ("supervised", "recording", "refused")
    watched.take(Hello(VERSION, 1, 1, "supervisor", (*names, "compiling"), ("yes", "", "", "40%")), 10.0)
    assert session_status(watched, 10.1, held=False, clutched=False).startswith("Compiling, 40%: ")
    watched.take(Hello(VERSION, 2, 2, "supervisor", names, ("yes", "", "")), 10.5)
    assert "presses" in session_status(watched, 10.6, held=False, clutched=False)


def test_it_is_said_why_pressing_cannot_help_and_nothing_where_it_can() -> None:
    following = watched(state(), telemetry())
    assert hindrance(following, NOW) == ""
    assert hindrance(Watched(), NOW) == WAITING_INSTRUCTION
    assert hindrance(following, NOW + 1.1 * GONE) == SILENT_INSTRUCTION
    compiling = watched(state(), telemetry(), hello("supervisor", compiling="40%"))
    assert hindrance(compiling, NOW) == COMPILING_INSTRUCTION
    assert hindrance(watched(state(), telemetry(status=Status.STOPPED)), NOW) == STOPPED_INSTRUCTION
    assert hindrance(watched(state(), telemetry(status=Status.SENSOR_FAULT)), NOW) == FAULT_INSTRUCTION
    for alone, who in ((state(2), "The robot's side"), (telemetry(sequence=2), "The leader")):
        one_gone = watched(state(), telemetry())
        one_gone.take(alone, NOW + 2.0 * GONE)
        assert hindrance(one_gone, NOW + 2.0 * GONE) == f"{who} is silent: nothing can be pressed."


def test_before_the_first_leader_a_robot_that_holds_still_alarms_nobody() -> None:
    assert robot_alerts(watched(telemetry(epoch=0, status=Status.UNLOADING)), NOW) == ()
    assert robot_alerts(watched(telemetry(epoch=0, status=Status.STOPPED)), NOW)


def test_what_the_robots_side_says_of_itself_stands_until_its_status_changes() -> None:
    trouble = "emergency stop (somebody): unloaded; to release it at rest: foretouch release 4711"
    seen = watched(state(), telemetry(status=Status.STOPPED), hello("follower", trouble=trouble))
    (text,) = robot_alerts(seen, NOW)
    assert text == f"E{trouble[1:]} on the follower's machine; there answer y, then type release."
    seen.take(telemetry(sequence=2, status=Status.RETURNING), NOW)
    assert robot_alerts(seen, NOW) == ()
    seen.take(telemetry(sequence=3, status=Status.HOLDING), NOW)
    assert STATUS_SENTENCES[Status.HOLDING] in robot_alerts(seen, NOW)[0]


def test_a_sensor_fault_is_told_even_while_the_robot_is_stopped() -> None:
    seen = watched(state(), telemetry(status=Status.STOPPED, validity=SensorState.STUCK))
    assert SENSOR_SENTENCES[SensorState.STUCK] in robot_alerts(seen, NOW)[1]


def test_a_shadow_says_that_it_can_stop_nothing() -> None:
    trouble = "emergency stop (pressed in the console): nothing is commanded from here"
    seen = watched(state(), telemetry(status=Status.SHADOW), hello("follower", trouble=trouble))
    assert robot_alerts(seen, NOW) == (f"E{trouble[1:]}.",)


def test_a_fault_of_the_followers_step_is_told_whatever_the_robot_does() -> None:
    trouble = "the follower has a fault: ValueError raised in its learning; nothing more is learnt"
    for status in (Status.FOLLOWING, Status.RETURNING, Status.SHADOW):
        seen = watched(state(), telemetry(status=status), hello("follower", trouble=trouble))
        assert robot_alerts(seen, NOW) == (f"T{trouble[1:]}.",)


def test_a_sensor_fault_is_told_once() -> None:
    sentence = SENSOR_SENTENCES[SensorState.STUCK]
    fault = telemetry(status=Status.SENSOR_FAULT, validity=SensorState.STUCK)
    seen = watched(
        state(), fault, hello("follower", trouble=f"nothing is learnt: {sentence}; then foretouch release 4711")
    )
    assert robot_alerts(seen, NOW) == (
        f"Nothing is learnt: {sentence}; then foretouch release 4711 on the follower's machine; "
        "there answer y, then type release.",
    )


def test_a_status_and_a_sensor_state_of_another_version_are_no_error() -> None:
    assert len(robot_alerts(watched(state(), telemetry(status=99, validity=99)), NOW)) == 2


def test_each_side_that_falls_silent_alone_is_named() -> None:
    seen = watched(state(), telemetry())
    seen.take(state(2), NOW + 0.5)
    (text,) = robot_alerts(seen, NOW + 0.5)
    assert text.startswith("The robot's side has been silent for 0.5 s")
    seen = watched(state(), telemetry())
    seen.take(telemetry(sequence=2), NOW + 0.5)
    (text,) = robot_alerts(seen, NOW + 0.5)
    assert text.startswith("The leader has been silent for 0.5 s")
    (text,) = robot_alerts(seen, NOW + 5.0)
    assert re.match(r"Neither side has been heard for 4\.\d s: what the robot does is not known here", text)
    assert robot_alerts(Watched(), NOW) == (NOBODY_YET,)
    assert "from the beginning" in robot_alerts(watched(state()), NOW)[0]
    assert robot_alerts(watched(telemetry()), NOW) == ()  # it waits for a leader


def test_of_two_leaders_the_one_that_is_obeyed_is_shown() -> None:
    seen = watched(state(1, epoch=8), telemetry(), hello("follower", control="ann"))
    assert robot_alerts(seen, NOW) == ("ann holds control: the robot does not obey the leader that is shown here.",)
    seen.take(state(500), NOW)
    seen.take(state(2, epoch=8), NOW)
    assert seen.leader == state(500)
    assert len(seen.history.window().time) <= 1
    assert robot_alerts(seen, NOW) == ("2 leaders speak: ann holds control and is shown here.",)


def test_another_leader_is_shown_once_the_one_shown_is_gone() -> None:
    seen = watched(state(500), telemetry())
    seen.take(state(1, epoch=9), NOW + 0.9 * GONE)
    assert seen.leader == state(500)
    seen.take(state(2, epoch=9), NOW + 1.1 * GONE)
    assert seen.leader == state(2, epoch=9)


def test_commands_of_another_leader_are_not_drawn_as_this_ones() -> None:
    """Both count from 1; a robot that obeys epoch 8 has measured nothing at the commands of epoch 7."""
    seen = watched(*(state(i) for i in range(1, 60)))
    seen.take(telemetry(command_sequence=40, epoch=8, force=9.0), NOW)
    seen.take(telemetry(command_sequence=50, epoch=7, force=2.0), NOW)
    true = seen.history.window().true
    assert list(true[true == true]) == [2.0]


def test_the_settings_are_those_of_the_leader_in_control() -> None:
    ann, bob = hello("leader", leader="ann", operator="browser"), hello("leader", leader="bob", operator="scripted")
    seen = watched(hello("follower", control="ann"), ann, bob)
    assert seen.operator == "browser"
    assert watched(hello("follower", control="bob"), bob, ann).operator == "scripted"


def test_speakers_without_end_fill_nothing() -> None:
    seen = watched(*(hello("leader", leader=f"leader {i}") for i in range(1000)))
    for i in range(1000):
        seen.take(state(1, epoch=i), NOW)
    assert len(seen._hellos) <= MOST_SPEAKERS
    assert len(seen._leaders) <= MOST_SPEAKERS
    assert seen.settings["leader"] == "leader 999"


@pytest.mark.parametrize("role", ["leader", "recorder", "supervisor", "camera"])
def test_nobody_takes_back_what_the_follower_says(role: str) -> None:
    """Above all not who contests control: its own hello, which says nothing of it, hides nothing."""
    seen = watched(state(epoch=8), telemetry(epoch=7))
    seen.take(hello("follower", contest="CONTROL CONTESTED: bob would command too", control="alice"), NOW)
    sentences = robot_alerts(seen, NOW)
    assert sentences == (
        "CONTROL CONTESTED: bob would command too.",
        "alice holds control: the robot does not obey the leader that is shown here.",
    )
    seen.take(hello(role, leader="bob", contest="", control="bob"), NOW)
    assert robot_alerts(seen, NOW) == sentences
    seen.take(hello("follower", contest="", control="alice"), NOW)
    assert robot_alerts(seen, NOW) == sentences[1:]


def test_nobody_takes_back_a_warning() -> None:
    seen = watched(hello("recorder", recorder_failed="the disk is full"), hello("follower", insecure="yes"), state())
    seen.take(hello("supervisor", supervised="yes", recording="a.mcap", insecure="", recorder_failed=""), NOW)
    seen.take(hello("leader", leader="bob", recorder_failed="", recording="", insecure="no"), NOW)
    assert warnings(seen, NOW) == (INSECURE, "The recording is not all there: the disk is full")
    assert seen.reported("supervisor", "recording") == "a.mcap"


def test_a_recording_that_is_not_all_there_is_said_and_so_is_a_recorder_that_is_gone() -> None:
    seen = watched(hello("recorder", recorder_failed="session.mcap: the disk is full"), state())
    assert warnings(seen, NOW) == ("The recording is not all there: session.mcap: the disk is full",)
    seen = watched(hello("recorder"), hello("leader", insecure="yes"))
    seen.take(state(), NOW + 4.0)
    assert warnings(seen, NOW + 4.0)[0] == INSECURE
    assert warnings(seen, NOW + 4.0)[1].startswith("The recorder has been silent for 4 s")


def test_an_emergency_stop_is_asked_for_until_the_robot_has_stopped() -> None:
    asked: list[float] = []
    enough = threading.Event()

    def ask() -> None:
        asked.append(time.monotonic())
        if len(asked) == 8:
            enough.set()

    call = EmergencyCall(ask)
    try:
        assert not call.asking
        call.press()
        call.answered()  # what was under way before the press counts for nothing
        assert call.asking
        assert enough.wait(10.0)
        assert min(b - a for a, b in itertools.pairwise(asked)) > 0.8 * ASKING_PERIOD
        call.answered()
        assert not call.asking
        time.sleep(3 * ASKING_PERIOD)
        count = len(asked)
        assert LEAST_ASKED <= count <= 9
        time.sleep(3 * ASKING_PERIOD)
        assert len(asked) == count
    finally:
        call.close()
    assert not call._thread.is_alive()


def ticks(heard: Watched, count: int, late: int) -> None:
    for number in range(count):
        period_ns = 2_000_000 if number < late else 1_000_000
        heard.lateness.take("leader", period_ns)
        heard.lateness.take("follower", 1_000_000)


def test_drawing_gives_way_while_a_loop_is_late_and_comes_back() -> None:
    seen = watched(state(), telemetry())
    seen.lateness.look()
    begun = seen.lateness.pictures
    for _ in range(10):
        ticks(seen, 500, late=50)
        seen.lateness.look()
    assert seen.lateness.pictures == SLOWEST < begun
    assert seen.lateness.late == {"leader": pytest.approx(10.0), "follower": 0.0}
    text = lateness(seen)
    assert text.startswith("This machine is late (10 % of the leader's ticks): close other programs, or open this page")
    assert text not in session_status(seen, NOW, held=False, clutched=False)  # whose place it would shift
    for _ in range(30):
        ticks(seen, 500, late=2)
        seen.lateness.look()
    assert seen.lateness.pictures == FASTEST
    assert lateness(seen) == ""


def test_loops_that_are_not_heard_are_not_late() -> None:
    seen = watched(state(), telemetry())
    for _ in range(5):
        seen.lateness.look()
    assert seen.lateness.late == {}


def test_a_moment_stays_while_more_is_heard() -> None:
    seen = watched(state(), telemetry())
    moment = seen.at_once()
    before = moment.window(6.0), moment.leader, moment.telemetry, moment.leader_space
    for sequence in range(2, 200):
        seen.take(state(sequence), NOW)
        seen.take(telemetry(sequence=sequence, command_sequence=sequence, force=5.0), NOW)
    after = moment.window(6.0), moment.leader, moment.telemetry, moment.leader_space
    assert len(after[0].time) == len(before[0].time)
    assert after[1:] == before[1:]
    assert seen.leader is not None
    assert seen.leader.sequence == 199


def test_a_session_that_has_gone_silent_says_what_to_do() -> None:
    seen = watched(state(), telemetry())
    text = session_status(seen, NOW + GONE + 0.1, held=False, clutched=False)
    assert "gone silent" in text
    assert "foretouch teleop" in text
    assert "presses" not in text

"""Sentences of a console on the robot, on the leader that commands it, and on the recording."""

from __future__ import annotations

import math

from foretouch.console.history import LATE
from foretouch.console.watched import GONE, SILENT, Watched
from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import STATUS_SENTENCES, Status, Telemetry
from foretouch.rendering.limits import LEAST_SHARE

INSECURE = "INSECURE: nothing is encrypted and nobody is checked; anybody on this network may command."
"""Text above the numbers where one of the sides asks for it."""

HAS_ENDED = (
    "Its report is in the terminal where it was started, and so is the way to start another: foretouch teleop. "
    "This page can be closed."
)
"""Text of the page when the session has ended."""
NOTHING_LIVE = "Nothing live is connected: this console shows recordings alone."  # Instead of what the session does
WAITING_INSTRUCTION = "Wait: no session has been heard yet."
SILENT_INSTRUCTION = "The session is silent: nothing can be pressed."
COMPILING_INSTRUCTION = "Wait: the session is being compiled."
STOPPED_INSTRUCTION = "The robot is stopped: release it first."
FAULT_INSTRUCTION = "The robot's sensors have failed: nothing can be pressed."
ENDING_INSTRUCTION, ENDED_INSTRUCTION = "The session ends.", "The session has ended."
"""Instead of what there is to do, where pressing cannot help."""
GONE_SILENT = (
    "The session has gone silent: see what the terminal says in which it was started. If it has ended, start it again: "
    "foretouch teleop."
)

RECORDER_SILENT = 3.0  # A recorder speaks twice a second; it is silent when nothing has come for this time [s]
FAULT = "the follower has a fault"  # Part of the robot side's text after an exception there, whatever the robot does
NOBODY_YET = "No robot has been heard yet: nothing that is pressed here reaches one."  # Until anybody speaks
RELEASE = "foretouch release"  # Part of the robot side's text while it waits to be released

CALM = (Status.FOLLOWING, Status.GUARDED, Status.RETURNING, Status.SHADOW)
"""Statuses in which the robot does what it should, and which raise no alarm."""


def doing(watched: Watched) -> tuple[str, ...]:
    """State of the robot without a fault; nothing where it simply follows."""
    status = watched.status
    return () if status is None or status == Status.FOLLOWING or status not in CALM else (_of_status(status),)


def hindrance(watched: Watched, now: float) -> str:
    """The reason that pressing cannot help now, in place of an instruction; "" where it can."""
    leader, robot = watched.leader_silence(now), watched.robot_silence(now)
    hindrances = {
        WAITING_INSTRUCTION: watched.received == -math.inf,
        SILENT_INSTRUCTION: watched.silent(now),
        COMPILING_INSTRUCTION: watched.reported("supervisor", "compiling"),
        STOPPED_INSTRUCTION: watched.status == Status.STOPPED,
        FAULT_INSTRUCTION: watched.status == Status.SENSOR_FAULT,
        "The leader is silent: nothing can be pressed.": GONE < leader < math.inf,
        "The robot's side is silent: nothing can be pressed.": GONE < robot < math.inf,
    }
    return next((sentence for sentence, applies in hindrances.items() if applies), "")


def session_status(watched: Watched, now: float, *, held: bool, clutched: bool) -> str:
    """One line: what the session is doing."""
    if watched.received == -math.inf:
        return "Waiting for the session."
    if watched.silent(now):
        return GONE_SILENT
    if progress := watched.reported("supervisor", "compiling"):
        return f"Compiling, {progress}: the first start on this machine takes about a minute."
    if watched.status == Status.STOPPED:
        hand = "The robot is stopped: nobody moves it."
    elif clutched:
        hand = "The clutch is pressed: the hand moves alone, the robot stays."
    elif watched.operator != "browser":
        hand = f"The {watched.operator} operator presses."
    else:
        hand = "You press." if held else "A script presses until you take the handle."
    model = watched.model
    force = ""
    if model is None or not model.valid:
        force = f"No force yet: {model.reason if model and model.reason else 'no model has arrived.'}"
    withheld = ""
    if watched.withheld:
        less = round(10.0 * (1.0 - watched.given)) * 10
        how = "withheld" if watched.given < LEAST_SHARE else f"reduced by about {less} %"
        withheld = f"The force is {how}: {watched.withheld}; leave the surface and press again."
    return " ".join(filter(None, (withheld, hand, *doing(watched), force)))


def lateness(watched: Watched) -> str:
    """A warning of a late loop, and what to do about it, in a sentence; "" where none is late."""
    late = {side: percent for side, percent in watched.lateness.late.items() if percent > LATE}
    if not late:
        return ""
    ticks = " and ".join(f"{percent:.0f} % of the {side}'s" for side, percent in late.items())
    return f"This machine is late ({ticks} ticks): close other programs, or open this page on another machine."


def robot_alerts(watched: Watched, now: float) -> tuple[str, ...]:
    """Urgent remarks for a person at the other end, most urgent first."""
    sentences = [_silence(watched, now)]
    if (telemetry := watched.telemetry) is not None:
        sentences += [
            _sentence(watched.reported("follower", "contest")),
            _robot(watched, telemetry),
            _sensors(watched, telemetry),
            _control(watched, telemetry, now),
        ]
    return tuple(filter(None, sentences))


def warnings(watched: Watched, now: float) -> tuple[str, ...]:
    """Text above the numbers: that nothing is secure, that the recording is incomplete."""
    insecure, silence = INSECURE if watched.insecure else "", watched.recorder_silence(now)
    recording = ""
    started = watched.reported("supervisor", "recording") or not watched.supervised(now)
    if problem := watched.reported("recorder", "recorder_failed"):
        recording = f"The recording is not all there: {problem}"
    elif started and silence > RECORDER_SILENT and watched.leader_silence(now) < SILENT:
        recording = f"The recorder has been silent for {silence:.0f} s: whether anything is recorded is not known here."
    return tuple(filter(None, (insecure, recording)))


def _silence(watched: Watched, now: float) -> str:
    robot, leader = watched.robot_silence(now), watched.leader_silence(now)
    if watched.received == -math.inf:
        return NOBODY_YET
    if robot > SILENT and leader > SILENT and math.isfinite(robot):
        return f"Neither side has been heard for {min(robot, leader):.1f} s: what the robot does is not known here."
    if robot > SILENT:
        since = f"for {robot:.1f} s" if math.isfinite(robot) else "from the beginning"
        return f"The robot's side has been silent {since}: what it does is not known here."
    if leader > SILENT > robot and math.isfinite(leader):
        return f"The leader has been silent for {leader:.1f} s: the robot hears no commands from it."
    return ""


def _robot(watched: Watched, telemetry: Telemetry) -> str:
    """State of a robot that does not follow, and how it is let go on; nothing before the first leader."""
    status, trouble = telemetry.status, watched.trouble
    whatever = (status == Status.SHADOW and trouble) or FAULT in trouble
    waiting = not (telemetry.epoch or status in (Status.STOPPED, Status.SENSOR_FAULT))
    if not whatever and (status in CALM or waiting):
        return ""
    there = " on the follower's machine; there answer y, then type release" if RELEASE in trouble else ""
    return _sentence(trouble + there) if trouble else _of_status(status)


def _sensors(watched: Watched, telemetry: Telemetry) -> str:
    """Fault of the sensors, where the text of the robot's side does not name it already."""
    if telemetry.validity == SensorState.GOOD:
        return ""
    sentence = _SENSORS.get(telemetry.validity, "its sensors are not to be trusted")
    return "" if sentence in watched.trouble else f"Nothing is learnt: {sentence}."


def _control(watched: Watched, telemetry: Telemetry, now: float) -> str:
    """The leader that is obeyed, where it is not the only one."""
    leader = watched.leader
    if leader is None or watched.leader_silence(now) > GONE or not telemetry.epoch:
        return ""
    holder = watched.reported("follower", "control") or "Another leader"
    count = watched.leaders(now)
    if telemetry.epoch != leader.epoch:
        return f"{holder} holds control: the robot does not obey the leader that is shown here."
    return f"{count} leaders speak: {holder} holds control and is shown here." if count > 1 else ""


def _of_status(status: int) -> str:
    sentence = _SENTENCES.get(status, "says a status that is not known here")
    alone = status in (Status.STOPPED, Status.SENSOR_FAULT)
    return _sentence(sentence if alone else f"the robot {sentence}")


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


_SENTENCES: dict[int, str] = {int(status): sentence for status, sentence in STATUS_SENTENCES.items()}
_SENSORS: dict[int, str] = {int(state): sentence for state, sentence in SENSOR_SENTENCES.items()}

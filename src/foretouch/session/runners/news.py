"""Status sentences that a side prints for people, and detection of a loop that hangs, by a second thread."""

from __future__ import annotations

import os
import sys
import sysconfig
import threading
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import FrameType

from foretouch.errors import plural
from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import PROCESS, STATUS_SENTENCES, Status
from foretouch.session.network.lease import LEASE
from foretouch.session.steps import follower
from foretouch.session.steps.follower_view import FollowerView

RELEASE = "foretouch release"  # Marks a sentence about a condition that waits for a person


def release_command() -> str:
    """Command to type on the robot's own machine to release the robot of this process."""
    return f"{RELEASE} {os.getpid()}"


QUIET = 10.0  # Time for which a sentence that comes again is only counted, and then printed with its number [s]


class Repeats:
    """Sentences about a condition that comes and goes: each printed at once, its repetitions as a number now and then.

    What waits for a person (`release_command`) is printed each time.

    Attributes:
        spoke: Whether the newest sentence was printed, and not only counted.
    """

    def __init__(self) -> None:
        self._before = ""
        self._said: dict[str, tuple[float, int]] = {}  # when printed [s], and number of repetitions since
        self.spoke = False

    def lines(self, sentence: str, now: float) -> list[str]:
        """Lines to print now [s], oldest first, for the sentence that holds, "" for none."""
        due = {text: again for text, (when, again) in self._said.items() if now - when >= QUIET}
        lines = [f"{text} ({plural(again, 'time')} more within {QUIET:g} s)" for text, again in due.items() if again]
        for text, again in due.items():
            if again:
                self._said[text] = (now, 0)
            else:
                del self._said[text]
        if sentence and sentence != self._before:
            self.spoke = sentence not in self._said or RELEASE in sentence
            when, again = self._said.get(sentence, (now, 0))
            self._said[sentence] = (now, 0) if self.spoke else (when, again + 1)
            lines += [sentence] if self.spoke else []
        self._before = sentence
        return lines


HANGS_AFTER = 3.0
"""Time without a tick after which a loop hangs [s]: longer than a driver's own timeout of a second or two."""


class LoopWatch:
    """Detects whether a loop still runs.

    Checks are counted and not seconds: a process that was stopped by a signal or suspended by the machine has missed
    one check when it resumes, and not all those of the time meanwhile.

    Args:
        look_period: Time between two checks [s].

    Attributes:
        ticked: Written by the loop in every tick, always a different number; 0 before the first.
    """

    __slots__ = ("_idle", "_looks", "_period", "_seen", "_thread", "ticked")

    def __init__(self, look_period: float) -> None:
        self.ticked = 0
        self._thread = threading.get_ident()  # of the loop, which constructs this object
        self._period = look_period
        self._looks = round(HANGS_AFTER / look_period)
        self._seen = self._idle = 0

    def look(self) -> bool:
        """Check once; return whether the loop has ticked since the last check."""
        moved = self.ticked != self._seen
        self._seen, self._idle = self.ticked, 0 if moved or not self.ticked else self._idle + 1
        return moved

    @property
    def stuck(self) -> str:
        """Place in the code where the loop has hung for too long; empty while it runs, and before its first tick."""
        if self._idle < self._looks:
            return ""
        return f"no tick for {self._looks * self._period:g} s, {where(sys._current_frames().get(self._thread))}"


def where(frame: FrameType | None) -> str:
    """Describe where a thread is: its innermost Python function outside the standard library, with file and line."""
    if frame is None:
        return "in a place that is not known"
    called = traceback.extract_stack(frame)
    at = next((one for one in reversed(called) if not _of_python(one.filename)), called[-1])
    return f"in {at.name} ({Path(at.filename).name}, line {at.lineno})"


def _of_python(file: str) -> bool:
    installed = "site-packages" in file or "dist-packages" in file
    return file.startswith("<frozen") or (file.startswith(sysconfig.get_path("stdlib")) and not installed)


LONGEST_SILENCE = 0.5  # Silence of the follower after which the operator is informed [s]


ANEW = "the leader begins anew, as was chosen: the robot waits for it"
"""Sentence of a follower that receives no fresh commands because another choice was made at the console."""


def follower_says(state: follower.State, contest: str, says: str, *, anew: bool = False) -> dict[str, str]:
    """Texts of a follower's `Hello` beside its settings: its process, the holder of control, and what is wrong."""
    return {
        PROCESS: str(state.run),
        "control": state.lease.holder,
        "contest": contest,
        "trouble": follower_news(state, says, anew=anew),
        "stopped": state.safety.stop_reason,
    }


def all_of(*sentences: str) -> str:
    """Join the sentences that are not empty."""
    return "; ".join(filter(None, sentences))


def connected(role: str, texts_of: Mapping[str, Mapping[str, str]]) -> str:
    """One sentence once the other side of a session has sent a `Hello`; else ""."""
    other = "follower" if role == "leader" else "leader"
    if other not in texts_of:
        return ""
    texts = texts_of[other]
    if other == "leader":
        return f"connected: the leader is {texts.get('leader', 'without a name')}"
    robot, material = texts.get("robot", "without a name"), texts.get("material")
    pressed = f", it presses {material}" if robot == "simulated" and material else ""
    return f"connected: the follower's robot is {robot}{pressed}"


def over(state: follower.State) -> str:
    """One sentence about the robot when `follower_news` has become empty."""
    return f"that is over: the robot {STATUS_SENTENCES[state.safety.status]}"


def follower_news(state: follower.State, says: str = "", *, anew: bool = False) -> str:
    """One sentence about a robot that does not follow the received commands; `anew` while its leader restarts.

    Beside it stands what the robot `says` of itself.
    """
    safety, watch = state.safety, state.watch
    if safety.stop_reason and watch.state is not SensorState.GOOD:
        why = f"nobody knows what it feels, and it goes out as it came: {SENSOR_SENTENCES[watch.state]}"
        return f"emergency stop ({safety.stop_reason}): {why}; once that is mended: {release_command()}"
    if safety.stop_reason:
        left = "unloads" if safety.pressing else "is unloaded"
        return f"emergency stop ({safety.stop_reason}): it {left}; to release it at rest: {release_command()}"
    if watch.state is not SensorState.GOOD:
        again = f"; once that is mended: {release_command()}"
        held = "the robot learns nothing, holds its place and then goes out as it came"
        return f"{held}: {SENSOR_SENTENCES[watch.state]}{again}"
    status, unheard = safety.status, (Status.HOLDING, Status.UNLOADING, Status.RETREATING)
    news = ""
    if status in (*unheard, Status.TOO_SLOW, Status.OBSTRUCTED) and state.lease.epoch:
        news = ANEW if anew and status in unheard else f"the robot {STATUS_SENTENCES[status]}"
    return all_of(news, failure_news(state), says and f"the robot says: {says}")


def failure_news(state: follower.State) -> str:
    """One sentence if the follower's step raised an exception; else ""."""
    failures = state.failures
    if not failures.count:
        return ""
    goes_on = "it is kept safe" if failures.learns else "nothing more is learnt until it is started again"
    return f"the follower has a fault: {failures.sentence}; {goes_on}"


def leader_news(
    view: FollowerView,
    follower_texts: Mapping[str, str],
    silence: float = 0.0,
    *,
    nowhere: bool = False,
    told_here: bool = False,
) -> str:
    """One sentence for an operator whose commands are not obeyed, or may not be; else "".

    Args:
        view: Messages received from the follower.
        follower_texts: Texts of its newest `Hello`.
        silence: Time since its last message [s].
        nowhere: Whether the operator's device gives no position.
        told_here: Whether the follower prints its own problems in this terminal.
    """
    if nowhere:
        return "the device gives no position: the last one is held"
    if view.run and silence > LONGEST_SILENCE:
        return "nothing is heard of the follower: the hand still feels the newest model, not what the robot does now"
    if view.shadows:
        return f"the robot {STATUS_SENTENCES[Status.SHADOW]}"
    if view.in_control:
        return "" if told_here else all_of(follower_texts.get("contest", ""), follower_texts.get("trouble", ""))
    other = follower_texts.get("control") or "another leader"
    if view.had_control:
        return f"lost control to {other}: start this leader again to have it back"
    return f"{other} holds control: this leader has it after {LEASE:g} s of silence"


def shadow_news(state: follower.State, asked: str) -> str:
    """One sentence for the person who moves a watched robot; `asked` is the reason of a requested emergency stop."""
    if asked:
        return f"emergency stop ({asked}): nothing is commanded from here, so stop the robot where it is moved"
    if state.watch.state is not SensorState.GOOD:
        again = f"; once that is mended: {release_command()}"
        return f"nothing is learnt: {SENSOR_SENTENCES[state.watch.state]}{again}"
    return failure_news(state)

"""What a side tells people beside its messages, and a loop that hangs.

Sentences are said once while something is not as it should be; and another thread of the process sees that a driver's
call does not come back.
"""

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
from foretouch.session.steps.heard import Heard

RELEASE = "foretouch release"
"""Stands in what waits for a person."""


def release_command() -> str:
    """What somebody types at the robot's own machine to release the robot of this process."""
    return f"{RELEASE} {os.getpid()}"


QUIET = 10.0
"""What is over and comes again within so long [s] is counted, and told with its number."""


class Repeats:
    """What is to be said of a state that comes and goes: each at once, and its repetitions as a number now and then.

    What waits for a person (`release_command`) is said each time.

    Attributes:
        spoke: Whether the newest that came was said, and not only counted.
    """

    def __init__(self) -> None:
        self._before = ""
        self._said: dict[str, tuple[float, int]] = {}  # when [s], and how often it has come again since
        self.spoke = False

    def lines(self, sentence: str, now: float) -> list[str]:
        """What there is to say, oldest first.

        Args:
            sentence: That holds now, "" for none.
            now: By a monotonic clock [s].
        """
        due = {said: again for said, (when, again) in self._said.items() if now - when >= QUIET}
        lines = [f"{said} ({plural(again, 'time')} more within {QUIET:g} s)" for said, again in due.items() if again]
        for said, again in due.items():
            if again:
                self._said[said] = (now, 0)
            else:
                del self._said[said]
        if sentence and sentence != self._before:
            self.spoke = sentence not in self._said or RELEASE in sentence
            when, again = self._said.get(sentence, (now, 0))
            self._said[sentence] = (now, 0) if self.spoke else (when, again + 1)
            lines += [sentence] if self.spoke else []
        self._before = sentence
        return lines


HANGS_AFTER = 3.0
"""A loop without a tick for so long [s] hangs: a driver's own timeout of a second or two is waited for."""


class LoopWatch:
    """Tells whether a loop goes on.

    Looks are counted and not seconds: a process that was stopped by a signal, or put aside by the machine, has missed
    one look when it goes on, and not as many as there were meanwhile.

    Args:
        look_period: Between two looks [s].

    Attributes:
        ticked: Written by the loop in every tick, always another number; 0 before the first.
    """

    __slots__ = ("_idle", "_looks", "_period", "_seen", "_thread", "ticked")

    def __init__(self, look_period: float) -> None:
        self.ticked = 0
        self._thread = threading.get_ident()  # the loop's, which makes this
        self._period = look_period
        self._looks = round(HANGS_AFTER / look_period)
        self._seen = self._idle = 0

    def look(self) -> bool:
        """Look once; whether the loop has ticked since the last look."""
        moved = self.ticked != self._seen
        self._seen, self._idle = self.ticked, 0 if moved or not self.ticked else self._idle + 1
        return moved

    @property
    def stuck(self) -> str:
        """Where the loop has hung for too long, in words; empty while it goes on, and before its first tick."""
        if self._idle < self._looks:
            return ""
        return f"no tick for {self._looks * self._period:g} s, {where(sys._current_frames().get(self._thread))}"


def where(frame: FrameType | None) -> str:
    """Where a thread is, in words: the innermost function in Python that is not Python's own, its file and line."""
    if frame is None:
        return "in a place that is not known"
    called = traceback.extract_stack(frame)
    at = next((one for one in reversed(called) if not _of_python(one.filename)), called[-1])
    return f"in {at.name} ({Path(at.filename).name}, line {at.lineno})"


def _of_python(file: str) -> bool:
    installed = "site-packages" in file or "dist-packages" in file
    return file.startswith("<frozen") or (file.startswith(sysconfig.get_path("stdlib")) and not installed)


LONGEST_SILENCE = 0.5
"""An operator is told that nothing comes of the follower after so long [s]."""


ANEW = "the leader begins anew, as was chosen: the robot waits for it"
"""What a follower says while no fresh commands come because another choice was made."""


def follower_says(state: follower.State, contest: str, *, anew: bool = False) -> dict[str, str]:
    """What a follower's `Hello` says beside its settings: its process, who holds control, and what is amiss.

    Args:
        state: Of the follower.
        contest: Who else would command (`foretouch.session.network.lease.Contest`).
        anew: Whether its leader has said that it begins anew.
    """
    return {
        PROCESS: str(state.run),
        "control": state.lease.holder,
        "contest": contest,
        "trouble": follower_news(state, anew=anew),
        "stopped": state.safety.stop_reason,
    }


def all_of(*sentences: str) -> str:
    """Those that say something, as one."""
    return "; ".join(filter(None, sentences))


def connected(role: str, heard: Mapping[str, Mapping[str, str]]) -> str:
    """One sentence once the other side of a session has said hello; else ""."""
    other = "follower" if role == "leader" else "leader"
    if other not in heard:
        return ""
    texts = heard[other]
    if other == "leader":
        return f"connected: the leader is {texts.get('leader', 'without a name')}"
    robot, material = texts.get("robot", "without a name"), texts.get("material")
    pressed = f", it presses {material}" if robot == "simulated" and material else ""
    return f"connected: the follower's robot is {robot}{pressed}"


def over(state: follower.State) -> str:
    """One sentence about the robot once there is nothing more to say of it by `follower_news`."""
    return f"that is over: the robot {STATUS_SENTENCES[state.safety.status]}"


def follower_news(state: follower.State, *, anew: bool = False) -> str:
    """One sentence about the robot while it does not follow the commands that there were; else "".

    Args:
        state: Of the follower.
        anew: Whether its leader has said that it begins anew.
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
    if safety.status in (Status.HOLDING, Status.UNLOADING, Status.RETREATING, Status.TOO_SLOW) and state.lease.epoch:
        silent = anew and safety.status is not Status.TOO_SLOW
        return all_of(ANEW if silent else f"the robot {STATUS_SENTENCES[safety.status]}", failure_news(state))
    return failure_news(state)


def failure_news(state: follower.State) -> str:
    """One sentence where something raised in the follower's step; else ""."""
    failures = state.failures
    if not failures.count:
        return ""
    goes_on = "it is kept safe" if failures.learns else "nothing more is learnt until it is started again"
    return f"the follower has a fault: {failures.sentence}; {goes_on}"


def leader_news(
    heard: Heard,
    follower_texts: Mapping[str, str],
    silence: float = 0.0,
    *,
    nowhere: bool = False,
    told_here: bool = False,
) -> str:
    """One sentence for an operator whose commands are not obeyed, or who does not know whether they are; else "".

    Args:
        heard: Of the follower.
        follower_texts: What its newest `Hello` says.
        silence: Time since anything came of it [s].
        nowhere: Whether the operator's device gives no position.
        told_here: Whether the follower says in this terminal itself what is amiss with it.
    """
    if nowhere:
        return "the device gives no position: the last one is held"
    if heard.run and silence > LONGEST_SILENCE:
        return "nothing is heard of the follower: the hand still feels the newest model, not what the robot does now"
    if heard.shadows:
        return f"the robot {STATUS_SENTENCES[Status.SHADOW]}"
    if heard.in_control:
        return "" if told_here else all_of(follower_texts.get("contest", ""), follower_texts.get("trouble", ""))
    other = follower_texts.get("control") or "another leader"
    if heard.had_control:
        return f"lost control to {other}: start this leader again to have it back"
    return f"{other} holds control: this leader has it after {LEASE:g} s of silence"


def shadow_news(state: follower.State, asked: str) -> str:
    """One sentence for who moves a robot that is only watched; else "".

    Args:
        state: Of the follower that watches.
        asked: Why an emergency stop was asked for; empty while none was.
    """
    if asked:
        return f"emergency stop ({asked}): nothing is commanded from here, so stop the robot where it is moved"
    if state.watch.state is not SensorState.GOOD:
        again = f"; once that is mended: {release_command()}"
        return f"nothing is learnt: {SENSOR_SENTENCES[state.watch.state]}{again}"
    return failure_news(state)

"""The parent's end of a session's processes: they are started, watched, ended in order, and killed where they hang.

Their own end is `foretouch.session.runners.housekeeping`. A console's choices while a session runs are received here.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from foretouch.link import ZenohLink
from foretouch.messages import Choice, EmergencyStop, Settings
from foretouch.session.runners.housekeeping import BEAT, COMPILING, GIVING_UP, HELLO_PERIOD, LEAVING, Greeter

CHOICE_CHANNELS = ("choice", "settings", "stop", "emergency", "hello")  # Channels that the supervisor's link receives
SUPERVISOR = "supervisor"  # Role of the supervisor in `Hello` messages

LATCHING = 2.0
"""Time for which a requested emergency stop counts as latched, whatever the follower has reported so far [s]."""


class Desk:
    """Receives the consoles' messages, and publishes what runs.

    Args:
        link: Link with `CHOICE_CHANNELS`, joined to the follower and to the console.

    Attributes:
        refused: Why the newest choice was not followed; "" where it was.
        recording: File that is being written; "" for none.
        compiling: Progress of compiling before the session can begin, "" while nothing is compiled.
        faults: Delays and faults that a console has set, None before the first.
        ended: Time at which the session's end was requested [s], infinite before.
    """

    def __init__(self, link: ZenohLink) -> None:
        self._link, self._greeter = link, Greeter(link, SUPERVISOR)
        self._stop_asked = -math.inf
        self._stop_said = ""
        self.refused = ""
        self.recording = ""
        self.compiling = ""
        self.faults: Settings | None = None
        self.ended = math.inf

    def hear(self) -> list[Choice]:
        """Take what has arrived; return the choices, oldest first."""
        for _, message in self._link.take("emergency"):
            if isinstance(message, EmergencyStop):
                self._stop_asked = time.monotonic()
        for _, hello in self._link.take("hello"):
            if hello.role == "follower":
                self._stop_said = hello.texts.get("stopped", "")
        if self._link.take("stop"):
            self.ended = min(self.ended, time.monotonic())
        if faults := self._link.take("settings"):
            self.faults = faults[-1][1]
        return [choice for _, choice in self._link.take("choice")]

    @property
    def latched(self) -> bool:
        """Whether an emergency stop holds the robot: a restarted follower would have forgotten it."""
        return bool(self._stop_said) or time.monotonic() - self._stop_asked < LATCHING

    def say(self) -> None:
        """Publish a `Hello` if it is time for one."""
        if not self._greeter.due():
            return
        texts = {"supervised": "yes", "recording": self.recording, "refused": self.refused}
        if self.compiling:
            texts["compiling"] = self.compiling
        self._greeter.greet(texts)

    def say_now(self) -> None:
        """Publish a `Hello` at once, after a change."""
        self._greeter.hurry()
        self.say()

    def close(self) -> None:
        """Leave the network."""
        self._link.close()


PATIENCE = LEAVING + GIVING_UP
"""Time that a process has to end by itself before it is terminated, and again before it is killed [s]. A follower
unloads its robot first, and its driver may hang then."""

POLL_PERIOD = 0.05  # Time between two checks of the processes [s]

SIDES = ("follower", "leader")
"""Roles whose loops are monitored, in the order in which they begin."""

GOING = 2.0
"""Time for a side to end with its own exit code after the other has ended in order and sent the last message [s]: a
signal that comes while an interpreter ends would replace that code."""

BEGINNING = 180.0  # Time for a side to begin, apart from the time in which it compiles [s]
LONGEST_LOOK = 0.5  # Largest time counted between two checks [s]: the supervisor itself may have been stopped meanwhile


@dataclass
class Child:
    """One process of a session.

    Attributes:
        role: The `foretouch` command.
        process: Process that runs the command.
        started: Time of its start [s].
        lasts: Duration after which its loop ends by itself [s], infinite without an end.
        compiled: Time of its newest sign that it compiles [s], minus infinity before.
        begun: Time of its loop's first beat [s], None before.
        silence: Time without a beat [s], as far as it was monitored and not stopped by a signal.
        listened: Time at which it was last monitored [s].
    """

    role: str
    process: subprocess.Popen[bytes]
    started: float = field(default_factory=time.monotonic)
    lasts: float = float("inf")
    compiled: float = -math.inf
    begun: float | None = None
    silence: float = 0.0
    listened: float = field(default_factory=time.monotonic)

    def listen(self) -> None:
        """Read its loop's beats (`foretouch.session.runners.housekeeping.BEAT`); its other output is dropped."""
        pipe, now = self.process.stdout, time.monotonic()
        if pipe is None or pipe.closed:
            return
        output = pipe.read() or b""  # None where nothing is there: it does not wait
        self.silence += min(now - self.listened, LONGEST_LOOK)
        self.listened = now
        if BEAT in output or self.begun is None or _stopped(self.process.pid):
            self.silence = 0.0
        if COMPILING in output:
            self.compiled = now
        if BEAT in output and self.begun is None:
            self.begun = now

    def hangs(self) -> str:
        """What is wrong with its loop, as far as its beats show; empty while nothing is."""
        now = time.monotonic()
        if not self.running:
            return ""
        if self.begun is None:
            waited = now - max(self.started, self.compiled)
            return f"has not begun within {BEGINNING:g} s" if waited > BEGINNING else ""
        if self.silence > PATIENCE:
            return f"hangs: nothing has come of it for {PATIENCE:g} s"
        if now - self.begun > self.lasts + PATIENCE:
            return f"hangs: it has not ended {PATIENCE:g} s after its duration"
        return ""

    @property
    def compiles(self) -> bool:
        """Whether it compiles, by its newest output."""
        return self.begun is None and time.monotonic() - self.compiled < 4.0 * HELLO_PERIOD

    @property
    def goes_on(self) -> bool:
        """Whether it is a side whose loop begins or goes on, by its newest beats: it has not received a final message.

        A follower ignores the final message of a leader that never had control: of one that was still compiling, or
        waited for its recorder.
        """
        return self.role in SIDES and self.running and self.silence < 2.0 * HELLO_PERIOD

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None


def start(role: str, arguments: Sequence[str]) -> Child:
    """Start a `foretouch` command with options; Ctrl-C reaches only the caller, which then ends the others in order."""
    command = [sys.executable, "-m", "foretouch", role, *arguments]
    received = subprocess.PIPE if role in SIDES else subprocess.DEVNULL
    process = subprocess.Popen(command, bufsize=0, stdin=subprocess.DEVNULL, stdout=received, start_new_session=True)
    if process.stdout is not None:
        os.set_blocking(process.stdout.fileno(), False)
    return Child(role, process)


def _stopped(process: int) -> bool:
    """Whether a process was stopped by a signal but is intact; False where the system does not report it."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
    except (OSError, IndexError):
        return False


def wait_for(
    children: Iterable[Child], *, patience: float | None = None, meanwhile: Callable[[], None] = lambda: None
) -> None:
    """Wait until all have ended, or for `patience` [s], by default `PATIENCE`; `meanwhile` is called in every round."""
    waited = list(children)
    end = time.monotonic() + (PATIENCE if patience is None else patience)
    while time.monotonic() < end and any(child.running for child in waited):
        meanwhile()
        for child in waited:
            child.listen()
        time.sleep(POLL_PERIOD)


def retire(children: Iterable[Child], *, meanwhile: Callable[[], None] = lambda: None) -> None:
    """End processes whose session goes on: they send no `Stop`."""
    leaving = [child for child in children if child.running]
    for child in leaving:
        child.process.send_signal(signal.SIGHUP)
    wait_for(leaving, meanwhile=meanwhile)
    _kill(leaving)


def end_session(children: Sequence[Child], *, meanwhile: Callable[[], None] = lambda: None) -> list[Child]:
    """End all processes: the leader first, whose final message ends the others; then, or if it sends none, by signal.

    Returns those that had to be killed; `meanwhile` is called in every round of waiting.
    """
    leading = next((child for child in children if child.role == "leader" and child.running), None)
    spoken, killed = all(child.process.poll() in (None, 0) for child in children), []
    if leading is not None:
        if any(child.role in SIDES and child.process.poll() == 0 for child in children):
            wait_for([leading], patience=GOING, meanwhile=meanwhile)
        _tell([leading])
        wait_for([leading], meanwhile=meanwhile)
        killed = _kill([leading])
        spoken = leading.process.returncode >= 0  # negative if it ended by a signal
    if spoken:
        wait_for(children, patience=GOING, meanwhile=meanwhile)
        _tell(child for child in children if child.goes_on)
        wait_for(children, meanwhile=meanwhile)
    _tell(children)
    wait_for(children, meanwhile=meanwhile)
    return killed + _kill(children)


def _tell(children: Iterable[Child]) -> None:
    """Send SIGTERM to those that still run."""
    for child in children:
        if child.running:
            child.process.terminate()


def _kill(children: Iterable[Child]) -> list[Child]:
    """Kill those that still run; return them."""
    killed = [child for child in children if child.running]
    for child in killed:
        child.process.kill()
    wait_for(killed)
    return killed

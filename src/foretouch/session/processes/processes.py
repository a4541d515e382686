"""A whole session on one machine: each part in a separate process, and their supervision."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from foretouch.errors import ForetouchError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import Choice
from foretouch.session.processes.recorder import RECORDING_INCOMPLETE
from foretouch.session.runners.children import (
    CHOICE_CHANNELS,
    POLL_PERIOD,
    SIDES,
    Child,
    Desk,
    end_session,
    retire,
    start,
    wait_for,
)
from foretouch.session.runners.housekeeping import StopFlag
from foretouch.session.runners.warm_up import compiled_share
from foretouch.session.settings import SessionSettings, choose, with_faults

WATCHERS = {"console": "console", "record": "recorder", "camera": "camera"}
"""Processes without which the session goes on, unless their options are refused (exit code 2)."""

SETTLING = 15.0  # Time after a choice within which a side that fails is started again with the settings before it [s]

SLOW_BEGINNING = 30.0
"""Time after which a side that has not begun is reported, apart from the time in which it compiles [s]."""

TOLD_EVERY = 0.2  # Fraction of compiling done between two reports of its progress
ENDING = 3.0  # Time after which a session that was ended by request ends even if no leader received the request [s]
ENDING_TOLD = 2.0  # Time between two reports of what the end waits for [s]

LATCHED = "the emergency stop is latched: release it first, for a robot that begins anew would have forgotten it"


def run_processes(
    settings: SessionSettings,
    *,
    recording: Path,
    console_port: int | None,
    duration: float | None,
    stop: StopFlag,
    say: Callable[[str], None],
) -> int:
    """Start the processes of a session, wait for its end, and see that none remains.

    While it runs, a console may choose another material, operator or grip, with which the sides restart, and end or
    begin a recording: a further one is written beside the first, with a number appended to its name.

    Args:
        settings: Session settings.
        recording: The MCAP file to write.
        console_port: Port of the console on 127.0.0.1, None for no console.
        duration: Duration [s], None until an end is requested.
        stop: Set by Ctrl-C.
        say: Prints one line for people.

    Returns:
        0, or the exit code of the process that failed, or `RECORDING_INCOMPLETE`.
    """
    supervisor = _Supervisor(settings, recording, duration, stop, say)
    try:
        supervisor.start(console_port)
        code = supervisor.watch()
    finally:
        supervisor.end()
    return code or supervisor.failed or (RECORDING_INCOMPLETE if supervisor.incomplete else 0)


class _Supervisor:
    """Starts the processes, watches them, and restarts some of them with a console's choice."""

    def __init__(
        self,
        settings: SessionSettings,
        recording: Path,
        duration: float | None,
        stop: StopFlag,
        say: Callable[[str], None],
    ) -> None:
        self._settings = self._before = settings
        self._recording = recording
        self._duration = duration
        self._stop, self._say = stop, say
        self._children: list[Child] = []
        self._recorders: list[Child] = []
        self._desk: Desk | None = None
        self._common = ["--parent", str(os.getpid())]
        self._follower, self._leader, self._console = free_endpoint(), free_endpoint(), free_endpoint()
        self._watching = ["--connect", self._follower, "--connect", self._leader]
        self._beside = {role: free_endpoint() for role in settings.workspace.beside}
        for endpoint in self._beside.values():
            self._watching += ["--connect", endpoint]
        self._begun: float | None = None
        self._awaited = False
        self._told = 0.0
        self._hung = False
        self._ending = self._said = 0.0

    @property
    def incomplete(self) -> bool:
        """Whether a recording is incomplete."""
        return any(recorder.process.returncode for recorder in self._recorders)

    @property
    def failed(self) -> int:
        """Exit code of a side that failed and whose last message ended the others before it was checked; else 0."""
        if self._hung:
            return 1
        codes = (child.process.returncode or 0 for child in self._children if child.role not in WATCHERS)
        return next((code for code in codes if code > 0), 0)

    def start(self, console_port: int | None) -> None:
        """Start everything, the leader last; its duration counts from then on."""
        self._start_follower()
        for role, endpoint in self._beside.items():
            ends = ["--listen", endpoint, "--connect", self._follower]
            self._children.append(start(role, [*ends, *self._chosen(), *self._common]))
        if console_port is not None:
            options = ["--port", str(console_port), "--listen", self._console]
            for folder in (self._recording.parent, Path()):  # this session's folder, and that of earlier ones
                options += ["--recordings", str(folder)]
            self._children.append(start("console", [*options, *self._watching, *self._common]))
            self._watching += ["--connect", self._console]
        self._record(self._recording)
        self._start_leader()
        if console_port is not None:
            self._desk = Desk(ZenohLink(connect=[self._follower, self._console], subscribe=CHOICE_CHANNELS))
            self._tell_recording(self._recording)
        self._say(f"Another process watches it with {' '.join(self._watching)}")
        self._say("No certificate is asked for there: every user of this machine may watch, command and stop it")

    def watch(self) -> int:
        """Wait until the leader has ended, or a process has failed, or the stop is set; return the exit code."""
        while not self._stop.reason:
            for child in tuple(self._children):
                code = self._judge(child)
                if code is not None:
                    return code
            if self._one_hangs():
                return 1
            self._pass_on()
            if self._desk is not None:
                for choice in self._desk.hear():
                    self._follow(choice)
                self._desk.say()
                if time.monotonic() - self._desk.ended > ENDING:
                    return 0
            time.sleep(POLL_PERIOD)
        return 0

    def end(self) -> None:
        """End all processes, and report what is waited for where that takes long."""
        self._ending = self._said = time.monotonic()
        self._say("ending: the robot unloads, and the recording is closed")
        for child in end_session(self._children, meanwhile=self._tell_of_ending):
            self._hung = self._hung or child.role in SIDES
            self._say(f"the {child.role} did not end and was killed")
        if self._desk is not None:
            self._desk.close()

    def _tell_of_ending(self) -> None:
        now = time.monotonic()
        there = " and ".join(f"the {WATCHERS.get(child.role, child.role)}" for child in self._children if child.running)
        if there and now - self._said >= ENDING_TOLD:  # the last may have ended since it was last looked at
            self._said = now
            self._say(f"ending, {now - self._ending:.0f} s: waits for {there}")

    def _one_hangs(self) -> bool:
        """Whether a side hangs; it is killed, for it has not ended by itself where it could."""
        sides = [child for role in SIDES for child in self._children if child.role == role]
        for child in sides:
            child.listen()
            if why := child.hangs():
                self._say(f"the {child.role} {why}; it is killed, and the session ended")
                child.process.kill()
                wait_for([child])
                return True
            if child.begun is None:  # the leader waits for the follower
                self._tell_of_waiting(child)
                break
            if self._desk is not None:
                self._desk.compiling = ""
        return False

    def _tell_of_waiting(self, child: Child) -> None:
        fraction = compiled_share() if child.compiles else None
        if self._desk is not None:
            self._desk.compiling = "" if fraction is None else f"{fraction:.0%}"
        if fraction is not None:
            if fraction >= self._told:
                self._told = fraction + TOLD_EVERY
                self._say(f"compiling, {fraction:.0%}: the first start on this machine takes about a minute")
        elif not self._awaited and time.monotonic() - max(child.started, child.compiled) > SLOW_BEGINNING:
            self._awaited = True
            what = "robot" if child.role == "follower" else "device"
            self._say(
                f"the {child.role} has not begun for {SLOW_BEGINNING:g} s: its {what} does not answer "
                "(Ctrl-C ends the session)"
            )

    def _judge(self, child: Child) -> int | None:
        """The exit code of the session if this process has ended it, None if it goes on."""
        code = child.process.poll()
        if code is None:
            return None
        if child.role in WATCHERS and code != 2:
            if code:
                who = WATCHERS[child.role]
                self._say(f"the {who} ended with exit code {code}; the session goes on without it")
            self._children.remove(child)
            self._tell_recording()
            return None
        if code != 0 and self._goes_back(child):
            return None
        if code != 0:
            self._say(f"the {child.role} process ended with exit code {code}")
            return code if code > 0 else 1
        return 0 if child.role in SIDES else None

    def _goes_back(self, child: Child) -> bool:
        """Whether a side that failed soon after a choice was started again with the settings before it."""
        late = time.monotonic() - child.started > SETTLING
        if late or self._settings == self._before or child.role in WATCHERS:
            return False
        self._refuse(f"the {child.role} could not go on so: it is as it was before")
        self._begin_anew(self._before, whole=True)
        self._before = self._settings
        return True

    def _pass_on(self) -> None:
        """Pass an emergency stop and its release on to the follower."""
        followers = [child.process for child in self._children if child.role == "follower"]
        if self._stop.emergency:
            self._stop.emergency = ""
            for process in followers:
                process.send_signal(signal.SIGUSR1)
        if self._stop.release:
            self._stop.release = False
            for process in followers:
                process.send_signal(signal.SIGUSR2)

    # Choices of a console.

    def _follow(self, choice: Choice) -> None:
        """Apply a choice, or report why it is refused."""
        if self._desk is None:
            return
        self._desk.refused = ""
        self._follow_record(choice.record)
        try:
            chosen = choose(self._settings, choice)
        except ForetouchError as error:
            self._refuse(str(error))
            return
        pressed = chosen.material != self._settings.material
        if chosen != self._settings and pressed and self._desk.latched:
            self._refuse(LATCHED)
        elif chosen != self._settings:
            self._say_chosen(chosen, "both sides begin" if pressed else "the leader begins")
            self._begin_anew(chosen, whole=pressed)
        self._desk.say_now()

    def _say_chosen(self, chosen: SessionSettings, who_begin: str) -> None:
        before, after = self._settings.as_text(), chosen.as_text()
        what = ", ".join(f"{name} {value}" for name, value in after.items() if value != before[name])
        self._say(f"chosen in the console: {what}; {who_begin} anew")

    def _begin_anew(self, settings: SessionSettings, *, whole: bool) -> None:
        """Restart the leader, or both sides where the material changes: a model holds only for its material."""
        roles = ("leader", "follower") if whole else ("leader",)
        leaving = [child for child in self._children if child.role in roles]
        self._children = [child for child in self._children if child not in leaving]
        for role in roles:  # the leader first: a robot without commands is at rest when it ends
            retire([child for child in leaving if child.role == role], meanwhile=self._meanwhile)
        faults = self._desk.faults if self._desk is not None else None
        self._before, self._settings = self._settings, settings
        if faults is not None:
            self._settings = with_faults(settings, faults)
        if whole:
            self._start_follower()
        self._start_leader()

    def _meanwhile(self) -> None:
        """Do the work that does not wait for a process that ends."""
        self._pass_on()
        for child in self._children:
            child.listen()
        if self._desk is not None:
            self._desk.say()

    def _follow_record(self, record: str) -> None:
        recording = [child for child in self._children if child.role == "record"]
        if record == "stop":
            for child in recording:
                child.process.terminate()  # it completes its file; the session goes on
        elif record == "start" and not recording:
            self._record(_next_name(self._recording))

    def _refuse(self, reason: str) -> None:
        self._say(f"not chosen: {reason}")
        if self._desk is not None:
            self._desk.refused = reason
            self._desk.say_now()

    # Processes.

    def _record(self, path: Path) -> None:
        recorder = start("record", [str(path), *self._watching, *self._common])
        self._children.append(recorder)
        self._recorders.append(recorder)
        self._tell_recording(path)

    def _tell_recording(self, path: Path | None = None) -> None:
        """Publish the path of the file being written; without one, none where no recorder runs."""
        if self._desk is None:
            return
        if path is not None:
            self._desk.recording = str(path)
        elif not any(child.role == "record" for child in self._children):
            self._desk.recording = ""
        self._desk.say_now()

    def _start_follower(self) -> None:
        self._children.append(start("follower", ["--listen", self._follower, *self._chosen(), *self._common]))

    def _start_leader(self) -> None:
        ends = ["--listen", self._leader, "--connect", self._follower]
        recorded = any(child.role == "record" for child in self._children)
        wait = ["--wait-for-recorder"] if recorded else []
        lasts = self._time_left()
        limit = [] if lasts is None else ["--duration", str(lasts)]
        leader = start("leader", [*ends, *wait, *limit, *self._chosen(), *self._common])
        leader.lasts = leader.lasts if lasts is None else lasts
        self._children.append(leader)

    def _time_left(self) -> float | None:
        """Remaining duration of the leader's loop [s], None without an end."""
        if self._duration is None:
            return None
        self._begun = time.monotonic() if self._begun is None else self._begun
        return max(self._duration - (time.monotonic() - self._begun), 0.1)

    def _chosen(self) -> list[str]:
        """Settings as options of `foretouch leader` and `foretouch follower`."""
        settings = self._settings
        stated = [(name, text) for name, text in settings.as_text().items() if getattr(settings, name) is not None]
        return [part for name, value in stated for part in (f"--{name.replace('_', '-')}", value)]


def _next_name(path: Path) -> Path:
    """The first unused name for a further recording."""
    number = 2
    while (name := path.with_stem(f"{path.stem}-{number}")).exists():
        number += 1
    return name

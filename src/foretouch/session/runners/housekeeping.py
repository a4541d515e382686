"""A live process's work beside its loop: identification, undecodable messages, ending, and detection of a hang."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from types import FrameType
from typing import NamedTuple

from foretouch.errors import one_line, plural, was_or_were
from foretouch.link import WaitingNote, ZenohLink
from foretouch.messages import LEAVES, SIDES, VERSION, Hello, Stop
from foretouch.session.runners.news import HANGS_AFTER, LoopWatch, Repeats, connected
from foretouch.session.thin import FollowerEnd, LeaderEnd

HELLO_PERIOD = 0.5  # Time between two `Hello` messages [s]
WELCOME = 4  # Number of `Hello` messages of a restarting leader after which its commands come at the latest

BEAT = b"\x06"
"""Written to the standard output, for a parent process, once in every `HELLO_PERIOD` in which the loop has ticked and
was not to end."""

COMPILING = b"\x05"  # Written there at the same rate before the loop begins, while code is compiled or loaded
CLOSING = 1.0  # Time for the driver of a loop that hangs to close [s]
LONGEST_REASON = 400  # Largest number of characters of the reason in a `Stop`, as the message allows
LEAVING = 3.0  # Time in which a robot that a session leaves in contact may unload [s]

GIVING_UP = HANGS_AFTER + HELLO_PERIOD + CLOSING + HELLO_PERIOD
"""Time after which a process whose loop hangs has ended [s]: a check detects it, the driver may close, and the last
message is sent."""

NOT_RECORDED = (
    "nobody recorded it, so there is no report; beside the next one: "
    "foretouch record session.mcap --connect ENDPOINT, with the endpoint of each side"
)
"""Printed at the end for a person who runs a side by hand."""

ORPHANED = "the parent process has gone"  # Reason to stop when `orphaned`


def orphaned(parent: int | None) -> bool:
    """Whether the parent process, whose end should end this one, has gone."""
    return parent is not None and os.getppid() != parent


class StopFlag:
    """Requests to a process, by signal or by hand; a loop checks it in each tick.

    Attributes:
        reason: Why the process should end (Ctrl-C, SIGTERM, the end of its parent); "" while it should not.
        emergency: Why the robot should stop at once (SIGUSR1); "" while it should not.
        release: Whether a release was requested (SIGUSR2); only a follower reads it.
        quiet: Whether the process should end alone (SIGHUP): the session goes on, so it sends no `Stop`.
    """

    def __init__(self) -> None:
        self.reason = ""
        self.emergency = ""
        self.release = False
        self.quiet = False

    def set(self, reason: str) -> None:
        """Request the end; the first reason stays."""
        self.reason = self.reason or reason

    def take(self) -> tuple[str, bool]:
        """Requests for an emergency stop and for a release since the last call."""
        # Cleared only if set: a signal may come at any moment and must not be lost.
        emergency, release = self.emergency, self.release
        if emergency:
            self.emergency = ""
        if release:
            self.release = False
        return emergency, release

    def on_signals(self) -> StopFlag:
        """Set on SIGINT, SIGTERM, SIGHUP, SIGUSR1 and SIGUSR2 from now on (main thread only)."""

        def handle(number: int, frame: FrameType | None) -> None:
            if number == signal.SIGUSR1:
                self.emergency = "asked for by signal"
            elif number == signal.SIGUSR2:
                self.release = True
            elif number == signal.SIGHUP:
                self.quiet = True
                self.set("begins anew")
            else:
                self.set("interrupted" if number == signal.SIGINT else "terminated")

        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2):
            signal.signal(number, handle)
        return self


class Process(NamedTuple):
    """Members common to all processes of a session.

    Attributes:
        link: Link to publish and listen on.
        stop: Checked in every tick.
        say: Prints one line for people.
        parent: Process id of the parent whose end ends this process too; None where a person started it.
        end: End of a thin link that has heard of the other side already; None for a new one, or none.
    """

    link: ZenohLink
    stop: StopFlag
    say: Callable[[str], None]
    parent: int | None = None
    end: LeaderEnd | FollowerEnd | None = None


class Greeter:
    """Publishes the `Hello` messages of a process, every `HELLO_PERIOD`.

    Args:
        link: Link to publish on.
        role: Role of the process.
    """

    def __init__(self, link: ZenohLink, role: str) -> None:
        self._link, self.role = link, role
        self._count, self._newest = 0, -math.inf

    def due(self) -> bool:
        """Whether it is time for one."""
        return time.monotonic() - self._newest >= HELLO_PERIOD

    def hurry(self) -> None:
        """Make one due now."""
        self._newest = -math.inf

    def greet(self, texts: Mapping[str, str]) -> None:
        """Publish one, with these texts."""
        self._count, self._newest = self._count + 1, time.monotonic()
        self._link.publish(Hello.of(self.role, self._count, time.monotonic_ns(), texts))


class Housekeeper(threading.Thread):
    """Publishes `Hello` twice a second, takes those of others, and prints news for people, once a second.

    It runs on its own thread, so that the loop neither prints nor waits. The texts of a follower are also kept for
    `foretouch release` (`foretouch.session.runners.news`). Where the loop hangs (`LoopWatch`) it
    prints so, publishes the last message, lets the driver close if it still can, and ends the process with exit code
    1: nothing else in the process could.

    Args:
        process: Its stop is set when its parent has gone.
        role: Role for the `Hello`.
        describe: Gives the texts of the `Hello`; called on this thread.
        news: Gives the current news for people, "" for none, from the newest texts of others (name: value, by role);
            called on this thread. It is printed where it changes.
        over: Gives the sentence printed when such news have ended, if no parent process prints it; likewise.
        epoch: Epoch of a leader, for its `Stop`.
        release: Closes the driver of the robot or device; called only where the loop hangs, on a third thread.

    Attributes:
        role: As given.
        loop: Watch of the loop, which writes its ticks there.
    """

    def __init__(
        self,
        process: Process,
        role: str,
        describe: Callable[[], dict[str, str]],
        news: Callable[[Mapping[str, Mapping[str, str]]], str] | None = None,
        *,
        epoch: int = 0,
        release: Callable[[], None] | None = None,
        over: Callable[[], str] = lambda: "that is over",
    ) -> None:
        super().__init__(name="housekeeping", daemon=True)
        self._link, self._stop_flag, self._say, self._parent, _ = process
        self.role = role
        self._describe = describe
        self._news = news
        self._epoch = epoch
        self._release = release
        self._over = over
        self._met = process.parent is not None  # a parent process prints that itself
        self.loop = LoopWatch(HELLO_PERIOD)
        self._newest_news = ""
        self._repeats = Repeats()
        self._note: WaitingNote | None = None
        self._texts_of: dict[str, dict[str, str]] = {}
        self._greeter = Greeter(self._link, role)
        self._greetings = WELCOME  # of the newest leader, since one left
        self._reported = self._foreign = 0
        self._reported_too_large = False
        self._ended = threading.Event()

    def run(self) -> None:
        """Work until `close`."""
        if self.role == "follower":
            self._note = WaitingNote()
        count = 0
        while not self._ended.wait(HELLO_PERIOD):
            self._look_at_loop()
            self.say_hello()
            self._tell_news()
            count += 1
            if count % 2 == 0:
                self._report_link()
            if orphaned(self._parent):
                self._stop_flag.set(ORPHANED)

    def say_hello(self) -> None:
        """Publish one `Hello` now."""
        texts = self._describe() | ({LEAVES: "yes"} if self._stop_flag.quiet else {})
        self._greeter.greet(texts)

    def say_end(self, reason: str) -> None:
        """Print why the session ended, where no parent process does."""
        if self._parent is None:
            self._say(f"{self.role}: the session has ended: {reason}")
            if "recorder" not in self._texts_of:
                self._say(f"{self.role}: {NOT_RECORDED}")

    @property
    def leader_leaves(self) -> bool:
        """Whether a leader has announced a restart, and the next has hardly begun."""
        return self._greetings < WELCOME

    def close(self, reason: str) -> None:
        """Publish the last `Hello` and, unless it ends quietly, a `Stop`, a leader's with its epoch; end the thread."""
        self._ended.set()
        self.join()
        if self._note is not None:
            self._note.close()
        self._say_last(reason)
        self._report_link()

    def _say_last(self, reason: str) -> None:
        self.say_hello()
        if not self._stop_flag.quiet:
            self._link.publish(Stop(VERSION, 1, time.monotonic_ns(), one_line(reason, LONGEST_REASON), self._epoch))

    def _look_at_loop(self) -> None:
        """Report to the parent that the loop goes on, or end the process where it does not."""
        moved = self.loop.look()
        if moved and self._parent is not None and not self._stop_flag.reason:  # not while a robot unloads at the end
            with contextlib.suppress(OSError):  # the parent has gone
                os.write(1, BEAT)
        stuck = self.loop.stuck
        if stuck and not self._ended.is_set():
            self._give_up(f"the {self.role} hangs: {stuck}")

    def _give_up(self, reason: str) -> None:
        """End a process whose loop does not end."""
        alone = "; its robot hears nothing any more: stop it by its own switch if it presses"
        self._say(reason + (alone if self.role == "follower" else ""))
        self._say_last(reason)
        if self._release is not None:
            closing = threading.Thread(target=self._release, name="closing", daemon=True)
            closing.start()
            closing.join(CLOSING)
        time.sleep(HELLO_PERIOD)  # time to send the last message
        sys.stderr.flush()
        os._exit(1)

    def _tell_news(self) -> None:
        """Take the texts of others, and print changed news."""
        for _, hello in self._link.take("hello"):
            self._texts_of[hello.role] = hello.texts
            if hello.role == "leader":
                self._greetings = 0 if LEAVES in hello.texts else self._greetings + 1
        if not self._met and (sentence := connected(self.role, self._texts_of)):
            self._met = True
            self._say(f"{self.role}: {sentence}")
        news = "" if self._news is None else self._news(self._texts_of)
        for line in self._repeats.lines(news, time.monotonic()):
            self._say(f"{self.role}: {line}")
        if self._newest_news and not news and self._repeats.spoke and self._parent is None:
            self._say(f"{self.role}: {self._over()}")
        if self._note is not None and news != self._newest_news:
            self._note.say(news)
        self._newest_news = news

    def _report_link(self) -> None:
        """Print dropped messages of the link: undecodable ones whenever there are more, oversized ones once."""
        link = self._link
        if link.undecodable > self._reported:
            new, foreign = link.undecodable - self._reported, link.foreign - self._foreign
            versions = f", {foreign} of them of another version" if foreign else ""
            peer = link.other_version(set(SIDES) - {self.role})
            because = f" ({peer})" if peer else ""
            lost = f"{plural(new, 'message')} did not decode and {was_or_were(new)} dropped"
            self._say(f"{self.role}: {lost}{versions}{because}")
            self._reported, self._foreign = link.undecodable, link.foreign
        if link.too_large and not self._reported_too_large:
            self._reported_too_large = True
            self._say(f"{self.role}: {link.too_large}; it is counted as unsent, and others like it")

"""Processes that a session is made of: started, ended in order, and killed where they do not end."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

__all__ = ["PATIENCE", "POLL_PERIOD", "Child", "end_session", "retire", "start", "wait_for"]

PATIENCE = 8.0
"""A process that is to end has so long [s] to end by itself; then it is told to, then it is killed."""

POLL_PERIOD = 0.05
"""Between two looks at the processes [s]."""


@dataclass
class Child:
    """One process of a session: its role, and when it was started [s]."""

    role: str
    process: subprocess.Popen[bytes]
    started: float = field(default_factory=time.monotonic)

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None


def start(role: str, arguments: Sequence[str]) -> Child:
    """Start one process of ours; Ctrl-C reaches only this one, which then ends the others in order.

    Args:
        role: The `foretouch` command.
        arguments: Its options.
    """
    command = [sys.executable, "-m", "foretouch", role, *arguments]
    return Child(
        role,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True),
    )


def wait_for(children: Iterable[Child], *, meanwhile: Callable[[], None] = lambda: None) -> None:
    """Wait until all have ended, for at most `PATIENCE`.

    Args:
        children: To wait for.
        meanwhile: Called in every round.
    """
    waited = list(children)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and any(child.running for child in waited):
        meanwhile()
        time.sleep(POLL_PERIOD)


def retire(children: Iterable[Child], *, meanwhile: Callable[[], None] = lambda: None) -> None:
    """End processes whose session goes on: they say no `Stop`.

    Args:
        children: To end.
        meanwhile: Called in every round of waiting.
    """
    leaving = [child for child in children if child.running]
    for child in leaving:
        child.process.send_signal(signal.SIGHUP)
    wait_for(leaving, meanwhile=meanwhile)
    for child in leaving:
        if child.running:
            child.process.kill()
    wait_for(leaving)


def end_session(children: Sequence[Child]) -> None:
    """End all processes: the leader first, whose last word ends the others; then, or if it has none, by signal.

    Args:
        children: Of the session.
    """
    leading = next((child for child in children if child.role == "leader" and child.running), None)
    if leading is not None:
        leading.process.terminate()
    if leading is not None or all(child.process.poll() in (None, 0) for child in children):
        wait_for(children)
    for insist in (subprocess.Popen.terminate, subprocess.Popen.kill):
        for child in children:
            if child.running:
                insist(child.process)
        wait_for(children)

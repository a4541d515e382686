"""The recordings in a folder, and the one that is looked at: read and run again on threads of their own."""

from __future__ import annotations

import math
import stat
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from foretouch.console.playback import Playback
from foretouch.errors import ForetouchError, RecordingError, one_line
from foretouch.messages import SessionLog

PATTERN = "*.mcap"
MOST = 50
"""So many of the newest are listed."""


class Library:
    """What can be looked at, and what is.

    Reading a recording takes as long as it takes, on a thread of its own; meanwhile and afterwards `note` says in one
    line how it went. What cannot be read is a line, no error.

    Args:
        folder: Of the recordings.

    Attributes:
        playback: The recording that is looked at, None for none.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._job: threading.Thread | None = None
        self._begun, self._share = 0.0, math.nan  # of the job: when it began [s], how much of it is done
        self._said = ""
        self.playback: Playback | None = None

    def names(self) -> tuple[str, ...]:
        """Of the recordings, the newest first: files of this folder, no pipe, no device and no link out of it."""
        try:
            folder = self._folder.resolve()
            found = [(_age(path, folder), path.name) for path in self._folder.glob(PATTERN)]
        except OSError:
            return ()
        return tuple(name for age, name in sorted(found) if math.isfinite(age))[:MOST]

    @property
    def busy(self) -> bool:
        """Whether a recording is being read or run again."""
        return self._job is not None and self._job.is_alive()

    @property
    def note(self) -> str:
        """What there is to say in one line, how far it is while something is read or run; "" for nothing."""
        if not self.busy or not self._said.endswith("…"):
            return self._said
        done = f" {100.0 * self._share:.0f} %," if math.isfinite(self._share) else ""
        return f"{self._said}{done} {time.monotonic() - self._begun:.0f} s"

    @note.setter
    def note(self, said: str) -> None:
        self._said = said

    def open(self, name: str) -> None:
        """Look at a recording from its beginning; it is paused.

        Args:
            name: One of `names`; whatever else it is, nothing is opened.
        """

        def read() -> str:
            if name not in self.names():
                raise RecordingError("the recording", "is none of this folder")
            from foretouch.recordings import read_session

            log = read_session(self._folder / name)
            self.playback = Playback(log, name=name)
            return "It ends before its session did." if log.counts.get("truncated") else ""

        self._start(read, f"Reading {name}{self._size(name)} …", "This recording cannot be looked at")

    def run_again(self, position_delay: float, force_delay: float, *, closed_loop: bool) -> None:
        """Run the recorded session again under other delays, beside what was recorded.

        Args:
            position_delay: One-way delay of commands [s].
            force_delay: Of models and telemetry [s].
            closed_loop: Whether the force that is rendered then moves the hand.
        """
        shown = self.playback
        if shown is None:
            return

        def run() -> str:
            log = shown.log.longest()

            def progress(seconds: float) -> None:
                self._share = min(seconds / max(shown.duration, 1e-3), 1.0)

            other = _again(log, closed_loop, progress, position_delay=position_delay, force_delay=force_delay)
            again = Playback(log, other, name=shown.name)
            again.go_to(shown.now)
            if self.playback is shown:
                self.playback = again
            loop = "the force moves the hand" if closed_loop else "the hand's motion is the recorded one"
            return f"Run again under {position_delay:g} s there and {force_delay:g} s back; {loop}."

        self._start(run, "Running it again …", "It cannot be run again")

    def _size(self, name: str) -> str:
        try:
            return f" ({(self._folder / name).stat().st_size / 1e6:.0f} MB)" if name in self.names() else ""
        except OSError:  # it was removed meanwhile
            return ""

    def close(self) -> None:
        """Look at none: back to the session that runs."""
        self.playback, self.note = None, ""

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until nothing is read any more, for at most so long [s]."""
        if self._job is not None:
            self._job.join(timeout)

    def _start(self, work: Callable[[], str], meanwhile: str, failed: str) -> None:
        if self.busy:
            self.note = "Another recording is still being read."
            return

        def job() -> None:
            begun = time.monotonic()
            try:
                self.note = work() or f"Read in {time.monotonic() - begun:.1f} s."
            except ForetouchError as error:
                self.note = f"{failed}: {one_line(error)}"
            except Exception as error:  # whatever a file holds, the console goes on
                self.note = f"{failed}: {type(error).__name__}: {one_line(error)}"

        self.note, self._begun, self._share = meanwhile, time.monotonic(), math.nan
        self._job = threading.Thread(target=job, name="recording", daemon=True)
        self._job.start()


def _age(path: Path, folder: Path) -> float:
    """By which recordings are sorted, the newest first; infinite for what is no file of the folder."""
    try:
        state = path.stat()
        if not stat.S_ISREG(state.st_mode) or path.resolve().parent != folder:
            return math.inf
    except (OSError, RuntimeError):  # it was removed meanwhile, or links go in a circle
        return math.inf
    return -state.st_mtime


def _again(log: SessionLog, closed_loop: bool, progress: Callable[[float], None], **changes: Any) -> SessionLog:
    """The session under other settings."""
    from foretouch.session import replay_under
    from foretouch.session.replay.machines import recorded_settings

    settings, _ = recorded_settings(log.settings, changes)
    return replay_under(log, settings, closed_loop, progress)

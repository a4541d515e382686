"""The recordings in some folders, and the one that is looked at: read and run again on separate threads."""

from __future__ import annotations

import contextlib
import math
import stat
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from foretouch.console.playback import Playback
from foretouch.errors import ForetouchError, RecordingError, one_line
from foretouch.messages import SessionLog

PATTERN = "*.mcap"
MOST = 50
"""Largest number of recordings that are listed, the newest first."""
NOT_YET = "It is being recorded just now: it shows what there was when it was chosen. Choose it again for more."
"""Note on the file that a recorder is writing."""


class Library:
    """The recordings that can be looked at, and the one that is.

    A recording is read on a separate thread; meanwhile and afterwards `note` gives its progress and result in one
    line. An unreadable one gives a line, no error.

    Args:
        folders: Folders of the recordings; one that is named twice counts once.

    Attributes:
        playback: The recording that is looked at, None for none.
        being_written: File that the session is being recorded into; "" for none.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = tuple({folder.resolve(): folder for folder in folders}.values())
        self.being_written = ""
        self._job: threading.Thread | None = None
        self._begun, self._share = 0.0, math.nan  # of the job: when it began [s], how much of it is done
        self._said = ""
        self.playback: Playback | None = None

    def names(self) -> tuple[str, ...]:
        """Names of the recordings, the newest first: files of these folders, no pipes, devices or links out of them.

        With several folders, that of a file stands before its name, but for the current one.
        """
        return tuple(self._listed())

    @property
    def where(self) -> str:
        """Which folders these are, in a sentence."""
        return f"Of {' and '.join(str(folder.resolve()) for folder in self._folders)}, the newest first."

    def _listed(self) -> dict[str, Path]:
        """The recordings by name, the newest first."""
        found = []
        for folder in self._folders:
            with contextlib.suppress(OSError):
                resolved = folder.resolve()
                found += [(_age(path, resolved), self._name(path, folder), path) for path in folder.glob(PATTERN)]
        return {name: path for age, name, path in sorted(found)[:MOST] if math.isfinite(age)}

    def _name(self, path: Path, folder: Path) -> str:
        alone = len(self._folders) == 1 or folder.resolve() == Path.cwd()
        return path.name if alone else str(path)

    @property
    def busy(self) -> bool:
        """Whether a recording is being read or run again."""
        return self._job is not None and self._job.is_alive()

    @property
    def note(self) -> str:
        """Status in one line, with the progress while something is read or run; "" for none."""
        if not self.busy or not self._said.endswith("…"):
            return self._said
        done = f" {100.0 * self._share:.0f} %," if math.isfinite(self._share) else ""
        return f"{self._said}{done} {time.monotonic() - self._begun:.0f} s"

    @note.setter
    def note(self, said: str) -> None:
        self._said = said

    def open(self, name: str) -> None:
        """Look at one of `names` from its beginning, paused; whatever else it is, nothing is opened."""

        def read() -> str:
            path = self._listed().get(name)
            if path is None:
                raise RecordingError("the recording", "is none that is listed")
            from foretouch.recordings import read_session

            log = read_session(path)
            self.playback = Playback(log, name=name)
            if not log.counts.get("truncated"):
                return ""
            return NOT_YET if self._is_being_written(path) else "It ends before its session did."

        self._start(read, f"Reading {name}{self._size(name)} …", "This recording cannot be looked at")

    def run_again(self, position_delay: float, force_delay: float, *, closed_loop: bool) -> None:
        """Run the recorded session again under other one-way delays [s], there and back, beside what was recorded."""
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
            path = self._listed().get(name)
            return "" if path is None else f" ({path.stat().st_size / 1e6:.0f} MB)"
        except OSError:  # it was removed meanwhile
            return ""

    def _is_being_written(self, path: Path) -> bool:
        return bool(self.being_written) and path.resolve() == Path(self.being_written).resolve()

    def close(self) -> None:
        """Look at none: back to the session that runs."""
        self.playback, self.note = None, ""

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until nothing is read any more, for at most this time [s]."""
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

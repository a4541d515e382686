"""Recordings that can be looked at, and one at a moment of one's choice: what a live session shows, and no more."""

from __future__ import annotations

import contextlib
import math
import stat
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from foretouch.console.history import NAN, Array, LossTrace, Window, columns_of, empty_window, window_of
from foretouch.console.models_seen import ModelsSeen
from foretouch.console.space_state import RecordedSpace
from foretouch.console.watched import Watched
from foretouch.errors import ForetouchError, RecordingError, one_line
from foretouch.messages import SessionLog, settings_at
from foretouch.quantities import Rows

TOLERANCE = 1e-6  # A tick counts as being at a moment that is at most this much before it [s]


class Playback(Watched):
    """State of a recorded session as received at `now`, which goes on while it is played; see `Watched`.

    For a session in which a side began again, the longest segment: `duration` is from the leader's first tick to its
    last [s]. `other` is a second run of it, which is shown beside it at the same moment. A RecordingError says that
    nothing was recorded of the leader.
    """

    def __init__(self, log: SessionLog, other: SessionLog | None = None, *, name: str = "") -> None:
        super().__init__()
        self.log, self.name = log, name
        self.other = None if other is None else Playback(other)
        self.playing, self._clock = False, math.nan
        segment = self._segment = log.longest()
        leader, follower = self._leader, self._follower = segment.leader, segment.follower
        if not leader.size:
            raise RecordingError("the recording", "holds nothing of a leader: there is nothing to show over time")
        self._seconds: Array = (leader["time_ns"] - leader["time_ns"][0]) * 1e-9
        self.duration = float(self._seconds[-1])
        self.space = self._recorded_space = RecordedSpace(segment)
        exact = bool(follower.size) and bool(np.isfinite(follower["exact_force"]).all())
        self._columns = columns_of(leader, follower, "exact_force" if exact else "force")
        run = int(follower["run"][-1]) if follower.size else 0
        self._by_sequence = {model.sequence: model for model in log.models if run in (0, model.run)}
        self._models = ModelsSeen(most=None)
        for model in self._by_sequence.values():
            self._models.add(model)
        for row in np.flatnonzero(np.diff(leader["model_sequence"], prepend=0) > 0):
            self._models.adopt(int(leader["time_ns"][row]) * 1e-9, int(leader["model_sequence"][row]))
        self.go_to(0.0)

    def go_to(self, now: float) -> None:
        """Show another moment since the leader's first tick [s], held within the recording."""
        self.now = min(max(now, 0.0), self.duration) if math.isfinite(now) else 0.0
        row = int(np.searchsorted(self._seconds, self.now + TOLERANCE, side="right")) - 1
        self.leader, self.telemetry = self._recorded_space.go_to(row)
        self.settings = self._segment.settings
        if self._segment.reports:  # a network can be changed while a session runs
            begun, felt = self._follower[:1], self.telemetry
            felt_ns = felt.time_ns if felt is not None else int(begun["time_ns"][0]) if begun.size else None
            run, times = int(begun["run"][0]) if begun.size else 0, (self.leader.time_ns, felt_ns)
            self.settings = settings_at(self._segment.reports, self.leader.epoch, run, *times)
        self.model = self._by_sequence.get(int(self._leader["model_sequence"][row]))
        self._clock = math.nan
        if self.other is not None:
            self.other.go_to(now)

    def play(self, playing: bool) -> None:
        """Go on, or pause; at the end, go on from the beginning."""
        if playing and self.now >= self.duration:
            self.go_to(0.0)
        self.playing, self._clock = playing, math.nan

    def tick(self, clock: float) -> None:
        """Let the recording's time go on as the clock [s] did since the last tick."""
        if not self.playing:
            return
        if math.isfinite(since := clock - self._clock):
            self.go_to(self.now + since)
        self._clock = clock
        self.playing = self.now < self.duration

    @property
    def robot_position(self) -> float:
        """Position of the robot as last received by the operator's side [m]; NaN before."""
        return NAN if self.telemetry is None else self.telemetry.position

    def window(self, seconds: float) -> Window:
        """Forces, energy and delay of the seconds before `now`."""
        first, last = np.searchsorted(self._seconds, (self.now - seconds, self.now + TOLERANCE), side="right")
        part = slice(int(first), int(last))
        if part.stop <= part.start:
            return empty_window()
        columns = self._columns[part]
        return window_of(self._leader["sequence"][part], columns, float(columns[-1, 0]), seconds, 400)

    @property
    def model_age(self) -> float:
        """Not told of a recording: its report has it."""
        return NAN

    def rows(self) -> tuple[Rows, Rows]:
        """Ticks of the leader and the follower in the whole recording."""
        return self._leader, self._follower

    def loss_trace(self, seconds: float, now: float) -> LossTrace:
        """Nothing: a recording has its losses in all, and not over time."""
        none = np.empty(0)
        return LossTrace(none, none, none)


PATTERN = "*.mcap"
MOST = 50  # Largest number of recordings that are listed, the newest first
NOT_YET = "It is being recorded just now: it shows what there was when it was chosen. Choose it again for more."
"""Note on the file that a recorder is writing."""


class Library:
    """The recordings of some folders that can be looked at, and the one that is; a folder named twice counts once.

    A recording is read on a separate thread; meanwhile and afterwards `note` gives its progress and result in one
    line. An unreadable one gives a line, no error.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders = tuple({folder.resolve(): folder for folder in folders}.values())
        self.being_written = ""
        self._job: threading.Thread | None = None
        self._begun, self._progress = 0.0, math.nan  # of the job: when it began [s], and its fraction that is done
        self._note = ""
        self.playback: Playback | None = None

    def names(self) -> tuple[str, ...]:
        """Names of the recordings, the newest first: files of these folders, no pipes, devices or links out of them.

        With several folders, that of a file precedes its name, but for the current one.
        """
        return tuple(self._listed())

    @property
    def where(self) -> str:
        """The folders, in a sentence."""
        return f"Of {' and '.join(str(folder.resolve()) for folder in self._folders)}, the newest first."

    def _listed(self) -> dict[str, Path]:
        listed = []
        for folder in self._folders:
            with contextlib.suppress(OSError):
                resolved = folder.resolve()
                alone = len(self._folders) == 1 or resolved == Path.cwd()
                paths = tuple(folder.glob(PATTERN))
                listed += [(_age(path, resolved), path.name if alone else str(path), path) for path in paths]
        return {name: path for age, name, path in sorted(listed)[:MOST] if math.isfinite(age)}

    @property
    def busy(self) -> bool:
        """Whether a recording is being read or run again."""
        return self._job is not None and self._job.is_alive()

    @property
    def note(self) -> str:
        """Status in one line, with the progress while something is read or run; "" for none."""
        if not self.busy or not self._note.endswith("…"):
            return self._note
        done = f" {100.0 * self._progress:.0f} %," if math.isfinite(self._progress) else ""
        return f"{self._note}{done} {time.monotonic() - self._begun:.0f} s"

    @note.setter
    def note(self, text: str) -> None:
        self._note = text

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
            growing = bool(self.being_written) and path.resolve() == Path(self.being_written).resolve()
            return NOT_YET if growing else "It ends before its session did."

        size = ""
        with contextlib.suppress(OSError):  # it was removed meanwhile
            if (path := self._listed().get(name)) is not None:
                size = f" ({path.stat().st_size / 1e6:.0f} MB)"
        self._start(read, f"Reading {name}{size} …", "This recording cannot be looked at")

    def run_again(self, position_delay: float, force_delay: float, *, closed_loop: bool) -> None:
        """Run the recorded session again under other one-way delays [s], there and back, beside what was recorded."""
        shown = self.playback
        if shown is None:
            return

        def run() -> str:
            log = shown.log.longest()

            def progress(seconds: float) -> None:
                self._progress = min(seconds / max(shown.duration, 1e-3), 1.0)

            from foretouch.session import replay_under
            from foretouch.session.replay.machines import recorded_settings

            changes = {"position_delay": position_delay, "force_delay": force_delay}
            settings, _ = recorded_settings(log.settings, changes)
            again = Playback(log, replay_under(log, settings, closed_loop, progress), name=shown.name)
            again.go_to(shown.now)
            if self.playback is shown:
                self.playback = again
            loop = "the force moves the hand" if closed_loop else "the hand's motion is the recorded one"
            return f"Run again under {position_delay:g} s there and {force_delay:g} s back; {loop}."

        self._start(run, "Running it again …", "It cannot be run again")

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

        self.note, self._begun, self._progress = meanwhile, time.monotonic(), math.nan
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

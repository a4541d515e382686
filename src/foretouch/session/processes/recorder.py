"""The recorder: a separate process that listens to both sides and writes what it receives."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

from foretouch.errors import PeerVersionError, RecordingError, plural, was_or_were
from foretouch.link import SequenceCounter, ZenohLink
from foretouch.messages import COUNT_PREFIX, FieldUpdate, Hello, Hellos, LeaderState, Message, ModelUpdate, Telemetry
from foretouch.recordings import SessionWriter
from foretouch.session.network.lease import ContestPrinter
from foretouch.session.runners.housekeeping import ORPHANED, Greeter, StopFlag, orphaned

RECORDER_CHANNELS = (
    "telemetry",
    "leader",
    "model",
    "hello",
    "settings",
    "stop",
    "emergency",
    "field",
    "fixture",
    "image",
)
"""Channels that the recorder's link receives and the recording holds."""

RECORDING_INCOMPLETE = 3
"""Exit code of a recorder, and of a session, whose recording is incomplete or not at the requested path."""

FLUSH_PERIOD = 0.4  # Time between two flushes [s]: a killed recorder loses that much
POLL_PERIOD = 0.02  # Time between two checks of the inboxes [s]
GRACE = 1.0  # Time for which listening goes on after a `Stop`, for the last messages of the other side [s]

MOST_PROCESSES = 64
"""Largest number of starts of a side whose gaps in the sequence are counted as messages missing from the recording."""


class Recorder:
    """Writes the messages it is given, counts those missing, and goes on without a file where one cannot be written.

    Args:
        path: The MCAP file.

    Attributes:
        path: Path of the file: another one once the folder was removed.
        problem: Why the recording is incomplete or not at the requested path; "" while it is neither.
        roles: Roles that have sent a `Hello`.

    Raises:
        RecordingError: The file cannot be begun.
    """

    def __init__(self, path: Path) -> None:
        self._writer = SessionWriter(path)
        self._writing = True
        self.path = path
        self.problem = ""
        self._hellos = Hellos()
        self.roles: set[str] = set()
        self._sequences: dict[tuple[str, int], SequenceCounter] = {}

    def take(self, name: str, arrivals: list[tuple[int, Message]]) -> None:
        """Record the messages of one channel with the times [ns] at which they arrived."""
        for arrival, message in arrivals:
            if isinstance(message, Telemetry | ModelUpdate | FieldUpdate):
                self._count(name, message.run, message.sequence)
            elif isinstance(message, LeaderState):
                self._count(name, message.epoch, message.sequence)
            elif isinstance(message, Hello):
                self.roles.add(message.role)
                self._hellos.take(message)
            if self._writing:
                self._try(self._writer.write, message, arrival)

    def _count(self, name: str, process: int, number: int) -> None:
        """Count gaps: each process of a side numbers its messages from 1."""
        if (name, process) not in self._sequences and len(self._sequences) < MOST_PROCESSES:
            self._sequences[name, process] = SequenceCounter()
        if sequence := self._sequences.get((name, process)):
            sequence.is_newest(number)

    @property
    def counts(self) -> dict[str, int]:
        """Counters that the sides have sent."""
        return self._hellos.counts

    def flush(self) -> None:
        """Flush to the operating system."""
        if self._writing:
            self._try(self._writer.flush)

    def close(self, counts: dict[str, int]) -> None:
        """Complete the file with these counters."""
        if self._writing:
            self._try(self._writer.close, counts)

    @property
    def missed(self) -> int:
        """Number of messages between the first and the newest of each side that have not arrived here."""
        return sum(sequence.lost for sequence in self._sequences.values())

    @property
    def kept(self) -> str:
        """Text on how much of the session is in the file."""
        kept = self._writer.kept_ns
        return f"{(kept[1] - kept[0]) * 1e-9:.1f} s are kept in {self.path}" if kept else "nothing was recorded"

    def _try(self, action: Callable[..., None], *arguments: object) -> None:
        try:
            action(*arguments)
        except RecordingError as error:
            self._writing = False
            self.problem = str(error)
            self._writer.close()
            return
        if self._writer.path != self.path:
            self.problem = f"{self.path}: was removed while it was written; it goes on as {self._writer.path}"
            self.path = self._writer.path


def run_recorder(
    link: ZenohLink, path: Path, *, stop: StopFlag, say: Callable[[str], None], parent: int | None = None
) -> str:
    """Record until a `Stop` has arrived or `stop` is set, then close the file.

    Once both sides have been received it sends `Hello` itself, twice a second, so that a leader may wait for it and all
    see what it missed. Where the disk is full or the file was removed it reports that at once, here and in its `Hello`
    as ``recorder_failed``, and keeps running.

    Args:
        link: Link with `RECORDER_CHANNELS`.
        path: The MCAP file.
        stop: Checked in every round.
        say: Prints one line for people.
        parent: Process whose end ends this one.

    Returns:
        Why the recording is incomplete or not at the requested path; "" if it is neither.

    Raises:
        RecordingError: The file cannot be begun.
        PeerVersionError: All messages received are of another version; no file is left.
    """
    recorder = Recorder(path)
    try:
        _listen(link, recorder, stop, say, parent)
    finally:
        problem = recorder.problem
        recorder.close(recorder.counts | _counts(link, recorder))
    if not recorder.roles and (error := _other_version(link, parent)) is not None:
        recorder.path.unlink(missing_ok=True)
        raise error
    counts = _counts(link, recorder)
    if count := counts["recorder_undecodable"]:
        say(f"recorder: {plural(count, 'message')} did not decode and {was_or_were(count)} dropped")
    if count := counts["recorder_dropped"]:
        say(f"recorder: {plural(count, 'message')} came too fast to be written")
    if recorder.problem != problem:
        say(f"recorder: {recorder.problem}; {recorder.kept}")
    elif not problem:
        say(f"recorder: wrote {recorder.path}; next: foretouch report {recorder.path}")
    return recorder.problem


def _listen(
    link: ZenohLink, recorder: Recorder, stop: StopFlag, say: Callable[[str], None], parent: int | None
) -> None:
    """Record until the end; report a problem as soon as it occurs."""
    problem, greeter = "", Greeter(link, "recorder")
    contest = ContestPrinter("recorder", say, parent)
    flushed, end = time.monotonic(), math.inf
    while not stop.reason and (now := time.monotonic()) <= end:
        for name in RECORDER_CHANNELS:
            arrivals = link.take(name)
            recorder.take(name, arrivals)
            for _, message in arrivals if name == "hello" else ():
                contest.take(message)
            if name == "stop" and arrivals:
                end = min(end, now + GRACE)
        if now - flushed >= FLUSH_PERIOD:
            flushed = now
            recorder.flush()
            if orphaned(parent):
                stop.set(ORPHANED)
        if recorder.problem != problem:
            problem = recorder.problem
            greeter.hurry()
            say(f"recorder: {problem}; {recorder.kept}; the session goes on")
        if greeter.due() and (problem or {"leader", "follower"} <= recorder.roles):
            texts = {COUNT_PREFIX + name: str(count) for name, count in _counts(link, recorder).items()}
            greeter.greet(texts | ({"recorder_failed": problem} if problem else {}))
        if not recorder.roles and _other_version(link, parent) is not None:
            return
        time.sleep(POLL_PERIOD)


def _other_version(link: ZenohLink, parent: int | None) -> PeerVersionError | None:
    """Error if nothing of this session can be recorded; processes of one parent are of one version."""
    return link.other_version() if parent is None else None


def _counts(link: ZenohLink, recorder: Recorder) -> dict[str, int]:
    """Counters of what is missing from the recording."""
    return {
        "recorder_undecodable": link.undecodable,
        "recorder_dropped": link.dropped,
        "recorder_missed": recorder.missed,
    }

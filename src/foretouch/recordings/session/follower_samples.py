"""Measurements of a session's follower, as needed to learn from a recording; kept beside a long one."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural
from foretouch.files import within_budget
from foretouch.messages import SessionLog
from foretouch.messages.session_log import believable, side_seconds
from foretouch.quantities import ByValue, Recording
from foretouch.recordings.output import atomic_path
from foretouch.recordings.session.reader import read_samples

Array = NDArray[np.float64]

LARGE = 50_000_000  # size [bytes], some minutes, from which on the samples of a recording are kept in a file beside it

VERSION = 1
"""Version of the form of that file."""

_COLUMNS = ("time", "position", "force", "faults", "fault_counts")
_COUNTS = ("segments", "leader_starts", "follower_starts")


@dataclass(frozen=True, eq=False)
class FollowerSamples(ByValue):
    """The samples of the follower's process of the longest segment (`SessionLog.longest`), and what is not among them.

    Attributes:
        time: Time since the first of them [s], shape (n,).
        position: Position of the probe [m], shape (n,).
        force: Sensor force, offset included [N], shape (n,).
        faults: Kinds of samples that were left out because the sensors were not to be trusted, `validity` of
            `Telemetry`, shape (k,).
        fault_counts: Number of each, shape (k,).
        segments: Number of segments of the session.
        leader_starts: Number of processes of the leader that were received from.
        follower_starts: Number of processes of the follower.
        seconds: Duration of the longest segment [s].
    """

    time: Array
    position: Array
    force: Array
    faults: NDArray[np.int64]
    fault_counts: NDArray[np.int64]
    segments: int
    leader_starts: int
    follower_starts: int
    seconds: float


def follower_samples(log: SessionLog) -> FollowerSamples:
    """The samples of a session.

    Args:
        log: Of `read_session`, or of `read_samples`.
    """
    follower, segment = log.follower, log.longest()
    if segment.follower.size:
        follower = follower[follower["run"] == segment.follower["run"][0]]
    believed = follower[believable(follower)]
    kinds, counts = np.unique(segment.follower["validity"], return_counts=True)
    begin = believed["time_ns"][0] if believed.size else 0
    return FollowerSamples(
        (believed["time_ns"] - begin) / 1e9,
        believed["position"].astype(np.float64),
        believed["sensor_force"].astype(np.float64),
        kinds[kinds > 0],
        counts[kinds > 0],
        len(log.segments()),
        int(np.unique(log.leader["epoch"]).size),
        int(np.unique(log.follower["run"]).size),
        max(side_seconds(segment.leader), side_seconds(segment.follower)),
    )


def read_follower_samples(path: str | PathLike[str]) -> FollowerSamples:
    """The samples of a session's MCAP file.

    Those of a file of 50 MB or more are kept in a file beside it, `NAME.mcap.samples`, where that can be written, and
    taken from there as long as the recording stays as it is: same length, same time of change.

    Raises:
        RecordingError: As `read_session`.
        MissingExtraError: As `read_session`.
    """
    return within_budget(path, None, _samples_of, path)


def _samples_of(path: str | PathLike[str]) -> FollowerSamples:
    kept = Path(f"{path}.samples")
    label = _label(path)
    if label and kept.is_file():
        with contextlib.suppress(Exception):  # whatever is wrong with what was kept, the recording is still there
            return _load(kept, label)
    samples = follower_samples(read_samples(path))
    if label:
        with contextlib.suppress(RecordingError, OSError):  # a folder that is not ours: then it is read again
            _save(kept, label, samples)
    return samples


def read_follower(path: str | PathLike[str], *, flip: bool = False) -> Recording:
    """The follower's own measurement in a session: positions and the sensor force with its offset.

    Samples whose sensors were not to be trusted are left out, as the session itself learnt nothing from them. Of
    several processes of the follower it is that of the longest segment (`SessionLog.longest`).
    """
    samples = read_follower_samples(path)
    if samples.time.size < 2:
        without = " with sensors that could be believed" if samples.faults.size else ""
        there = plural(samples.time.size, "sample")
        raise RecordingError(path, f"{there} of the follower{without}: at least 2 are needed")
    position = -samples.position if flip else samples.position
    return Recording(samples.time, position, samples.force, name=str(path))


def _label(path: str | PathLike[str]) -> str:
    """Identity of the recording that a kept file belongs to; empty where none is kept."""
    try:
        about = Path(path).stat()
    except OSError:
        return ""
    return json.dumps([VERSION, about.st_size, about.st_mtime_ns]) if about.st_size >= LARGE else ""


def _load(kept: Path, label: str) -> FollowerSamples:
    """Raises `ValueError` where it is of another recording."""
    with kept.open("rb") as handle, np.load(handle, allow_pickle=False) as file:
        if str(file["label"]) != label:
            raise ValueError("of another recording")
        columns: dict[str, Any] = {name: file[name] for name in _COLUMNS}
        columns |= dict(zip(_COUNTS, file["starts"].tolist(), strict=True))
        return FollowerSamples(**columns, seconds=float(file["seconds"]))


def _save(kept: Path, label: str, samples: FollowerSamples) -> None:
    columns = {name: getattr(samples, name) for name in _COLUMNS}
    starts = np.array([getattr(samples, name) for name in _COUNTS])
    with atomic_path(kept) as beside, beside.open("wb") as file:
        np.savez(file, label=np.array(label), starts=starts, seconds=np.array(samples.seconds), **columns)

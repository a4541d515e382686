"""What a recording says frame by frame, as those who train policies want it, and every sample between two frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, SettingError
from foretouch.messages import MOST_JOINTS, ModelUpdate, SessionLog
from foretouch.messages.session_log import believable
from foretouch.quantities import Array, ByValue, Recording, Rows, parameter_unit
from foretouch.recordings.formats.topics import parameter_names
from foretouch.recordings.meaning.names import RecordingOptions
from foretouch.recordings.reading import is_session, read_with_notes
from foretouch.recordings.session.reader import read_session

Single: TypeAlias = NDArray[np.float32]
"""Numbers as they are written: a policy computes with no more digits."""

Named: TypeAlias = dict[str, Single]
"""Columns of one length by name; a name ends in its unit."""

STATE, WRENCH, ACTION = "observation.state", "observation.wrench", "action"
POSITIONS, FORCES, TIMES = "samples.position", "samples.wrench", "samples.time"

AXES: Final = ("x", "y", "z")
LINE: Final = {
    STATE: {"position_m": "position"},
    WRENCH: {"force_N": "force"},
    ACTION: {"position_m": "desired_position"},
}
"""Columns of the follower along a line by the names that they get."""
SPACE: Final = {
    STATE: {f"{axis}_m": f"place_{axis}" for axis in AXES},
    WRENCH: {f"force_{axis}_N": f"force_{axis}" for axis in AXES},
    ACTION: {f"{axis}_m": f"desired_{axis}" for axis in AXES},
}
"""The same in space."""
JOINTS: Final = {f"joint_{number}_rad": f"joint_{number}" for number in range(1, MOST_JOINTS + 1)}
FIXTURE: Final = {f"{axis}_m": f"fixture_{axis}" for axis in AXES} | {
    f"r{axis}_rad": f"fixture_r{axis}" for axis in AXES
}

FASTEST: Final = 1000  # frames a second
MOST_FRAMES: Final = 10_000_000  # four days at 30 a second
SAME_TIME: Final = 1e-9  # a sample that is late by less is of the frame's own time [s]


@dataclass(frozen=True, eq=False)
class Episode(ByValue):
    """One recording, frame by frame.

    A frame has what was known when it was taken: the newest sample up to its time, never one behind it. What can be
    missing is NaN there; what `observation` and `action` begin the name of never is.

    Attributes:
        name: Name of the recording, for messages.
        fps: Frames a second.
        features: By the name of each feature its columns, shape (n,) each, for n frames.
        samples: The same of all samples up to the last frame, shape (m,) each; times are those since the frame [s],
            0 or less.
        ends: Number of samples up to each frame, shape (n,).
        images: JPEG of the camera for each frame, or none at all.
        notes: Sentences on how it was read.
    """

    name: str
    fps: int
    features: dict[str, Named]
    samples: dict[str, Named]
    ends: NDArray[np.int64]
    images: tuple[bytes, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.ends.size)


def read_episode(path: str | PathLike[str], options: RecordingOptions | None = None, *, fps: int = 30) -> Episode:
    """A recording frame by frame.

    Of a session it is the segment in which both sides were present longest, without samples whose sensors were not to
    be trusted, and from the camera's first image on where it has images. The leader's forces are those at the command
    that the robot had applied, and the model is the newest that the follower had sent. A follower that only watched has
    no action, and any other recording has positions and forces alone.

    Args:
        path: As `read_recording` takes it.
        options: Likewise; none for a session.
        fps: Frames a second, 1 to 1000.

    Raises:
        RecordingError: It cannot be read, holds no sample that could be trusted, or would have over 10 million frames.
        SettingError: Another number of frames a second.
        MissingExtraError: The format needs a package of the extra ``recordings``.
    """
    if isinstance(fps, bool) or not isinstance(fps, int) or not 1 <= fps <= FASTEST:
        raise SettingError("fps", fps, f"must be a whole number of frames a second from 1 to {FASTEST}")
    options = options or RecordingOptions()
    if options.map_file is None and is_session(path):
        if options != RecordingOptions():
            raise RecordingError(path, "is a session, which states units and signs: leave options for these out")
        return _of_session(str(path), read_session(path), fps)
    read = read_with_notes(path, options)
    return _of_recording(str(path), read.recording, fps, read.notes)


def _of_recording(name: str, recording: Recording, fps: int, notes: tuple[str, ...]) -> Episode:
    columns = {STATE: {"position_m": _single(recording.position)}, WRENCH: {"force_N": _single(recording.force)}}
    whole = _require_some(name, np.ones(len(recording), dtype=np.bool_), columns)
    columns = _chosen(columns, whole)
    frames = _Frames(name, recording.time[whole], fps)
    return Episode(name, fps, _chosen(columns, frames.newest), frames.every(columns), frames.ends, notes=notes)


def _of_session(name: str, log: SessionLog, fps: int) -> Episode:
    segment = log.longest()
    rows, space = _together(segment.follower, log.follower_space)
    images = _images(log, rows)
    columns: dict[str, Named] = {}
    for feature, named in (SPACE if space.size else LINE).items():
        columns[feature] = _named(space if space.size else rows, named)
    if space.size:
        joints = _named(space, JOINTS)
        columns[STATE] |= {joint: values for joint, values in joints.items() if np.isfinite(values).any()}
    if not all(np.isfinite(values).any() for values in columns[ACTION].values()):
        del columns[ACTION]  # a follower that only watched has commanded nothing
    trusted = believable(rows)
    if images:
        trusted &= rows["sequence"] >= min(images)
    whole = _require_some(name, trusted, columns)
    columns, rows, space = _chosen(columns, whole), rows[whole], space[whole] if space.size else space
    frames = _Frames(name, (rows["time_ns"] - rows["time_ns"][0]) / 1e9, fps)
    at = rows[frames.newest]
    features = _chosen(columns, frames.newest)
    features |= _leader(segment.leader, at["command_sequence"]) | _models(segment.models, at["model_sequence"])
    if space.size:
        features["model.fixture"] = _named(space[frames.newest], FIXTURE)
    return Episode(name, fps, features, frames.every(columns), frames.ends, _shown(images, at["sequence"]))


def _single(values: Any) -> Single:
    """Numbers in single precision; what is too large for it is infinite, as what the sensors cannot mean."""
    with np.errstate(over="ignore"):
        return np.asarray(values).astype(np.float32)


def _require_some(name: str, trusted: NDArray[np.bool_], columns: Mapping[str, Named]) -> NDArray[np.bool_]:
    """Which samples are to be trusted and have every number; a RecordingError where none has."""
    for named in columns.values():
        for values in named.values():
            trusted = trusted & np.isfinite(values)
    if not trusted.any():
        raise RecordingError(name, "holds no sample with sensors that could be believed: there is nothing to write")
    return trusted


def _chosen(columns: Mapping[str, Named], rows: Any) -> dict[str, Named]:
    return {feature: {name: values[rows] for name, values in named.items()} for feature, named in columns.items()}


def _together(rows: Rows, space: Rows) -> tuple[Rows, Rows]:
    """The follower's rows in their order and, in space, those of the same ticks, of which a line has none."""
    rows = rows[np.unique(rows["sequence"], return_index=True)[1]]
    own = space[space["run"] == rows["run"][0]] if rows.size else space[:0]
    if not own.size:
        return rows, own
    _, here, there = np.intersect1d(rows["sequence"], own["sequence"], return_indices=True)
    return rows[here], own[there]


def _named(rows: Rows, named: Mapping[str, str]) -> Named:
    return {name: _single(rows[column]) for name, column in named.items()}


class _Frames:
    """Frames of equal distance from the first sample on.

    Attributes:
        ends: Number of samples up to each frame.
        newest: The newest of them.
    """

    def __init__(self, name: str, time: Array, fps: int) -> None:
        self._time = time - time[0]
        count = math.floor((float(self._time[-1]) + SAME_TIME) * fps) + 1
        if count > MOST_FRAMES:
            problem = f"lasts {self._time[-1]:.6g} s, {count:,} frames at {fps} a second: the most are {MOST_FRAMES:,}"
            raise RecordingError(name, problem)
        self._begins = np.arange(count) / fps
        self.ends = np.searchsorted(self._time, self._begins + SAME_TIME, side="right").astype(np.int64)
        self.newest = self.ends - 1

    def every(self, columns: Mapping[str, Named]) -> dict[str, Named]:
        """All samples up to the last frame, and their times since the frame that knows them first."""
        count = int(self.ends[-1])
        frame = np.searchsorted(self.ends, np.arange(count), side="right")
        since = _single(np.minimum(self._time[:count] - self._begins[frame], 0.0))
        places = {name: values for name, values in columns[STATE].items() if name not in JOINTS}
        return {TIMES: {"time_s": since}} | _chosen({POSITIONS: places, FORCES: columns[WRENCH]}, slice(count))


def _leader(leader: Rows, commands: Any) -> dict[str, Named]:
    """What the leader predicted, and which delayed force it had, in the ticks that made these commands."""
    shown = {
        "leader.predicted_force": {"force_N": "predicted_force", "standard_deviation_N": "standard_deviation"},
        "leader.delayed_force": {"force_N": "delayed_force"},
    }
    leader = leader[np.argsort(leader["sequence"], kind="stable")]
    row = np.searchsorted(leader["sequence"], commands)
    known = row < leader.size
    known[known] = leader["sequence"][row[known]] == commands[known]
    return {
        feature: {name: _where(known, leader[column], row) for name, column in named.items()}
        for feature, named in shown.items()
    }


def _where(known: NDArray[np.bool_], values: Any, row: NDArray[Any]) -> Single:
    """Values of these rows where they are known, elsewhere NaN."""
    output = np.full(known.size, np.nan, dtype=np.float32)
    output[known] = _single(values[row[known]])
    return output


def _models(models: tuple[ModelUpdate, ...], sequences: Any) -> dict[str, Named]:
    """The newest model at each frame: its law's numbers with their standard errors, and where its surface is."""
    numbers: dict[str, dict[str, Array]] = {"model.parameters": {}, "model.standard_errors": {}}
    for row, model in enumerate(models):
        names = _parameter_names(model)
        for feature, values in zip(numbers, (model.parameters, model.standard_errors), strict=True):
            for name, value in zip(names, values, strict=False):
                numbers[feature].setdefault(name, np.full(len(models), np.nan))[row] = value
    numbers["model.surface"] = {"position_m": np.array([model.surface for model in models])}
    numbers["model.valid"] = {"valid": np.array([model.valid for model in models])}
    row_of = np.searchsorted([model.sequence for model in models], sequences, side="right") - 1
    return {
        feature: {name: _where(row_of >= 0, values, row_of) for name, values in named.items()}
        for feature, named in numbers.items()
    }


def _parameter_names(model: ModelUpdate) -> tuple[str, ...]:
    """Names of a model's numbers with their units; of a law that is not known here the law and a number."""
    names = parameter_names(model.law, len(model.parameters))
    units = (parameter_unit(name, names) for name in names)
    named = tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True))
    return named or tuple(f"{model.law} {number}" for number in range(len(model.parameters)))


def _images(log: SessionLog, rows: Rows) -> dict[int, bytes]:
    """The camera's images by the follower's tick that each shows."""
    if not rows.size:
        return {}
    run, last = rows["run"][0], rows["sequence"][-1]
    shown = (image for image in log.images if image.jpeg and image.run == run and image.tick <= last)
    return dict(sorted((image.tick, image.jpeg) for image in shown))


def _shown(images: Mapping[int, bytes], ticks: Any) -> tuple[bytes, ...]:
    """The newest image at each of these ticks."""
    if not images:
        return ()
    every = tuple(images.values())
    newest = np.searchsorted(list(images), ticks, side="right") - 1
    return tuple(every[number] for number in newest)

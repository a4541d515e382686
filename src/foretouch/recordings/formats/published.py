r"""Measured recordings as others published them, and the excerpts that the package carries of them.

The originals are presses of the TU/e one-degree-of-freedom teleoperation experiment (MATLAB ``.mat``), where a person
moves the leader lever and the follower lever presses a material, both 0.075 m long, sampled at 2 kHz; and skin
indentations measured with an Aurora dual-mode motor (``.ddf``, text, volts at 2 kHz).

An excerpt has time, position and force as integers, in a small part of the original's size. Sensors count: encoders in
steps, converters in volts over a power of two. An excerpt keeps these counts :math:`c` and how many of them make one
unit of SI, :math:`u`, and stores the first count and then differences, which are small:

.. math:: q_i = \frac{1}{u} \sum_{j \le i} \Delta c_j

The originals were rounded in another order, to other last bits. A second column gives that difference in units in the
last place, so that the numbers are the original's bit by bit: on some recordings of something rigid an
estimator makes several percent of a difference of :math:`10^{-15}` m. A column that is no sensor's count but a filtered
one is rounded to the nearest count, and has no such second column.

It is an ``.npz`` of NumPy, which every installation reads; of Parquet the reader, pyarrow, comes with an extra.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.files import within_budget
from foretouch.quantities import Recording
from foretouch.recordings.meaning.names import FORCE_CHANNELS
from foretouch.recordings.output import atomic_path
from foretouch.recordings.source import foreign, reading

Array = NDArray[np.float64]

SUFFIX: Final = ".npz"

FORCES: Final = dict(zip(FORCE_CHANNELS, ("force", "logged_force"), strict=True))  # the column of each force channel
LAST: Final = "_last"  # suffix of a column's name for its units in the last place
LEADER: Final = "leader_position"  # the column of the motion of the leader's lever, where a recording has one


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Origin of an excerpt, its contact floor [N], and by column its counts per second, metre or newton."""

    name: str
    original: str
    sha256: str
    licence: str
    contact_floor: float
    counts_per_unit: dict[str, float]


class Excerpt(NamedTuple):
    """An excerpt in memory."""

    about: About  # what it is made from
    # ``time`` [s], ``position`` [m] and ``force`` [N], perhaps ``logged_force`` [N] and ``leader_position`` [m], each
    # of shape (n,); signs are those of `Recording`
    columns: dict[str, Array]


def read_excerpt(path: str | PathLike[str]) -> Excerpt:
    """An excerpt from its file."""
    try:
        with reading(path), open(path, "rb") as file, np.load(file, allow_pickle=False) as held:
            about = msgspec.json.decode(str(held["about"]), type=About)
            columns = {
                name: _quantity(held[name], counts, held.get(f"{name}{LAST}"))
                for name, counts in about.counts_per_unit.items()
            }
        if not {"time", "position", "force"} <= columns.keys():
            raise KeyError("no time, position or force")
    except RecordingError:
        raise
    except Exception:  # NumPy, zipfile and zlib raise many kinds on a damaged or foreign file
        rule = "is no excerpt of a measured recording, the only .npz that is read: save columns as CSV or Parquet"
        raise RecordingError(path, rule) from None
    return Excerpt(about, columns)


def write_excerpt(path: str | PathLike[str], about: About, columns: Mapping[str, Array]) -> None:
    """Write columns as counts, with the differences in the last place where nothing else is left."""
    steps: dict[str, Any] = {}
    for name, column in columns.items():
        counts = np.rint(column * about.counts_per_unit[name]).astype(np.int64)
        steps[name] = _smallest(np.diff(counts, prepend=0))
        last = _smallest(column.view(np.int64) - (counts / about.counts_per_unit[name]).view(np.int64))
        if last.dtype == np.int8 and last.any():
            steps[f"{name}{LAST}"] = last
    with atomic_path(path) as part, part.open("wb") as file:
        np.savez_compressed(file, about=np.array(msgspec.json.encode(about).decode()), **steps)


def recording_of(path: str | PathLike[str], force_channel: str = "raw") -> Recording:
    """The recording that an excerpt holds."""
    about, columns = read_excerpt(path)
    if FORCES[force_channel] not in columns:
        raise RecordingError(path, f"{about.name} has one force alone: leave --force-channel out")
    force = columns[FORCES[force_channel]]
    return Recording(columns["time"], columns["position"], force, name=str(path), contact_floor=about.contact_floor)


def _quantity(steps: NDArray[Any], counts_per_unit: float, last: NDArray[Any] | None) -> Array:
    if steps.dtype.kind != "i" or steps.ndim != 1 or not (np.isfinite(counts_per_unit) and counts_per_unit > 0.0):
        raise ValueError("no column of counts")
    values: Array = np.cumsum(steps, dtype=np.int64) / counts_per_unit
    if last is None:
        return values
    if last.dtype != np.int8 or last.shape != steps.shape:
        raise ValueError("no units in the last place")
    values.view(np.int64)[:] += last
    return values


def _smallest(steps: NDArray[np.int64]) -> NDArray[np.signedinteger]:
    kinds = (np.int8, np.int16, np.int32, np.int64)
    return next(steps.astype(kind) for kind in kinds if np.array_equal(steps.astype(kind), steps))


LEVER = 0.075  # length of the levers [m]
TORQUE_PER_VOLT = 0.2361  # torque on the follower lever for one volt of its force bridge [N m/V]
TUE_CONTACT_FLOOR = 0.3  # smallest force [N] that counts as contact: lever friction and inertia stay below it

_VARIABLES = ["scope", "env_est3"]


def read_tue(path: str | PathLike[str], force_channel: str = "raw") -> Recording:
    """The follower's press: position = 0.075 m times its angle, force = torque / 0.075 m.

    In these files the angle and both torques already grow while pressing.
    """
    time, angles, torques, bridge = _signals(path)
    torque = bridge * TORQUE_PER_VOLT if force_channel == "raw" else torques[:, 1]
    return Recording(time, LEVER * angles[:, 1], torque / LEVER, name=str(path), contact_floor=TUE_CONTACT_FLOOR)


def read_leader_motion(path: str | PathLike[str]) -> tuple[Array, Array]:
    """Motion of the leader lever in a TU/e file or its excerpt: a real hand.

    Returns:
        Time since the first sample [s] and position [m], 0.075 m times the leader's angle, growing with depth.

    Raises:
        RecordingError: The file is no such recording.
    """
    time, position = within_budget(path, None, _leader_motion, path)
    motion = Recording(time, position, np.zeros(time.size), name=str(path))  # checks time and position
    return motion.time - motion.time[0], motion.position


def _leader_motion(path: str | PathLike[str]) -> tuple[Array, Array]:
    if Path(path).suffix.lower() != SUFFIX:
        time, angles, _, _ = _signals(path)
        return time, LEVER * angles[:, 0]
    about, columns = read_excerpt(path)
    if LEADER not in columns:
        raise RecordingError(path, f"{about.name} has no motion of a leader: take one of tue/")
    return columns["time"], columns[LEADER]


def is_tue(path: str | PathLike[str]) -> bool:
    """Whether a file is a MATLAB file with the variables of these recordings."""
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):  # of what has no name in these files
            return loadmat(str(path), variable_names=_VARIABLES).keys() >= set(_VARIABLES)
    except Exception:  # of another version, or none: its reader reports that
        return False


def _signals(path: str | PathLike[str]) -> tuple[Array, Array, Array, Array]:
    """Time (n,), leader and follower angle (n, 2), minus operator and environment torque (n, 2), bridge (n,)."""
    from scipy.io import loadmat

    with foreign(path, "is no MATLAB file that can be read"), reading(path):
        content: dict[str, Any] = loadmat(str(path), squeeze_me=True, struct_as_record=False, variable_names=_VARIABLES)
    try:
        scope, bridge = content["scope"], content["env_est3"].signals[2].values
        signals = scope.time, scope.signals[0].values, scope.signals[1].values, bridge
        time, angles, torques, bridge = (np.asarray(values, dtype=np.float64) for values in signals)
    except (KeyError, AttributeError, IndexError, TypeError, ValueError):
        angles = torques = bridge = time = np.empty(0)
    if time.ndim != 1 or angles.shape != (time.size, 2) or torques.shape != angles.shape or bridge.shape != time.shape:
        problem = "is no TU/e teleoperation recording (no scope with angles, torques and force bridge): use CSV"
        raise RecordingError(path, problem)
    return time, angles, torques, bridge


AURORA_CONTACT_FLOOR = 0.005  # smallest force [N] that counts as contact


def read_aurora(path: str | PathLike[str]) -> Recording:
    """A whole ``.ddf`` file: length (channel AI0) and force (AI1), scaled as the file's header says.

    The length grows as the tip goes into the skin, and the force is positive under compression. The press is at 0.5 to
    1.6 s; outside it the motor's force control chatters off contact, so score from 0.5 to 1.6.
    """
    lines = Path(path).read_text(encoding="latin-1").split("\n")
    header = next((index for index, line in enumerate(lines) if line.startswith("Sample\tAI0\tAI1\t")), None)
    if header is None or not lines[0].startswith("DMC"):
        raise RecordingError(path, "is no Aurora recording (no line of columns 'Sample, AI0, AI1, ...')")
    rate = _header_values(path, lines[:header], "Sample Frequency (Hz):", " ")[0]
    scale = _header_values(path, lines[:header], "Scale (units/V)", "\t")
    offset = _header_values(path, lines[:header], "Offset (volts)", "\t")
    if not any(line.startswith("Units\tmm\tmN\t") for line in lines[:header]) or rate <= 0:
        raise RecordingError(path, "channels AI0 and AI1 are not length in mm and force in mN")
    volts = _rows(path, lines, header + 1)
    length = (volts[:, 1] - offset[0]) * scale[0] / 1e3
    force = (volts[:, 2] - offset[1]) * scale[1] / 1e3
    return Recording(
        volts[:, 0] / rate, length, force, name=str(path), contact_floor=AURORA_CONTACT_FLOOR, first_row=header + 2
    )


def _header_values(path: object, header: list[str], label: str, separator: str) -> list[float]:
    with contextlib.suppress(StopIteration, ValueError):
        values = next(line.removeprefix(label) for line in header if line.startswith(label))
        return [float(value) for value in values.strip().split(separator)]
    raise RecordingError(path, f"has no numbers for {label!r} in its header")


def _rows(path: object, lines: list[str], first: int) -> NDArray[np.float64]:
    """Sample number, AI0 and AI1 of every line."""
    rows: list[list[float]] = []
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        try:
            sample, length, force = map(float, line.split("\t", 3)[:3])
        except ValueError:
            raise RecordingError(path, "does not hold sample number, AI0 and AI1 as numbers", row=number) from None
        rows.append([sample, length, force])
    return np.array(rows).reshape(-1, 3)

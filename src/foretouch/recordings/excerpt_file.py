r"""Excerpts of measured recordings: time, position and force as integers, in a small part of the original's size.

Sensors count: encoders in steps, converters in volts over a power of two. An excerpt keeps these counts :math:`c` and
how many of them make one unit of SI, :math:`u`, and stores the first count and then differences, which are small:

.. math:: q_i = \frac{1}{u} \sum_{j \le i} \Delta c_j

Whoever made the original rounded in another order, to other last bits. Beside the counts stand by how many units in the
last place that differs, so that the numbers are the original's bit by bit: on some recordings of something rigid an
estimator makes several percent of a difference of :math:`10^{-15}` m. A column that is no sensor's count but a filtered
one is rounded to the nearest count, and has no such second column.

It is an ``.npz`` of NumPy, which every installation reads; of Parquet the reader, pyarrow, comes with an extra.
"""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, UnknownNameError
from foretouch.quantities import Recording
from foretouch.recordings.output import atomic_path

__all__ = ["FORCES", "LEADER", "SUFFIX", "About", "Excerpt", "read_excerpt", "recording_of", "write_excerpt"]

Array = NDArray[np.float64]

SUFFIX: Final = ".npz"

FORCES: Final = {"raw": "force", "logged": "logged_force"}
"""The column of each force channel."""

LAST: Final = "_last"
"""Behind a column's name that of its units in the last place."""

LEADER: Final = "leader_position"
"""The column of the motion of the leader's lever, where a recording has one."""


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an excerpt is made from.

    Attributes:
        name: Of the recording.
        original: Address of the file.
        sha256: Checksum of that file.
        licence: Of it, and its copyright line.
        contact_floor: Smallest force [N] that counts as contact.
        counts_per_unit: Column to how many of its counts make a second, a metre or a newton.
    """

    name: str
    original: str
    sha256: str
    licence: str
    contact_floor: float
    counts_per_unit: dict[str, float]


class Excerpt(NamedTuple):
    """An excerpt in memory.

    Attributes:
        about: What it is made from.
        columns: ``time`` [s], ``position`` [m] and ``force`` [N], perhaps ``logged_force`` [N] and ``leader_position``
            [m], each of shape (n,); signs are those of `Recording`.
    """

    about: About
    columns: dict[str, Array]


def read_excerpt(path: str | PathLike[str]) -> Excerpt:
    """An excerpt from its file.

    Raises:
        RecordingError: The file is none.
    """
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as held:
            about = msgspec.json.decode(str(held["about"]), type=About)
            columns = {
                name: _quantity(held[name], counts, held.get(f"{name}{LAST}"))
                for name, counts in about.counts_per_unit.items()
            }
        if not {"time", "position", "force"} <= columns.keys():
            raise KeyError("no time, position or force")
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
    except Exception:  # NumPy, zipfile and zlib raise many kinds on a damaged or foreign file
        rule = "is no excerpt of a measured recording, the only .npz that is read: save columns as CSV or Parquet"
        raise RecordingError(path, rule) from None
    return Excerpt(about, columns)


def write_excerpt(path: str | PathLike[str], about: About, columns: Mapping[str, Array]) -> None:
    """Write columns as counts, and what is left in the last place where that is all.

    Raises:
        KeyError: A column without counts per unit.
        RecordingError: The file cannot be written.
    """
    steps: dict[str, Any] = {}
    for name, column in columns.items():
        counts = np.rint(column * about.counts_per_unit[name]).astype(np.int64)
        steps[name] = _smallest(np.diff(counts, prepend=0))
        last = _smallest(column.view(np.int64) - (counts / about.counts_per_unit[name]).view(np.int64))
        if last.dtype == np.int8 and last.any():
            steps[f"{name}{LAST}"] = last
    with atomic_path(path) as part, part.open("wb") as file:
        np.savez_compressed(file, about=np.array(msgspec.json.encode(about).decode()), **steps)


def recording_of(path: str | PathLike[str], force_channel: str = "raw", *, flip: bool = False) -> Recording:
    """The recording that an excerpt holds.

    Args:
        path: Of the excerpt.
        force_channel: ``"raw"``, or ``"logged"`` where it has one.
        flip: Change the sign of the positions.

    Raises:
        RecordingError: The file is no excerpt, or has no such channel.
        UnknownNameError: Another force channel.
    """
    if force_channel not in FORCES:
        raise UnknownNameError("force channel", force_channel, FORCES)
    about, columns = read_excerpt(path)
    if FORCES[force_channel] not in columns:
        raise RecordingError(path, f"{about.name} has one force alone: leave --force-channel out")
    position = -columns["position"] if flip else columns["position"]
    force = columns[FORCES[force_channel]]
    return Recording(columns["time"], position, force, name=str(path), contact_floor=about.contact_floor)


def _quantity(steps: NDArray[Any], counts_per_unit: float, last: NDArray[Any] | None) -> Array:
    """A column in SI units."""
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
    """The same in the narrowest integers that hold them."""
    for kind in (np.int8, np.int16, np.int32):
        if np.array_equal(steps.astype(kind), steps):
            return steps.astype(kind)
    return steps

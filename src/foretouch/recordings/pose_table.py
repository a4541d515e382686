"""Reads a CSV table of static poses: wrench and orientation, a row a measurement."""

from __future__ import annotations

import csv
import math
from os import PathLike
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.files import within_budget

FORCE: Final = ("fx_N", "fy_N", "fz_N")
TORQUE: Final = ("tx_Nm", "ty_Nm", "tz_Nm")
GRAVITY: Final = ("gx", "gy", "gz")
QUATERNION: Final = ("qw", "qx", "qy", "qz")
POSE: Final = "pose"

POSE_COLUMNS: Final = (*FORCE, *TORQUE, *GRAVITY, *QUATERNION, POSE)
"""Columns that are read; others are ignored."""

UNIT_TOLERANCE = 0.05
"""Gravity directions and quaternions whose length differs from 1 by more than this are refused."""

Array = NDArray[np.float64]


class StaticPoses(NamedTuple):
    """Wrenches of a tool at rest.

    Attributes:
        gravity: Direction of gravity in the sensor's frame, of length 1, shape (n, 3).
        force: Load on the sensor [N], shape (n, 3).
        torque: Load about the sensor's origin [N m], shape (n, 3), or None.
        force_noise: Standard deviation of the force between rows of the same pose, all axes together [N]; None where no
            pose has two rows.
    """

    gravity: Array
    force: Array
    torque: Array | None
    force_noise: float | None = None


def read_poses(path: str | PathLike[str]) -> StaticPoses:
    r"""Static poses from a CSV file.

    Columns by name, in any order: ``fx_N, fy_N, fz_N``; perhaps ``tx_Nm, ty_Nm, tz_Nm``; and the direction of gravity
    in the sensor's frame, ``gx, gy, gz`` (any unit), or the sensor's orientation in a frame whose z points up, as a
    quaternion ``qw, qx, qy, qz`` that turns vectors of the sensor's frame into that frame. Rows with the same ``pose``
    are averaged to one, if there is such a column, and tell the sensor's noise.

    Raises:
        RecordingError: The file cannot be read, a column is missing, or a value is no finite number; the message names
            the row.
    """
    return within_budget(path, None, _poses_in, path)


def _poses_in(path: str | PathLike[str]) -> StaticPoses:
    header, rows, lines = _table(path)
    force = _columns(path, header, rows, lines, FORCE)
    torque = _columns(path, header, rows, lines, TORQUE) if any(name in header for name in TORQUE) else None
    if QUATERNION[0] in header:
        gravity = _down(_unit(path, _columns(path, header, rows, lines, QUATERNION), lines, "quaternion", strict=True))
    else:
        gravity = _unit(path, _columns(path, header, rows, lines, GRAVITY), lines, "gravity direction", strict=False)
    noise = None
    if POSE in header:
        names = [row[header.index(POSE)].strip() for row in rows]
        _, group = np.unique(names, return_inverse=True)
        noise = _noise(force, group)
        force, gravity = _means(force, group), _means(gravity, group)
        gravity /= np.linalg.norm(gravity, axis=1, keepdims=True)
        torque = None if torque is None else _means(torque, group)
    return StaticPoses(gravity, force, torque, noise)


def _table(path: str | PathLike[str]) -> tuple[list[str], list[list[str]], list[int]]:
    """Header, rows and their lines, as an editor counts."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise RecordingError(path, "is no UTF-8 text: save it as CSV with UTF-8") from None
    reader = csv.reader(text.splitlines())
    rows, lines = [], []
    try:
        header = [name.strip() for name in next(reader, [])]
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(header):
                raise RecordingError(path, f"{len(row)} values, the header names {len(header)}", row=reader.line_num)
            rows.append(row)
            lines.append(reader.line_num)
    except csv.Error as error:
        raise RecordingError(path, f"is no CSV: {error}", row=reader.line_num) from None
    twice = sorted({name for name in header if name in POSE_COLUMNS and header.count(name) > 1})
    if twice:
        raise RecordingError(path, f"column {twice[0]} is there {header.count(twice[0])} times", row=1)
    if not rows:
        raise RecordingError(path, "has no rows: one for each pose, below a header that names the columns")
    return header, rows, lines


def _columns(path: object, header: list[str], rows: list[list[str]], lines: list[int], names: tuple[str, ...]) -> Array:
    missing = [name for name in names if name not in header]
    if missing:
        there = ", ".join(header)[:200]
        what = f"column {', '.join(missing)} missing; the columns are {there}"
        hint = "; give gx,gy,gz or qw,qx,qy,qz" if names in (GRAVITY, QUATERNION) else ""
        raise RecordingError(path, what + hint, row=1)
    places = [header.index(name) for name in names]
    values = np.empty((len(rows), len(names)))
    for number, (row, line) in enumerate(zip(rows, lines, strict=True)):
        for column, (name, place) in enumerate(zip(names, places, strict=True)):
            try:
                values[number, column] = float(row[place])
            except ValueError:
                raise RecordingError(path, f"{name} is {row[place][:40]!r}, which is no number", row=line) from None
            if not math.isfinite(values[number, column]):
                raise RecordingError(path, f"{name} is {row[place]}: every value must be finite", row=line)
    return values


def _unit(path: object, vectors: Array, lines: list[int], what: str, *, strict: bool) -> Array:
    """The vectors with length 1."""
    lengths = np.linalg.norm(vectors, axis=1)
    bad = np.abs(lengths - 1.0) > UNIT_TOLERANCE if strict else lengths < 1e-3
    if bad.any():
        row = int(np.argmax(bad))
        rule = "it must be 1" if strict else "it must not be 0"
        raise RecordingError(path, f"the {what} has length {lengths[row]:.4g}: {rule}", row=lines[row])
    return np.asarray(vectors / lengths[:, None])


def _down(quaternions: Array) -> Array:
    """Direction (0, 0, -1) of the outer frame in the sensor's: minus the third row of the rotation matrix."""
    w, x, y, z = quaternions.T
    return -np.column_stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)))


def _means(values: Array, group: NDArray[np.intp]) -> Array:
    counts = np.bincount(group)
    return np.column_stack([np.bincount(group, weights=column) / counts for column in values.T])


def _noise(force: Array, group: NDArray[np.intp]) -> float | None:
    """Standard deviation about the mean of each pose, over all axes; None where every pose has one row."""
    freedom = force.size - 3 * (int(group.max()) + 1)
    if freedom == 0:
        return None
    return math.sqrt(float(np.square(force - _means(force, group)[group]).sum()) / freedom)

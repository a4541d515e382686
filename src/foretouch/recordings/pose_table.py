"""Reads a CSV table of static poses: wrench and orientation, a row a measurement."""

from __future__ import annotations

import math
from os import PathLike
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from foretouch.errors import RecordingError
from foretouch.files import within_budget
from foretouch.recordings.formats.tables import CsvTable
from foretouch.recordings.source import reading, require_names

FORCE: Final = ("fx_N", "fy_N", "fz_N")
TORQUE: Final = ("tx_Nm", "ty_Nm", "tz_Nm")
GRAVITY: Final = ("gx", "gy", "gz")
QUATERNION: Final = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR: Final = ("rx_rad", "ry_rad", "rz_rad")
POSE: Final = "pose"

POSE_COLUMNS: Final = (*FORCE, *TORQUE, *GRAVITY, *QUATERNION, *ROTATION_VECTOR, POSE)
"""Columns that are read; others are ignored."""

UNIT_TOLERANCE = 0.05  # gravity directions and quaternions whose length differs from 1 by more than this are refused

Array = NDArray[np.float64]


class StaticPoses(NamedTuple):
    """Wrenches of a tool at rest.

    Attributes:
        gravity: Direction of gravity in the sensor's frame, of length 1, shape (n, 3).
        force: Load on the sensor [N], shape (n, 3).
        torque: Load about the sensor's origin [N m], shape (n, 3), or None.
        names: Of the poses, as the column ``pose`` has them, in the order they come in; else their numbers from 1.
        force_noise: Standard deviation of the force between rows of the same pose, all axes together [N]; None where no
            pose has two rows.
        torque_noise: The same of the torque [N m]; None without torques, too.
        orientation: Matrices that turn vectors of the flange, or of the sensor, into the base's frame, shape (n, 3, 3);
            None where gravity's direction was given.
    """

    gravity: Array
    force: Array
    torque: Array | None
    names: tuple[str, ...]
    force_noise: float | None = None
    torque_noise: float | None = None
    orientation: Array | None = None


def read_poses(path: str | PathLike[str]) -> StaticPoses:
    r"""Static poses from a CSV file.

    Columns by name, in any order: ``fx_N, fy_N, fz_N``; perhaps ``tx_Nm, ty_Nm, tz_Nm``; and the direction of gravity
    in the sensor's frame, ``gx, gy, gz`` (any unit), or the sensor's orientation in a frame whose z points up, as a
    quaternion ``qw, qx, qy, qz`` or a rotation vector ``rx_rad, ry_rad, rz_rad`` that turns the sensor's vectors into
    that frame. The flange's frame does as well: how the sensor stands on it is found. Rows with the same ``pose`` are
    averaged to one, if there is such a column, and give the sensor's noise.

    Raises:
        RecordingError: The file cannot be read, a column is missing, or a value is no finite number; the message names
            the row.
    """
    return within_budget(path, None, _poses_in, path)


def _poses_in(path: str | PathLike[str]) -> StaticPoses:
    with reading(path):
        table = CsvTable(path, skip_empty=True)
    force = _vectors(table, FORCE)
    torque = _vectors(table, TORQUE) if any(name in table.header for name in TORQUE) else None
    turns = _turns(table)
    if turns is None:
        gravity = _unit(table, _vectors(table, GRAVITY), "gravity direction", strict=False)
    else:
        gravity = _down(turns)
    orientation = None if turns is None else np.asarray(turns.as_matrix(), np.float64)
    names = tuple(map(str, range(1, len(force) + 1)))
    noise = torque_noise = None
    if POSE in table.header:
        texts = [str(text) for text in table.texts(POSE)]
        names = tuple(dict.fromkeys(texts))
        numbers = {name: number for number, name in enumerate(names)}
        group = np.array([numbers[text] for text in texts], np.intp)
        noise = _noise(force, group)
        torque_noise = None if torque is None else _noise(torque, group)
        force, gravity = _means(force, group), _means(gravity, group)
        gravity /= np.linalg.norm(gravity, axis=1, keepdims=True)
        torque = None if torque is None else _means(torque, group)
        first = np.unique(group, return_index=True)[1]
        orientation = None if orientation is None else orientation[first]
    return StaticPoses(gravity, force, torque, names, noise, torque_noise, orientation)


def _turns(table: CsvTable) -> Rotation | None:
    """Orientations of all rows; None where the table has none."""
    if QUATERNION[0] in table.header:
        quaternions = _unit(table, _vectors(table, QUATERNION), "quaternion", strict=True)
        return Rotation.from_quat(quaternions, scalar_first=True)
    if ROTATION_VECTOR[0] in table.header:
        return Rotation.from_rotvec(_vectors(table, ROTATION_VECTOR))
    return None


def _vectors(table: CsvTable, names: tuple[str, ...]) -> Array:
    """Columns beside each other, shape (n, k)."""
    turns = (GRAVITY, QUATERNION, ROTATION_VECTOR)
    hint = "; give gx,gy,gz or qw,qx,qy,qz or rx_rad,ry_rad,rz_rad" if names in turns else ""
    require_names(table.path, table.header, names, row=1, hint=hint)
    values = np.column_stack([*table.read_carefully(names).values()])
    if not values.size:
        raise RecordingError(table.path, "has no rows: one for each pose, below a header that names the columns")
    for sample, column in np.argwhere(~np.isfinite(values))[:1]:
        text = f"{names[column]} is {values[sample, column]}: every value must be finite"
        raise RecordingError(table.path, text, row=table.row_of(int(sample)))
    return values


def _unit(table: CsvTable, vectors: Array, what: str, *, strict: bool) -> Array:
    lengths = np.linalg.norm(vectors, axis=1)
    bad = np.abs(lengths - 1.0) > UNIT_TOLERANCE if strict else lengths < 1e-3
    for sample in np.flatnonzero(bad)[:1].tolist():
        problem = f"the {what} has length {lengths[sample]:.4g}: it must {'be 1' if strict else 'not be 0'}"
        raise RecordingError(table.path, problem, row=table.row_of(sample))
    return np.asarray(vectors / lengths[:, None])


def _down(turns: Rotation) -> Array:
    """Direction (0, 0, -1) of the outer frame in the sensor's."""
    return np.asarray(turns.apply((0.0, 0.0, -1.0), inverse=True), np.float64)


def _means(values: Array, group: NDArray[np.intp]) -> Array:
    counts = np.bincount(group)
    return np.column_stack([np.bincount(group, weights=column) / counts for column in values.T])


def _noise(values: Array, group: NDArray[np.intp]) -> float | None:
    """Standard deviation about the mean of each pose, over all axes; None where every pose has one row."""
    freedom = values.size - 3 * (int(group.max()) + 1)
    return math.sqrt(float(np.square(values - _means(values, group)[group]).sum()) / freedom) if freedom else None

"""Reads a recording, whatever its format."""

from __future__ import annotations

import sys
from os import PathLike
from pathlib import Path
from typing import Final

from foretouch.errors import RecordingError, UnknownNameError
from foretouch.quantities import Recording
from foretouch.recordings.aurora_ddf import read_aurora
from foretouch.recordings.csv_table import read_csv
from foretouch.recordings.follower_samples import read_follower
from foretouch.recordings.parquet_table import read_parquet
from foretouch.recordings.tue_mat import FORCE_CHANNELS, read_tue
from foretouch.recordings.units import Units

__all__ = ["SUFFIXES", "read_recording"]

SUFFIXES: Final = (".csv", ".parquet", ".mat", ".ddf", ".mcap")
"""Endings of the files that can be read."""


def read_recording(
    path: str | PathLike[str],
    *,
    position_unit: str = "m",
    force_unit: str = "N",
    flip: bool = False,
    force_channel: str = "raw",
) -> Recording:
    """Recording from a file; its ending says which format.

    - ``.csv``: a header with ``time_s``, ``position_m``, ``force_N`` and perhaps ``velocity_m_s``, in any order;
      other columns are ignored.
    - ``.parquet``: the same columns.
    - ``.mat``: a TU/e teleoperation recording. ``.ddf``: an Aurora skin indentation.
    - ``.mcap``: a session of foretouch; the follower's position and sensor force.

    Args:
        path: The file.
        position_unit: What the positions of a CSV or Parquet file are in: ``"m"``, ``"cm"``, ``"mm"`` or ``"um"``;
            velocities are in the same a second.
        force_unit: What its forces are in: ``"N"`` or ``"mN"``.
        flip: Whether positions grow out of the material; position and velocity then change sign.
        force_channel: For TU/e files ``"raw"`` (the force bridge) or ``"logged"`` (the low-pass filtered torque).

    Raises:
        RecordingError: The file cannot be used; the message names file, row and rule.
        UnknownNameError: A unit or force channel that is not known.
        MissingExtraError: The format needs a package of the extra ``recordings``.
    """
    file, suffix = Path(path), Path(path).suffix.lower()
    units = Units(position_unit, force_unit, flip)
    if force_channel not in FORCE_CHANNELS:
        raise UnknownNameError("force channel", force_channel, FORCE_CHANNELS)
    if suffix not in SUFFIXES:
        raise RecordingError(path, f"cannot be read: its name must end with one of {', '.join(SUFFIXES)}")
    if not file.is_file():
        raise RecordingError(path, "is no file" if file.exists() else "no such file")
    if suffix not in (".csv", ".parquet") and (position_unit, force_unit) != ("m", "N"):
        raise RecordingError(path, f"a {suffix} file states its own units: leave --position-unit and --force-unit out")
    if suffix != ".mat" and force_channel != "raw":
        raise RecordingError(path, "only a TU/e .mat file has another --force-channel: leave it out")
    try:
        if suffix == ".csv":
            return _alone(read_csv(path, units))
        if suffix == ".parquet":
            return _alone(read_parquet(path, units))
        if suffix == ".mat":
            return read_tue(path, force_channel, flip=flip)
        if suffix == ".ddf":
            return read_aurora(path, flip=flip)
        return read_follower(path, flip=flip)
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None


def _alone(recording: Recording) -> Recording:
    """The recording, once what reading it took is given back: pyarrow keeps twice its size for a next table."""
    pyarrow = sys.modules.get("pyarrow")
    if pyarrow is not None:
        pyarrow.default_memory_pool().release_unused()
    return recording

"""What leaves the room: result files, so that none is ever half there, and the TOML file of a sensor's calibration.

Optional packages are imported when they are needed.
"""

from __future__ import annotations

import importlib
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from foretouch.errors import MissingExtraError, RecordingError
from foretouch.files import read_toml
from foretouch.quantities import SensorCalibration


def optional(module: str) -> Any:
    """A module of the extra ``recordings``."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        raise MissingExtraError(module.partition(".")[0], "recordings") from None


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Iterator[Path]:
    """A path to write to; what is written there replaces ``path`` when the block ends without an error.

    If the block raises, ``path`` stays as it was and what was written is removed.

    Raises:
        RecordingError: ``path`` cannot be written, or is something else than a file.
    """
    target = Path(path).resolve()
    if target.exists() and not target.is_file():
        raise RecordingError(path, "cannot be written: it is there and is no regular file")
    beside = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
    try:
        yield beside
        beside.replace(target)
    except OSError as error:
        raise RecordingError(path, f"cannot be written: {error.strerror or error}") from None
    finally:
        beside.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | PathLike[str]) -> Iterator[Path]:
    """A new folder to fill, which gets its name when the block ends without an error.

    If the block raises, it is removed.

    Raises:
        RecordingError: ``path`` is there already, or cannot be written.
    """
    target = Path(path).resolve()
    if os.path.lexists(target):
        raise RecordingError(path, "cannot be written: it is there already; name a folder that is not")
    beside = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        beside.mkdir()
        yield beside
        beside.rename(target)
    except OSError as error:
        raise RecordingError(path, f"cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def write_columns(
    path: str | PathLike[str], columns: Mapping[str, ArrayLike], *, metadata: Mapping[str, str] | None = None
) -> None:
    """Write columns of one length as CSV or Parquet, whichever the name ends with.

    Numbers in CSV are the shortest that read back as the same float64; true and false are 1 and 0.

    Args:
        path: The file, ending with ``.csv`` or ``.parquet``.
        columns: Column name to values, shape (n,).
        metadata: Texts that a Parquet file carries beside them; a CSV carries none.

    Raises:
        RecordingError: Another ending, columns of unequal length, or the file cannot be written.
        MissingExtraError: The package ``pyarrow`` is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".csv", ".parquet"):
        raise RecordingError(path, "cannot be written: its name must end with .csv or .parquet")
    arrays = {name: np.asarray(values) for name, values in columns.items()}
    shapes = {array.shape for array in arrays.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1:
        raise RecordingError(path, f"columns of unequal length cannot be written: {shapes}")
    pyarrow = optional("pyarrow")
    with atomic_path(path) as part, part.open("wb") as file:
        if suffix == ".csv":
            csv = optional("pyarrow.csv")
            numbers = {name: array.astype(np.int8) if array.dtype == bool else array for name, array in arrays.items()}
            file.write((",".join(arrays) + "\n").encode())  # pyarrow would put the names in quotes
            csv.write_csv(pyarrow.table(numbers), file, csv.WriteOptions(include_header=False))
        else:
            table = pyarrow.table(arrays, metadata=dict(metadata) if metadata else None)
            optional("pyarrow.parquet").write_table(table, file, compression="zstd")


def read_calibration(path: str | PathLike[str]) -> SensorCalibration:
    """A calibration from its file; an unknown key is an error.

    Raises:
        RecordingError: The file cannot be read, or is no calibration.
    """
    return read_toml(path, SensorCalibration, "sensor calibration")


def write_calibration(path: str | PathLike[str], calibration: SensorCalibration) -> None:
    """Write a calibration: one line a number, SI units; what is not known is left out.

    Raises:
        RecordingError: The file cannot be written.
    """
    known = {name: value for name, value in msgspec.structs.asdict(calibration).items() if value is not None}
    # repr gives the shortest decimals that read back as the same float, in a form that TOML has too
    lines = [f"{name} = {list(value) if isinstance(value, tuple) else value!r}" for name, value in known.items()]
    text = "\n".join(["# Sensor calibration, SI units, vectors in the sensor's frame: foretouch calibrate", *lines, ""])
    with atomic_path(path) as part:
        part.write_text(text, encoding="utf-8")

"""Reads a Parquet table of samples; rows count from 1, there is no header line."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.quantities import Recording
from foretouch.recordings._extra import optional
from foretouch.recordings.units import Units, to_recording, wanted_columns

__all__ = ["read_parquet"]


def read_parquet(path: str | PathLike[str], units: Units) -> Recording:
    """Recording from a Parquet file with the column names of the CSV.

    Raises:
        RecordingError: The file is no Parquet, a column is missing or holds no numbers, or a rule of `Recording` is
            broken.
        MissingExtraError: The package ``pyarrow`` is not installed.
    """
    pyarrow, parquet = optional("pyarrow"), optional("pyarrow.parquet")
    try:
        with parquet.ParquetFile(path) as file:
            names = file.schema_arrow.names
            wanted = wanted_columns(path, names)
            table = file.read(columns=wanted)
    except RecordingError:
        raise
    except Exception as error:  # pyarrow raises many kinds on a damaged or foreign file
        raise RecordingError(path, f"is no Parquet file that can be read: {' '.join(str(error).split())}") from None
    columns = {name: _numbers(path, name, table[name], pyarrow) for name in wanted}
    return to_recording(path, columns, units, first_row=1)


def _numbers(path: object, name: str, column: Any, pyarrow: Any) -> NDArray[np.float64]:
    kind = column.type
    if not (pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind)):
        raise RecordingError(path, f"{name} holds {kind}, not numbers")
    if column.null_count:
        row = 1 + int(np.argmax(column.is_null().to_numpy()))
        raise RecordingError(path, f"{name} has no value", row=row)
    return np.asarray(column.to_numpy(), dtype=np.float64)

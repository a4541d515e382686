"""Reads the variables of a MATLAB file up to version 7 (SciPy); version 7.3 is HDF5, see `hdf5_table`."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.array_columns import column_of, column_shapes
from foretouch.recordings.hdf5_table import Hdf5Table
from foretouch.recordings.source import Column, Table, one_line, require_names

__all__ = ["MatTable", "open_mat"]

DEEPEST_STRUCT: Final = 8
"""Structures within structures beyond this are not looked into."""


def open_mat(path: str | PathLike[str]) -> Table:
    """A MATLAB file of any version.

    Raises:
        RecordingError: It is none, or damaged.
        MissingExtraError: It is of version 7.3 and ``h5py`` is not installed.
    """
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings(action="ignore"):  # of what has no name, which nobody can ask for
            return MatTable(path, loadmat(str(path), squeeze_me=True, struct_as_record=False))
    except NotImplementedError:  # SciPy's word for version 7.3
        return Hdf5Table(path, "MATLAB 7.3 (HDF5)")
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
    except RecordingError:
        raise
    except Exception as error:  # SciPy raises many kinds on a damaged or foreign file
        raise RecordingError(path, f"is no MATLAB file that can be read: {one_line(error)}") from None


class MatTable(Table):
    """The numbers of a MATLAB file; structures are gone into, ``scope.signals[0].values[1]``.

    Args:
        path: Of the file.
        content: Its variables, as SciPy reads them with structures as objects.
    """

    def __init__(self, path: str | PathLike[str], content: dict[str, Any]) -> None:
        self.path, self.format = path, "MATLAB"
        self.variables = {name: value for name, value in content.items() if not name.startswith("__")}
        self._arrays: dict[str, tuple[NDArray[np.generic], int | None]] = {}
        columns = []
        for name, array in _arrays(self.variables, "", 0):
            for place, (column, length) in enumerate(column_shapes(name, array.shape)):
                self._arrays[column] = array, (None if column == name else place)
                columns.append(Column(column, str(array.dtype), length))
        self.columns = tuple(columns)

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name.

        Raises:
            RecordingError: A column is missing.
        """
        require_names(self.path, list(self._arrays), names)
        return {name: column_of(*self._arrays[name]) for name in names}


def _arrays(value: Any, name: str, depth: int) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Every array of numbers within a value, with its name."""
    if depth > DEEPEST_STRUCT:
        return
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        yield name, value
    elif isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1:
        for place, part in enumerate(value[:1000]):
            yield from _arrays(part, f"{name}[{place}]", depth + 1)
    elif isinstance(value, dict):
        for key, part in value.items():
            yield from _arrays(part, f"{name}.{key}" if name else key, depth + 1)
    elif hasattr(value, "_fieldnames"):
        for key in value._fieldnames:
            yield from _arrays(getattr(value, key), f"{name}.{key}", depth + 1)

"""Columns out of HDF5 and MATLAB files, samples along the longest dimension, whichever that is.

MATLAB's version 7.3 is HDF5; files up to version 7 are read by SciPy.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.output import optional
from foretouch.recordings.source import MAP_NAME, Column, Table, foreign, reading, require_names

MOST_COLUMNS = 64  # an array that is wider is no set of signals, but an image or a matrix


def column_shapes(name: str, shape: tuple[int, ...]) -> Iterator[tuple[str, int | None, int]]:
    """Name, number and length of each column of an array: itself where it is one line, else ``name[0]`` and so on.

    Arrays of no or one value, of more than two dimensions or of more than 64 columns have none.
    """
    lengths = [length for length in shape if length != 1]
    if 0 in lengths:
        return
    if len(lengths) == 1:
        yield name, None, lengths[0]
    elif len(lengths) == 2 and min(lengths) <= MOST_COLUMNS:
        yield from ((f"{name}[{position}]", position, max(lengths)) for position in range(min(lengths)))


def column_of(array: NDArray[np.generic], index: int | None) -> NDArray[np.float64]:
    """One column as float64; `index` is the number in its name, None where it has none."""
    squeezed = np.squeeze(array)
    if index is None:
        return np.asarray(squeezed, dtype=np.float64)
    turned = squeezed if squeezed.shape[0] >= squeezed.shape[1] else squeezed.T
    return np.asarray(turned[:, index], dtype=np.float64)


DEEPEST_GROUP: Final = 32  # groups within groups: hostile ones, thousands deep, take minutes to go through
MOST_DATASETS: Final = 10_000  # in one file; each is looked at

UNIT_ATTRIBUTES: Final = ("unit", "units", "Unit", "Units")


class Hdf5Table(Table):
    """An opened HDF5 file; a column is a dataset, ``group/force``, one line of it, ``group/wrench[2]``, or a field."""

    def __init__(self, path: str | PathLike[str], format: str = "HDF5") -> None:
        self.path, self.format = path, format
        self._h5py = optional("h5py")
        self._columns: dict[str, tuple[str, str, int | None]] = {}
        columns: list[Column] = []
        with self._opened() as file:
            self.stated_map = _text(file.attrs.get(MAP_NAME, ""))
            for name, dataset in self._datasets(file):
                columns += self._columns_of(name, dataset)
        self.columns = tuple(columns)

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name."""
        require_names(self.path, list(self._columns), names)
        where = {name: self._columns[name] for name in names}
        with self._opened() as file:
            return {name: column_of(file[data][field or ()], index) for name, (data, field, index) in where.items()}

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        with foreign(self.path, f"is no {self.format} file that can be read"), self._h5py.File(self.path, "r") as file:
            yield file

    def _datasets(self, file: Any) -> list[tuple[str, Any]]:
        results: list[tuple[str, Any]] = []

        def look(name: str, item: Any) -> None:
            if name.count("/") > DEEPEST_GROUP or len(results) > MOST_DATASETS:
                what = f"groups within groups deeper than {DEEPEST_GROUP}, or more than {MOST_DATASETS} datasets"
                raise RecordingError(self.path, f"has {what}: no recording has")
            hidden = name.startswith("#")  # where MATLAB keeps what its cells refer to
            text = _text(item.attrs.get("MATLAB_class", "")) in ("char", "cell", "function_handle")
            if isinstance(item, self._h5py.Dataset) and not hidden and not text:
                results.append((name, item))

        file.visititems(look)
        return results

    def _columns_of(self, name: str, dataset: Any) -> list[Column]:
        unit = next((_text(dataset.attrs[key]) for key in UNIT_ATTRIBUTES if key in dataset.attrs), "")
        fields = dataset.dtype.names
        parts = [(f"{name}.{field}", field, dataset.dtype[field]) for field in fields or ()]
        columns = []
        for whole, field, kind in parts or [(name, "", dataset.dtype)]:
            if kind.kind not in "fiu":
                continue
            for column, index, length in column_shapes(whole, dataset.shape or ()):
                self._columns[column] = name, field, index
                columns.append(Column(column, str(kind), length, unit))
        return columns


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.reshape(-1)[0] if value.size else ""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


DEEPEST_STRUCT: Final = 8  # structures within structures beyond this are not looked into


def open_mat(path: str | PathLike[str]) -> Table:
    """A MATLAB file of any version."""
    from scipy.io import loadmat

    quiet = warnings.catch_warnings(action="ignore")  # on variables without a name, which cannot be asked for
    wrong = foreign(path, "is no MATLAB file that can be read")
    with wrong, reading(path), contextlib.suppress(NotImplementedError), quiet:
        return MatTable(path, loadmat(str(path), squeeze_me=True, struct_as_record=False))
    # what SciPy does not implement is version 7.3
    return Hdf5Table(path, "MATLAB 7.3 (HDF5)")


class MatTable(Table):
    """The numbers of a MATLAB file; structures are gone into, ``scope.signals[0].values[1]``."""

    def __init__(self, path: str | PathLike[str], content: dict[str, Any]) -> None:
        self.path, self.format = path, "MATLAB"
        self.variables = {name: value for name, value in content.items() if not name.startswith("__")}
        self._arrays: dict[str, tuple[NDArray[np.generic], int | None]] = {}
        columns = []
        for name, array in _arrays(self.variables, "", 0):
            for column, index, length in column_shapes(name, array.shape):
                self._arrays[column] = array, index
                columns.append(Column(column, str(array.dtype), length))
        self.columns = tuple(columns)

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name."""
        require_names(self.path, list(self._arrays), names)
        return {name: column_of(*self._arrays[name]) for name in names}


def _arrays(value: Any, name: str, depth: int) -> Iterator[tuple[str, NDArray[np.generic]]]:
    if depth > DEEPEST_STRUCT:
        return
    parts: dict[str, Any] = {}
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        yield name, value
    elif isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1:
        parts = {f"{name}[{index}]": part for index, part in enumerate(value[:1000])}
    elif isinstance(value, dict):
        parts = {f"{name}.{key}" if name else key: part for key, part in value.items()}
    elif hasattr(value, "_fieldnames"):
        parts = {f"{name}.{key}": getattr(value, key) for key in value._fieldnames}
    for whole, part in parts.items():
        yield from _arrays(part, whole, depth + 1)

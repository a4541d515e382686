"""Reads the datasets of an HDF5 file, MATLAB's version 7.3 among them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings._extra import optional
from foretouch.recordings.array_columns import column_of, column_shapes
from foretouch.recordings.source import MAP_NAME, Column, Table, one_line, require_names

__all__ = ["Hdf5Table"]

DEEPEST_GROUP: Final = 32
"""Groups within groups: hostile ones, thousands deep, take minutes to go through."""

MOST_DATASETS: Final = 10_000
"""In one file; each is looked at."""

UNIT_ATTRIBUTES: Final = ("unit", "units", "Unit", "Units")


class Hdf5Table(Table):
    """An opened HDF5 file; a column is a dataset, ``group/force``, one line of it, ``group/wrench[2]``, or a field.

    Raises:
        RecordingError: The file is no HDF5, or damaged.
        MissingExtraError: The package ``h5py`` is not installed.
    """

    def __init__(self, path: str | PathLike[str], format: str = "HDF5") -> None:
        self.path, self.format = path, format
        self._h5py = optional("h5py")
        self._places: dict[str, tuple[str, str, int | None]] = {}
        columns: list[Column] = []
        with self._opened() as file:
            self.stated_map = _text(file.attrs.get(MAP_NAME, ""))
            for name, dataset in self._datasets(file):
                columns += self._columns_of(name, dataset)
        self.columns = tuple(columns)

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name.

        Raises:
            RecordingError: A column is missing, or the file is damaged.
        """
        require_names(self.path, list(self._places), names)
        with self._opened() as file:
            found = {}
            for name in names:
                dataset, field, place = self._places[name]
                content = file[dataset][field] if field else file[dataset][()]
                found[name] = column_of(content, place)
        return found

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        try:
            with self._h5py.File(self.path, "r") as file:
                yield file
        except RecordingError:
            raise
        except Exception as error:  # h5py raises many kinds on a damaged or foreign file
            raise RecordingError(self.path, f"is no {self.format} file that can be read: {one_line(error)}") from None

    def _datasets(self, file: Any) -> list[tuple[str, Any]]:
        found: list[tuple[str, Any]] = []

        def look(name: str, item: Any) -> None:
            if name.count("/") > DEEPEST_GROUP or len(found) > MOST_DATASETS:
                what = f"groups within groups deeper than {DEEPEST_GROUP}, or more than {MOST_DATASETS} datasets"
                raise RecordingError(self.path, f"has {what}: no recording has")
            hidden = name.startswith("#")  # where MATLAB keeps what its cells refer to
            text = _text(item.attrs.get("MATLAB_class", "")) in ("char", "cell", "function_handle")
            if isinstance(item, self._h5py.Dataset) and not hidden and not text:
                found.append((name, item))

        file.visititems(look)
        return found

    def _columns_of(self, name: str, dataset: Any) -> list[Column]:
        unit = next((_text(dataset.attrs[key]) for key in UNIT_ATTRIBUTES if key in dataset.attrs), "")
        fields = dataset.dtype.names
        parts = [(f"{name}.{field}", field, dataset.dtype[field]) for field in fields] if fields else []
        columns = []
        for whole, field, kind in parts or [(name, "", dataset.dtype)]:
            if kind.kind not in "fiu":
                continue
            for place, (column, length) in enumerate(column_shapes(whole, dataset.shape or ())):
                self._places[column] = name, field, (None if column == whole else place)
                columns.append(Column(column, str(kind), length, unit))
        return columns


def _text(value: Any) -> str:
    """An attribute as text."""
    if isinstance(value, np.ndarray):
        value = value.reshape(-1)[0] if value.size else ""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)

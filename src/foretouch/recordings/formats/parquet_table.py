"""Reads a Parquet table of samples; rows count from 1, there is no header line."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.recordings.output import optional
from foretouch.recordings.source import MAP_NAME, Column, Table, one_line, require_names


class ParquetTable(Table):
    """An opened Parquet file.

    Raises:
        RecordingError: The file is no Parquet.
        MissingExtraError: The package ``pyarrow`` is not installed.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path, self.format = path, "Parquet"
        self._pyarrow, self._parquet = optional("pyarrow"), optional("pyarrow.parquet")
        with self._refusing(), self._parquet.ParquetFile(path) as file:
            schema, count = file.schema_arrow, file.metadata.num_rows
        self.columns = tuple(Column(field.name, str(field.type), count, _unit_of(field)) for field in schema)
        self._names = list(schema.names)
        self.stated_map = ((schema.metadata or {}).get(MAP_NAME.encode()) or b"").decode(errors="replace")

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name.

        Raises:
            RecordingError: A column is missing, there twice, or holds no numbers; or the file is damaged.
        """
        require_names(self.path, self._names, names, row=1)
        with self._refusing(), self._parquet.ParquetFile(self.path) as file:
            table = file.read(columns=list(names))
        return {name: self._numbers(name, table[name]) for name in names}

    def _refusing(self) -> Any:
        return _OneLine(self.path)

    def _holds_numbers(self, kind: Any) -> bool:
        return bool(self._pyarrow.types.is_floating(kind) or self._pyarrow.types.is_integer(kind))

    def _numbers(self, name: str, column: Any) -> NDArray[np.float64]:
        if not self._holds_numbers(column.type):
            raise RecordingError(self.path, f"{name} holds {column.type}, not numbers")
        if column.null_count:
            row = 1 + int(np.argmax(column.is_null().to_numpy()))
            raise RecordingError(self.path, f"{name} has no value", row=row)
        return numbers_of(column)


def numbers_of(column: Any) -> NDArray[np.float64]:
    """A column of pyarrow that holds numbers and misses none; its own `to_numpy` imports pandas, which takes 0.25 s."""
    parts = [np.from_dlpack(chunk) for chunk in column.chunks if len(chunk)]
    whole = parts[0] if len(parts) == 1 else np.concatenate([np.empty(0), *parts])
    return np.asarray(whole, dtype=np.float64)


class _OneLine:
    """What pyarrow raises on a damaged or foreign file, as one line: it has many kinds."""

    def __init__(self, path: object) -> None:
        self._path = path

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, Exception):
            raise RecordingError(self._path, f"is no Parquet file that can be read: {one_line(error)}") from None


def _unit_of(field: Any) -> str:
    said = (field.metadata or {}).get(b"unit") or (field.metadata or {}).get(b"units") or b""
    return str(said.decode(errors="replace"))

"""Reads a CSV table of samples.

Two ways with one result: pyarrow's, a few seconds for an hour at 1 kHz, and where that finds anything out of order (or
is not installed) a careful one, line by line, which knows the row that is to blame.
"""

from __future__ import annotations

import csv
from os import PathLike
from pathlib import Path

import numpy as np

from foretouch.errors import RecordingError
from foretouch.quantities import Recording
from foretouch.recordings.units import Units, to_recording, wanted_columns

__all__ = ["read_csv"]


def read_csv(path: str | PathLike[str], units: Units) -> Recording:
    """Recording from a CSV file whose header names the columns.

    Raises:
        RecordingError: A column is missing, a value is no finite number, or a rule of `Recording` is broken; the
            message names the row as an editor counts lines.
    """
    fast = _read_fast(path, units)
    return _read_carefully(path, units) if fast is None else fast


def _read_fast(path: str | PathLike[str], units: Units) -> Recording | None:
    """The recording, or None where anything at all is out of order."""
    try:
        import pyarrow
        import pyarrow.csv
    except ModuleNotFoundError:
        return None
    try:
        header = _header(path)
        wanted = wanted_columns(path, header)
        table = pyarrow.csv.read_csv(
            str(path),
            read_options=pyarrow.csv.ReadOptions(column_names=header, skip_rows=1),
            convert_options=pyarrow.csv.ConvertOptions(
                include_columns=wanted,
                column_types=dict.fromkeys(wanted, pyarrow.float64()),
                null_values=[],
            ),
        )
        return to_recording(path, {name: table[name].to_numpy() for name in wanted}, units, first_row=2)
    except (RecordingError, pyarrow.ArrowException):
        return None


def _header(path: str | PathLike[str]) -> list[str]:
    """Column names."""
    with Path(path).open(encoding="utf-8-sig", errors="replace", newline="") as file:
        line = file.readline(65_536)
    if "\0" in line or "\ufffd" in line:
        raise RecordingError(path, "is no UTF-8 text: save it as CSV with UTF-8", row=1)
    if not line.strip():
        raise RecordingError(path, "has no header: the first line names the columns", row=1)
    return [name.strip() for name in next(csv.reader([line]))]


def _read_carefully(path: str | PathLike[str], units: Units) -> Recording:
    header = _header(path)
    wanted = wanted_columns(path, header)
    places = [(name, header.index(name)) for name in wanted]
    columns: dict[str, list[float]] = {name: [] for name in wanted}
    lines: list[int] = []
    with Path(path).open(encoding="utf-8-sig", errors="replace", newline="") as file:
        rows = csv.reader(file)
        try:
            next(rows)
            for cells in rows:
                if not cells or (len(cells) == 1 and not cells[0].strip()):
                    continue  # a blank line
                if len(cells) != len(header):
                    raise RecordingError(
                        path, f"{len(cells)} values, the header names {len(header)} columns", row=rows.line_num
                    )
                for name, place in places:
                    columns[name].append(_number(path, name, cells[place], rows.line_num))
                lines.append(rows.line_num)
        except csv.Error as error:
            raise RecordingError(path, f"is no CSV: {error}", row=rows.line_num) from None
    try:
        return to_recording(path, {name: np.array(values) for name, values in columns.items()}, units, first_row=0)
    except RecordingError as error:
        if error.row is None:
            raise
        problem = str(error).removeprefix(f"{path}, row {error.row}: ")
        raise RecordingError(path, problem, row=lines[error.row]) from None


def _number(path: object, name: str, cell: str, line: int) -> float:
    text = cell.strip()
    try:
        if text.isascii() and "_" not in text:  # float() reads more than a table of numbers should hold
            return float(text)
    except ValueError:
        pass
    shown = text if len(text) <= 40 else text[:40] + "..."
    hint = "" if text else " (nothing there)"
    raise RecordingError(path, f"{name} is {shown!r}, which is no number{hint}", row=line)

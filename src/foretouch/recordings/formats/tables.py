"""Reads tables of samples, CSV and Parquet; rows of Parquet count from 1, as there is no header line.

CSV is read in two ways with one result: pyarrow's, a few seconds for an hour at 1 kHz, and where that finds anything
out of order (or is not installed) a careful one, line by line, which knows the row that is to blame.

Columns are separated by commas, semicolons or tabs, whichever the header has most of, or by single spaces; beside all
but commas a comma in a number is its decimal point, as spreadsheets of many countries write.

Remarks (``#`` or ``%``) may stand above the header, or be it, as NumPy's ``savetxt`` writes; a row of units may stand
below it, as testing machines write. They also write lines on the sample above it, with one or two cells each: these are
passed over where a header of three columns or more comes within 50 lines, with numbers below it.
"""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, zip_longest
from os import PathLike
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import MissingExtraError, RecordingError
from foretouch.recordings.meaning.names import is_unit
from foretouch.recordings.output import optional
from foretouch.recordings.source import MAP_NAME, Column, Table, foreign, require_names


class ParquetTable(Table):
    """An opened Parquet file."""

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path, self.format = path, "Parquet"
        self._pyarrow, self._parquet = optional("pyarrow"), optional("pyarrow.parquet")
        with foreign(path, "is no Parquet file that can be read"), self._parquet.ParquetFile(path) as file:
            schema, count = file.schema_arrow, file.metadata.num_rows
        self.columns = tuple(Column(field.name, str(field.type), count, _unit_of(field)) for field in schema)
        self._names = list(schema.names)
        self.stated_map = ((schema.metadata or {}).get(MAP_NAME.encode()) or b"").decode(errors="replace")

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name."""
        require_names(self.path, self._names, names, row=1)
        with foreign(self.path, "is no Parquet file that can be read"), self._parquet.ParquetFile(self.path) as file:
            table = file.read(columns=list(names))
        return {name: self._numbers(name, table[name]) for name in names}

    def _numbers(self, name: str, column: Any) -> NDArray[np.float64]:
        kinds = self._pyarrow.types
        if not (kinds.is_floating(column.type) or kinds.is_integer(column.type)):
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


def _unit_of(field: Any) -> str:
    text = (field.metadata or {}).get(b"unit") or (field.metadata or {}).get(b"units") or b""
    return str(text.decode(errors="replace"))


SEPARATORS: Final = (",", ";", "\t")
LOOKED_AT: Final = 50  # lines that tell whether numbers have a decimal comma, and within which the header stands
FEWEST: Final = 3  # columns of a header that other lines may stand above: time, position and force
REMARKS: Final = ("#", "%")  # what lines that are no samples begin with
LONGEST_LINE: Final = 65_536  # characters of a line above the samples

_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*\Z")


def _encoding(path: str | PathLike[str]) -> str:
    """UTF-8, or what spreadsheets of western Europe write where the beginning is no UTF-8 but text."""
    with Path(path).open("rb") as file:
        beginning = file.read(LONGEST_LINE)
    try:
        (beginning.rpartition(b"\n")[0] or beginning).decode("utf-8")
    except UnicodeDecodeError:
        return "utf-8-sig" if b"\0" in beginning else "cp1252"
    return "utf-8-sig"


@dataclass(frozen=True)
class _Top:
    separator: str
    names: list[str]
    row: int  # line of the names
    lines: int  # how many stand above the samples
    units: tuple[str, ...] = ()
    passed_over: int = 0


class CsvTable(Table):
    """An opened CSV file whose header names the columns.

    Args:
        path: Path of the file.
        skip_empty: Whether rows whose cells are all empty are passed over; without it such a row lacks its numbers.
    """

    def __init__(self, path: str | PathLike[str], *, skip_empty: bool = False) -> None:
        self.path, self.format, self._skip_empty = path, "CSV", skip_empty
        self._encoding = _encoding(path)
        top = self._top()
        self._separator, self.header, self._skipped = top.separator, top.names, top.lines
        self._header_row, self.first_row = top.row, top.lines + 1
        if top.passed_over:
            above = "1 line above is" if top.passed_over == 1 else f"{top.passed_over} lines above are"
            self.notes = (f"the columns are named in line {top.row}; {above} passed over",)
        rows: list[list[str]] = []
        with contextlib.suppress(RecordingError):  # the reader of the whole reports what is wrong
            rows = [row for _, row in islice(self._rows(), LOOKED_AT)]
        comma = self._separator != "," and any(_DECIMAL_COMMA.match(cell) for row in rows for cell in row)
        self._decimal = "," if comma else "."
        cells = zip_longest(*rows, [""] * len(top.names), fillvalue="")
        filled = [list(filter(str.strip, column)) for column in cells][: len(top.names)]
        kinds = ["number" if some and all(map(_is_number, some)) else "text" for some in filled]
        columns = zip_longest(top.names, kinds, top.units, fillvalue="")
        self.columns = tuple(Column(name, kind, unit=unit) for name, kind, unit in columns)

    def _top(self) -> _Top:
        with Path(self.path).open(encoding=self._encoding, errors="replace", newline="") as file:
            remark, lines, line = "", 1, self._line(file, 1)
            while line and (not line.strip() or line.lstrip().startswith(REMARKS)):
                remark = line.strip().lstrip("".join(REMARKS)) or remark
                lines += 1
                line = self._line(file, lines)
            if not line:
                raise RecordingError(self.path, "has no header where the first line has to name the columns", row=1)
            below = [self._line(file, lines + 1)]
            if _filled(line) < FEWEST and _by_spaces(line, below[0]):
                return _Top(" ", _cells(line.strip(), " "), lines, lines)
            if _filled(line) < FEWEST:
                below += [self._line(file, lines + 1 + more) for more in range(1, LOOKED_AT)]
                result = _under_a_preamble(lines + 1, below)
                if result is not None:
                    return result
        separator = _separator_of(line)
        names, above = _cells(line, separator), _cells(remark, separator)
        if any(map(_is_number, names)) and len(above) == len(names) and not any(map(_is_number, above)):
            return _Top(separator, above, lines - 1, lines - 1)
        return _header(separator, names, below[0], lines)

    def _line(self, file: TextIO, row: int) -> str:
        line = file.readline(LONGEST_LINE)
        if "\0" in line or "\ufffd" in line:
            raise RecordingError(self.path, "is no UTF-8 text: save it as CSV with UTF-8", row=row)
        return line

    def read(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Columns by name."""
        require_names(self.path, self.header, names, row=self._header_row)
        fast = self.read_fast(names)
        return self.read_carefully(names) if fast is None else fast

    def read_fast(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]] | None:
        """The columns, or None where anything at all is out of order."""
        try:
            pyarrow, csv = optional("pyarrow"), optional("pyarrow.csv")
        except MissingExtraError:
            return None
        encoding = self._encoding.removesuffix("-sig")
        reading = csv.ReadOptions(column_names=self.header, skip_rows=self._skipped, encoding=encoding)
        numbers = dict.fromkeys(names, pyarrow.float64())
        converting = csv.ConvertOptions(
            include_columns=list(names), column_types=numbers, null_values=[], decimal_point=self._decimal
        )
        try:
            table = csv.read_csv(str(self.path), reading, csv.ParseOptions(delimiter=self._separator), converting)
        except pyarrow.ArrowException:
            return None
        return {name: numbers_of(table[name]) for name in names}

    def read_carefully(self, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """The columns, or a `RecordingError` that names the row."""
        positions = [(name, self.header.index(name)) for name in names]
        columns: dict[str, list[float]] = {name: [] for name in names}
        for line, cells in self._rows():
            if len(cells) != len(self.header):
                problem = f"{len(cells)} values, the header names {len(self.header)} columns"
                raise RecordingError(self.path, problem, row=line)
            for name, index in positions:
                columns[name].append(self._number(name, cells[index], line))
        return {name: np.array(values, dtype=np.float64) for name, values in columns.items()}

    def texts(self, name: str) -> list[str]:
        """The cells of a column as they stand."""
        require_names(self.path, self.header, [name], row=self._header_row)
        index = self.header.index(name)
        return [cells[index].strip() for _, cells in self._rows()]

    def row_of(self, sample: int) -> int:
        """Line of a sample, as an editor counts: blank lines, and those within quotes, count too."""
        return next(islice(self._rows(), sample, None))[0]

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """The line number and the cells of each row that is not blank, without the header."""
        with Path(self.path).open(encoding=self._encoding, errors="replace", newline="") as file:
            for _ in range(self._skipped):
                file.readline()
            rows: Any = csv.reader(file, delimiter=self._separator)
            try:
                for cells in rows:
                    blank = not any(cell.strip() for cell in cells)
                    if not (blank and (self._skip_empty or len(cells) < 2)):
                        yield self._skipped + rows.line_num, cells
            except csv.Error as error:
                raise RecordingError(self.path, f"is no CSV: {error}", row=self._skipped + rows.line_num) from None

    def _number(self, name: str, cell: str, line: int) -> float:
        text = cell.strip()
        try:
            # float() reads more than a table of numbers should hold; beside decimal commas a point is of thousands.
            if text.isascii() and "_" not in text and not (self._decimal == "," and "." in text):
                return float(text.replace(",", "."))
        except ValueError:
            pass
        shown = text if len(text) <= 40 else text[:40] + "..."
        hint = "" if text else " (nothing there)"
        if self._decimal == "," and "." in text:
            hint = ": other numbers have a decimal comma, so write this one without a point"
        raise RecordingError(self.path, f"{name} is {shown!r}, which is no number{hint}", row=line)


def _separator_of(line: str) -> str:
    return max(SEPARATORS, key=lambda mark: len(_cells(line, mark)))


def _header(separator: str, names: list[str], below: str, row: int) -> _Top:
    """The names in a row, with the units below them where that line has these."""
    units = _cells(below, separator)
    if len(units) == len(names) and any(map(is_unit, units)) and not any(map(_is_number, units)):
        return _Top(separator, names, row, row + 1, tuple(unit.strip("[](){}<> ") for unit in units))
    return _Top(separator, names, row, row)


def _by_spaces(line: str, below: str) -> bool:
    """Whether single spaces separate the names in a line, and the numbers in the one below, as UR's clients write."""
    names, numbers = line.strip().split(" "), below.strip().split(" ")
    return len(names) == len(numbers) >= FEWEST and all(names) and all(map(_is_number, numbers))


def _under_a_preamble(first: int, lines: list[str]) -> _Top | None:
    """The header below lines of fewer columns: names, perhaps units, and then as many cells with numbers among them."""
    for index, line in enumerate(lines[:-1]):
        separator = _separator_of(line)
        names = _cells(line, separator)
        if _filled(line) < FEWEST or any(map(_is_number, names)):
            continue
        top = _header(separator, names, lines[index + 1], first + index)
        samples = lines[top.lines - first + 1 :]
        cells = _cells(samples[0], separator) if samples else []
        if len(cells) == len(names) and sum(map(_is_number, cells)) >= FEWEST:
            return replace(top, passed_over=1 + sum(bool(above.strip()) for above in lines[:index]))
    return None


def _filled(line: str) -> int:
    """Cells of a line that are not empty: spreadsheets make all lines as wide as the widest."""
    return sum(bool(cell) for cell in _cells(line, _separator_of(line)))


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True

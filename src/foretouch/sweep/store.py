"""The rows of a sweep in its folder, kept as they come: a sweep that was ended goes on where it was."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

import msgspec

from foretouch import __version__
from foretouch.errors import InputError
from foretouch.sweep.outcome import Outcome

FILE_NAME = "sessions.jsonl"
"""A header, then one row a line."""

ROOMS = (
    *("quantities", "models", "messages", "identification", "rendering", "robot", "devices", "link", "recordings"),
    *("session", "report", "sweep"),
)
"""Whose code decides what comes out of a session."""

SHOWING = (
    "report/writing",
    "report/scene/drawing.py",
    "report/forces.py",
    "report/replay.py",
    "sweep/curves.py",
    "sweep/page.py",
)
"""Files and folders of these rooms that only show it, or other things."""


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What all rows of a folder have in common.

    Attributes:
        version: Of foretouch.
        code: Digest of the code that ran the sessions.
        seed: Of the sweep.
        duration_s: Of sessions without delay [s].
    """

    version: str
    code: str
    seed: int
    duration_s: float


@functools.cache
def code_digest() -> str:
    """SHA-256 over the source that decides what a row is, from the materials to its figures."""
    root = Path(__file__).resolve().parents[1]
    sum_ = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            name = path.relative_to(root).as_posix()
            if not name.startswith(SHOWING):
                sum_.update(name.encode() + path.read_bytes())
    return sum_.hexdigest()[:16]


class Store:
    """The rows in a folder.

    Args:
        folder: Made if it is not there.
        seed: Of the sweep.
        duration: Of sessions without delay [s].

    Attributes:
        path: Of the file.
        header: That is, or will be, in its first line.
        rows: By number and baseline, as many as there are.

    Raises:
        InputError: The folder cannot be used, or holds the rows of another sweep.
    """

    def __init__(self, folder: str | Path, *, seed: int = 0, duration: float = 30.0) -> None:
        self.path = Path(folder) / FILE_NAME
        self.header = Header(__version__, code_digest(), seed, duration)
        self.rows: dict[tuple[int, str], Outcome] = {}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.exists():
                self._cut()
            if not self.path.exists() or not self.path.stat().st_size:
                self._append(msgspec.json.encode(self.header))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None
        header, rows = read_store(self.path)
        if header != self.header:
            raise InputError(f"{self.path}: {_difference(header, self.header)}; give another --out, or remove the file")
        self.rows = rows

    def add(self, row: Outcome) -> None:
        """Append one row."""
        self._append(msgspec.json.encode(row))
        self.rows[row.number, row.baseline] = row

    def _append(self, line: bytes) -> None:
        with self.path.open("ab") as file:
            file.write(line + b"\n")

    def _cut(self) -> None:
        """A line that was not written to its end is no line."""
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            with self.path.open("r+b") as file:
                file.truncate(whole)


def read_store(path: Path) -> tuple[Header, dict[tuple[int, str], Outcome]]:
    """The header and all rows of a file.

    Raises:
        InputError: It is not there, or a line in it is not ours.
    """
    try:
        first, *lines = path.read_bytes().splitlines()
    except (OSError, ValueError):
        raise InputError(f"{path}: there is no sweep: run `foretouch sweep --out {path.parent}` first") from None
    rows = {}
    decoder = msgspec.json.Decoder(Outcome)
    try:
        header = msgspec.json.decode(first, type=Header)
        for line in lines:
            row = decoder.decode(line)
            rows[row.number, row.baseline] = row
    except msgspec.DecodeError as error:
        where = f"line {len(rows) + 2}" if rows else "at its beginning"
        raise InputError(f"{path}, {where}: is no line of a sweep ({error}); give another --out") from None
    return header, rows


def _difference(theirs: Header, ours: Header) -> str:
    """What was otherwise when the rows were made."""
    if theirs.version != ours.version or theirs.code != ours.code:
        return "was made by other code, whose sessions are not comparable"
    return f"was made with --seed {theirs.seed} --duration {theirs.duration_s:g}"

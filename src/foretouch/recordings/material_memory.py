"""What is remembered of a material from one session to the next: one file a name, in the user's folder of data."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path
from typing import Literal

import msgspec

from foretouch.errors import RecordingError, SettingError
from foretouch.models import ContactMapModel
from foretouch.recordings.output import atomic_path

LARGEST_FILE = 65_536  # Largest file [bytes]: longer ones are refused unread

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class _File(msgspec.Struct, forbid_unknown_fields=True):
    """The file, as JSON."""

    format: Literal["foretouch material"]
    version: Literal[1]
    material: str
    sha256: str


def memory_folder() -> Path:
    """``FORETOUCH_MATERIALS``, or ``foretouch/materials`` in ``XDG_DATA_HOME`` or ``~/.local/share``."""
    chosen = os.environ.get("FORETOUCH_MATERIALS")
    if chosen:
        return Path(chosen)
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "foretouch" / "materials"


def memory_path(name: str) -> Path:
    """The file of a remembered material; to forget it is to delete the file.

    Raises:
        SettingError: The name is none.
    """
    if not _NAME.fullmatch(name):
        rule = "must be 1 to 64 letters, digits, dots, - and _, and begin with a letter or a digit"
        raise SettingError("remember", name, rule)
    return memory_folder() / f"{name}.json"


def read_memory(name: str) -> ContactMapModel | None:
    """The map remembered under a name; None where there is none yet.

    Raises:
        SettingError: The name is none.
        RecordingError: The file cannot be read, or is not what `write_memory` writes.
    """
    path = memory_path(name)
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
    try:
        kept = msgspec.json.decode(content, type=_File) if len(content) <= LARGEST_FILE else None
        if kept is not None and _digest(kept.material) == kept.sha256:
            return ContactMapModel.from_text(kept.material)
    except (msgspec.DecodeError, SettingError):
        pass
    raise RecordingError(path, "is no remembered material of this version, or damaged: delete it to begin anew")


def write_memory(name: str, model: ContactMapModel) -> Path:
    """Keep a map under a name in place of the one before, and return the file.

    Args:
        name: Of the material.
        model: Its positions count from the surface, as those of `foretouch.identification.ContactMap.remembered`.

    Raises:
        SettingError: The name is none.
        RecordingError: The file cannot be written.
    """
    path, text = memory_path(name), model.to_text()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(path, f"cannot be written: {error.strerror or error}") from None
    with atomic_path(path) as part:
        part.write_bytes(msgspec.json.encode(_File("foretouch material", 1, text, _digest(text))))
    return path


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()

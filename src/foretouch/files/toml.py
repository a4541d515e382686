"""Reads TOML from unknown authors: small, and not deep."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from foretouch.errors import RecordingError, SettingError
from foretouch.files.budget import require_data

Made = TypeVar("Made")

LARGEST_TOML: Final = 16_384
"""Bytes of a file of settings: ten times what is written here. A parser's time grows faster than the length of a key:
one that fills the file keeps it busy for 0.1 s, one of 60 kB for several."""


def read_toml(path: str | PathLike[str], kind: type[Made], what: str, form: str = "") -> Made:
    """The content of a TOML file; an unknown key is an error where the type says so.

    Args:
        path: Path of the file.
        kind: Type of what it holds, as `msgspec` converts to it.
        what: It is, for messages: "map".
        form: What such a file takes, for messages.

    Raises:
        RecordingError: The file cannot be read, or is no such thing.
    """
    require_data(path)
    try:
        with Path(path).open("rb") as file:
            text = file.read(LARGEST_TOML + 1)
    except OSError as error:
        raise RecordingError(path, f"cannot be read: {error.strerror or error}") from None
    return decode_toml(path, text, kind, what, form)


def decode_toml(source: object, text: bytes | str, kind: type[Made], what: str, form: str = "") -> Made:
    """Read a text in the same way; messages name `source`.

    Raises:
        RecordingError: As `read_toml`.
    """
    if len(text) > LARGEST_TOML:
        raise RecordingError(source, f"is no {what}: it is longer than {LARGEST_TOML} bytes")
    try:
        return msgspec.toml.decode(text, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, SettingError) as error:
        problem = " ".join(str(error).split())
        raise RecordingError(source, f"is no {what}: {problem}{'; it takes ' * bool(form)}{form}") from None
    except RecursionError:
        raise RecordingError(source, f"is no {what}: it is nested too deep") from None

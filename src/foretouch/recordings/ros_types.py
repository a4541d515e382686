"""Definitions of ROS 2 message types: those that a file carries, else those of ROS 2's own packages (`rosbags`)."""

from __future__ import annotations

from typing import Any

from foretouch.recordings._extra import optional
from foretouch.recordings.cdr_fields import Definitions

__all__ = ["definitions_of"]

_SEPARATOR = "=" * 80 + "\n"


def definitions_of(type_name: str, text: str, encoding: str) -> Definitions:
    """Definitions of a type and of those within it.

    Args:
        type_name: As the file says, with ``/msg/``.
        text: Definition in the file, or empty.
        encoding: Of that text: ``ros2msg``, or ``ros2idl``.

    Raises:
        ValueError: The text cannot be parsed, or there is none and the type is none of ROS 2's own.
        MissingExtraError: The package ``rosbags`` is not installed.
    """
    typesys = optional("rosbags.typesys")
    if text:
        try:
            parsed = _parsed(typesys, type_name, text, encoding)
        except Exception as error:  # the parser raises many kinds on a text that is none
            raise ValueError(f"the definition of {type_name} cannot be parsed: {_one_line(error)}") from None
        if type_name in parsed:
            return parsed
    known: Definitions = typesys.get_typestore(typesys.Stores.LATEST).fielddefs
    if type_name not in known:
        raise ValueError(f"the file holds no definition of {type_name}, which is no type of ROS 2's own packages")
    return known


def _parsed(typesys: Any, type_name: str, text: str, encoding: str) -> Definitions:
    if encoding == "ros2msg":
        found: Definitions = typesys.get_types_from_msg(text, type_name)
        return found
    types: dict[str, Any] = {}
    parts = [part.split("\n", 1)[1] for part in text.split(_SEPARATOR) if part.startswith("IDL: ")]
    for part in parts or [text]:
        types.update(typesys.get_types_from_idl(part))
    return types


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__

"""Optional packages of this room, imported when they are needed."""

from __future__ import annotations

import importlib
from typing import Any

from foretouch.errors import MissingExtraError

__all__ = ["optional"]


def optional(module: str) -> Any:
    """A module of the extra ``recordings``.

    Raises:
        MissingExtraError: Its package is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        raise MissingExtraError(module.partition(".")[0], "recordings") from None

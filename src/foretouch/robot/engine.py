"""MuJoCo, imported when it is first used and whatever the environment says of drawing."""

from __future__ import annotations

import os
from typing import Any

from foretouch.errors import MissingExtraError

__all__ = ["load_mujoco"]

CHOICE, NOTHING = "MUJOCO_GL", "disable"
"""The variable that names what draws, and its value for nothing."""


def load_mujoco() -> Any:
    """The module mujoco.

    It ends its own import where ``MUJOCO_GL`` names a library that is not there. A robot draws nothing, and a camera
    makes its own context with what there is, so during the import the variable says so.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    chosen = os.environ.get(CHOICE)
    os.environ[CHOICE] = NOTHING
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("mujoco", "sim") from error
    finally:
        if chosen is None:
            del os.environ[CHOICE]
        else:
            os.environ[CHOICE] = chosen
    return mujoco

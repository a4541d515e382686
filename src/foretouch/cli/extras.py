"""Whether what a command needs is installed, before it starts processes that would each say so."""

from __future__ import annotations

import importlib.util

from foretouch.errors import MissingExtraError

__all__ = ["require_extras"]

MODULES = {"sim": "mujoco", "link": "zenoh", "console": "viser", "recordings": "mcap"}
"""By its extra, the module that shows whether it is installed."""


def require_extras(*extras: str) -> None:
    """Refuse in one line what is not installed; nothing is imported.

    Args:
        *extras: Names from `MODULES`.

    Raises:
        MissingExtraError: Naming all that are missing.
    """
    missing = [extra for extra in extras if importlib.util.find_spec(MODULES[extra]) is None]
    if missing:
        raise MissingExtraError(", ".join(MODULES[extra] for extra in missing), ",".join(missing))

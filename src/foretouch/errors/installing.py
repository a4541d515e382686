"""What to type so that something of this package is installed: by its name, or by the folder that it came from."""

from __future__ import annotations

import json
from urllib.parse import unquote, urlparse

__all__ = ["install_command"]


def install_command(*extras: str, again: bool = False) -> str:
    """A line for a shell, such as ``pip install 'foretouch[sim]'``.

    Where the package was installed from a folder, as by ``make setup``, pip is given that folder: an index need not
    have it.

    Args:
        *extras: That are wanted.
        again: Whether what is there is to be replaced.
    """
    folder, editable = _origin()
    options = ("--editable " if editable else "") + ("--force-reinstall " if again else "")
    wanted = f"{folder or 'foretouch'}[{','.join(extras)}]" if extras else folder or "foretouch"
    return f"pip install {options}'{wanted}'"


def _origin() -> tuple[str, bool]:
    """The folder that this package was installed from, or empty, and whether it is used where it lies (PEP 610)."""
    from importlib.metadata import PackageNotFoundError, distribution  # costs start-up, and this is rarely asked for

    try:
        stated = json.loads(distribution("foretouch").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        return "", False
    url = urlparse(stated.get("url", ""))
    info = stated.get("dir_info")
    if url.scheme != "file" or info is None:
        return "", False
    return unquote(url.path), bool(info.get("editable", False))

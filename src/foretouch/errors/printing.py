"""Lines for people: text of others without what it would do to a terminal, and what to type to install a package.

A package of this project is installed by its name, or from the folder that it came from.
"""

from __future__ import annotations

import json
from urllib.parse import unquote, urlparse

LONGEST_LINE = 300  # Characters of a text of others on a line of ours: it says what is wrong, and leaves room for where


def printable(text: str, *, lines: bool = False) -> str:
    r"""The same text with every character that is not printable written as Python would, ESC as ``\x1b``.

    Not printable are control characters, which move the cursor or give a terminal's window a title, ends of lines, with
    which a text looks like several, and what turns the direction of writing, with which it reads as another.

    Args:
        text: Text of a peer or a file.
        lines: Whether ends of lines stay, where a text of several lines is shown.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or (lines and letter == "\n") else letter.encode("unicode_escape").decode()
        for letter in text
    )


def one_line(text: object, longest: int = LONGEST_LINE) -> str:
    """What an exception, or a text, says: on one line, short, and `printable`; of one that cannot say it, nothing.

    Args:
        text: An exception, of any package, or a text from outside.
        longest: Largest number of characters.
    """
    try:
        words = " ".join(str(text)[: 4 * longest].split())
    except Exception:  # of another package
        return ""
    return printable(words[:longest])[:longest]


def plural(count: int, one: str) -> str:
    """A count with its noun: 1 tick, 2 ticks."""
    return f"{count:,} {one}{'' if count == 1 else 's'}"


def was_or_were(count: int) -> str:
    """The verb behind a count: 1 message was dropped, 2 messages were."""
    return "was" if count == 1 else "were"


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

"""Text of others, for a terminal: what it would do there is shown instead of done."""

from __future__ import annotations

__all__ = ["one_line", "plural", "printable", "was_or_were"]

LONGEST_LINE = 300
"""Characters of a text of others on a line of ours: it says what is wrong, and leaves room for where."""


def printable(text: str, *, lines: bool = False) -> str:
    r"""The same text with every character that is not printable written as Python would, ESC as ``\x1b``.

    Not printable are control characters, which move the cursor or give a terminal's window a title, ends of lines, with
    which a text looks like several, and what turns the direction of writing, with which it reads as another.

    Args:
        text: Of a peer or a file.
        lines: Whether ends of lines stay, where a text of several lines is shown.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or (lines and letter == "\n") else letter.encode("unicode_escape").decode()
        for letter in text
    )


def one_line(said: object, longest: int = LONGEST_LINE) -> str:
    """What an exception, or a text, says: on one line, short, and `printable`; of one that cannot say it, nothing.

    Args:
        said: An exception, of whatever package, or a text of others.
        longest: So many characters at most.
    """
    try:
        words = " ".join(str(said)[: 4 * longest].split())
    except Exception:  # of another package
        return ""
    return printable(words[:longest])[:longest]


def plural(count: int, one: str) -> str:
    """A count with its noun: 1 tick, 2 ticks."""
    return f"{count:,} {one}{'' if count == 1 else 's'}"


def was_or_were(count: int) -> str:
    """The verb behind a count: 1 message was dropped, 2 messages were."""
    return "was" if count == 1 else "were"

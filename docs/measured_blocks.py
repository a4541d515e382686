"""Blocks of the pages that scripts fill with what they measured.

A block begins with `<!-- measured: NAME -->` and ends with `<!-- end -->`, each a line of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

__all__ = ["chosen", "fill"]

BLOCK = re.compile(r"(<!-- measured: (?P<name>[a-z-]+) -->\n)(?P<old>.*?)(<!-- end -->)", re.DOTALL)


def fill(page: Path, measured: Mapping[str, str]) -> None:
    """Put what was measured, by name, into the blocks of a page; blocks of other names stay as they are.

    The page is read only now: somebody may have written to it while measuring.
    """
    text = page.read_text()
    page.write_text(BLOCK.sub(lambda block: block[1] + measured.get(block["name"], block["old"]) + block[4], text))


def chosen(names: list[str], known: Iterable[str]) -> list[str]:
    """The names that were asked for, all that are known where there are none; a wrong one ends the script."""
    there = list(known)
    unknown = [name for name in names if name not in there]
    if unknown:
        raise SystemExit(f"nothing to measure is called {', '.join(unknown)}: choose from {', '.join(there)}")
    return names or there

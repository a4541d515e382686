"""The documentation as its tests see it: pages, fenced blocks, commands."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
    + [page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts]
)

_FENCE = re.compile(r"^```(?P<language>[^\n`]*)\n(?P<text>.*?)^```\s*$", re.DOTALL | re.MULTILINE)
_COMMAND = re.compile(r"^(?:\$ )?(?:\w+=\S* )*(?:\S*/)?foretouch (?P<arguments>.*\S)$")


class Block(NamedTuple):
    """A fenced block of a page."""

    page: str
    line: int
    language: str
    text: str


def blocks() -> Iterator[Block]:
    """All fenced blocks of all pages."""
    for page in PAGES:
        content = page.read_text()
        for match in _FENCE.finditer(content):
            line = content.count("\n", 0, match.start()) + 1
            yield Block(str(page.relative_to(ROOT)), line, match["language"].strip(), match["text"])


def commands() -> dict[str, str]:
    """Arguments of every `foretouch` command in a fenced block, and where it stands first."""
    result: dict[str, str] = {}
    for block in blocks():
        for number, line in enumerate(block.text.replace("\\\n", " ").splitlines(), block.line + 1):
            match = _COMMAND.match(line.strip())
            if match:
                result.setdefault(match["arguments"], f"{block.page}:{number}")
    return result


def code_spans() -> Iterator[tuple[str, str]]:
    """Page and text of every piece of code, in a line or in a fenced block."""
    for page in PAGES:
        for span in re.findall(r"`([^`\n]+)`", _FENCE.sub("", page.read_text())):
            yield str(page.relative_to(ROOT)), span
    for block in blocks():
        for line in block.text.splitlines():
            yield block.page, line.removeprefix("$ ")

"""Blocks of the pages that scripts fill with what they measured, and of which code that was.

A block begins with `<!-- measured: NAME of DIGEST -->` and ends with `<!-- end -->`, each a line of its own. The digest
is that of the sources which the figures depend on (`docs/measured_sources.py` says where their measuring begins). Where
the sources are others by now, the block must say so to its readers, by the sentence `EARLIER` at its top.

Usage: `.venv/bin/python docs/measured_blocks.py` names every block that is of earlier code and does not say so, with
what has changed since, and ends with 1 if there is one; it is a part of `make check`.
It prints one line, too, on the blocks that do say so, by page: these wait to be measured again. With `--mark` it writes
the sentence into these blocks, and takes it away where the sources are those of the figures again.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from measured_sources import BLOCKS, ROOT, Key, digests, reached_by, sources_of
from sources import Module, Sources

__all__ = ["BLOCK", "EARLIER", "chosen", "fill", "loaded", "problems"]

BLOCK = re.compile(
    r"<!-- measured: (?P<name>[a-z-]+)(?: of (?P<digest>\w+))? -->\n(?P<text>.*?)<!-- end -->", re.DOTALL
)

EARLIER = "*Measured on earlier code.*\n\n"
"""At the top of a block that is not of the code as it is."""

UNKNOWN = "unknown"
"""Instead of a digest: of code that nobody noted down, or that changed while it was measured."""

_AT_BEGIN = {} if __name__ == "__main__" else digests(sources_of())
"""The digests when a script began, for that is the code which it loaded."""


def fill(page: Path, measured: Mapping[str, str], *, current: bool = True) -> None:
    """Put what was measured, by name, into the blocks of a page; blocks of other names stay as they are.

    The page is read only now: somebody may have written to it while measuring. Where the sources of a block were
    changed meanwhile, nobody knows which of them gave the figures: the block says that it is of earlier code.

    Args:
        page: Below the root of the project.
        measured: Text of each block.
        current: Whether this process measured it; what was kept by an earlier one may be of earlier code.
    """
    now = digests(sources_of())

    def replaced(block: re.Match[str]) -> str:
        name = block["name"]
        if name not in measured:
            return block[0]
        key = key_of(page, name)
        if current and now[key] == _AT_BEGIN[key]:
            return written(name, now[key], measured[name])
        return written(name, UNKNOWN, EARLIER + measured[name])

    page.write_text(BLOCK.sub(replaced, page.read_text()))


def loaded(page: Path, name: str) -> str | None:
    """The digest of the sources of a block that this script loaded: what is kept for later is of these."""
    return _AT_BEGIN[key_of(page, name)]


def written(name: str, digest: str | None, text: str) -> str:
    """A whole block."""
    return f"<!-- measured: {name}{f' of {digest}' if digest else ''} -->\n{text}<!-- end -->"


def key_of(page: Path, name: str) -> Key:
    """The block's place in the table of sources.

    Raises:
        SystemExit: It has none.
    """
    key = page.resolve().relative_to(ROOT).as_posix(), name
    if key not in BLOCKS:
        raise SystemExit(f"{key[0]}: docs/measured_sources.py does not say what the block {name} depends on")
    return key


def chosen(names: list[str], known: Iterable[str]) -> list[str]:
    """The names that were asked for, all that are known where there are none; a wrong one ends the script."""
    there = list(known)
    unknown = [name for name in names if name not in there]
    if unknown:
        raise SystemExit(f"nothing to measure is called {', '.join(unknown)}: choose from {', '.join(there)}")
    return names or there


class Block(NamedTuple):
    """A block of a page: its place in the table of sources, the digest in its header, and what it says."""

    page: Path
    key: Key
    digest: str | None
    text: str


def blocks() -> Iterator[Block]:
    """All blocks of all pages."""
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        if "_build" not in page.parts:
            for found in BLOCK.finditer(page.read_text()):
                yield Block(page, key_of(page, found["name"]), found["digest"], found["text"])


def problems(sources: Sources) -> Iterator[str]:
    """A sentence for every block that does not say truly of which code it is."""
    there, now = list(blocks()), digests(sources)
    for key in BLOCKS.keys() - {block.key for block in there}:
        yield f"{key[0]}: there is no block {key[1]}, of which docs/measured_sources.py speaks"
    for page, key, digest, text in there:
        stale, said = digest != now[key], text.startswith(EARLIER)
        if stale and not said:
            yield f"{key[0]}: {key[1]} was measured on earlier code{changed_since(page, key, digest, sources)}"
        elif said and not stale:
            yield f"{key[0]}: {key[1]} is of the code as it is, and says that it is not"


def earlier() -> str:
    """One line on the blocks that say that they are of earlier code, by page; "" where none does."""
    pages = Counter(block.key[0] for block in blocks() if block.text.startswith(EARLIER))
    count = sum(pages.values())
    told = ", ".join(f"{page} {number}" for page, number in pages.items())
    return f"{count} measured blocks say that they are of earlier code: {told}" if count else ""


def mark(sources: Sources) -> None:
    """Write the sentence into every block that is of earlier code, and take it out of the others."""
    now = digests(sources)
    for page in {block.page for block in blocks()}:

        def replaced(block: re.Match[str], page: Path = page) -> str:
            text = block["text"].removeprefix(EARLIER)
            stale = block["digest"] != now[key_of(page, block["name"])]
            return written(block["name"], block["digest"], EARLIER + text if stale else text)

        before = page.read_text()
        after = BLOCK.sub(replaced, before)
        if after != before:
            page.write_text(after)


def changed_since(page: Path, key: Key, digest: str | None, sources: Sources) -> str:
    """What a block depends on that is not what it was when its digest was written, as far as Git knows."""
    header = f"<!-- measured: {key[1]} of {digest} -->"
    commit = git("log", "--max-count=1", "--format=%H", f"-S{header}", "--", str(page)) if digest else None
    if not commit:
        return ""
    paths = set((git("diff", "--name-only", commit) or "").splitlines())
    names: dict[str, list[str]] = {}
    for name, part in reached_by(key, sources):
        names.setdefault(name, []).append(part)
    changed = []
    for name, parts in names.items():
        module = sources.module(name)
        path = "" if module is None else module.path.relative_to(ROOT).as_posix()
        if module is None or path not in paths:
            continue
        earlier = Module(name, module.path, git("show", f"{commit}:{path}") or "")
        if any(module.digest(part) != earlier.digest(part) for part in parts):
            changed.append(path)
    return f": since {commit[:7]} {', '.join(sorted(changed))}" if changed else f" than that of {commit[:7]}"


def git(*arguments: str) -> str | None:
    """What Git says; None where there is none, or it has nothing to say."""
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def main(arguments: list[str]) -> None:
    """Check, or mark."""
    sources = sources_of()
    if arguments not in ([], ["--mark"]):
        raise SystemExit("usage: measured_blocks.py [--mark]")
    try:
        if arguments:
            mark(sources)
        found = list(problems(sources))
    except LookupError as error:
        raise SystemExit(f"docs/measured_sources.py: {error}") from None
    for problem in found:
        print(problem, file=sys.stderr)
    if found:
        advice = "measure again by the script that the page names, or let the pages say it: `make mark-earlier`"
        raise SystemExit(f"{len(found)} measured blocks do not say truly of which code they are: {advice}")
    if said := earlier():
        print(said)


if __name__ == "__main__":
    main(sys.argv[1:])

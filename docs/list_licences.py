"""List every package of the lock, its licence as it states it, and what brings it: the table of `docs/licences.md`.

.venv/bin/python docs/list_licences.py
"""

from __future__ import annotations

import importlib.metadata as metadata
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCKED = re.compile(r"^([a-z0-9][a-z0-9.-]*)==(\S+)", re.MULTILINE)
REQUIRED = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]*)(?:\[([^\]]*)\])?")
EXTRA = re.compile(r"extra == ['\"]([^'\"]+)['\"]")
FAMILY = {"BSD": "BSD License", "": "not stated"}
ANY = "any OSI-approved licence (its maintainers' words)"
ELSEWHERE = "for other systems or versions of Python; not looked at here"


def normal(name: str) -> str:
    """A package's name as the lock writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(name: str) -> str:
    """What an installed package says of itself."""
    said = metadata.metadata(name)
    classified = [line.rpartition("::")[2].strip() for line in said.get_all("Classifier", []) if "License ::" in line]
    text = said.get("License-Expression") or "; ".join(classified) or (said.get("License") or "").split("\n")[0].strip()
    return ANY if text == "any-OSI" else FAMILY.get(text, text)


def required(name: str, extras: tuple[str, ...] = ()) -> list[tuple[str, tuple[str, ...]]]:
    """What an installed package asks for, with the extras that it asks for of it."""
    found = []
    for line in metadata.requires(name) or []:
        extra = EXTRA.search(line)
        match = REQUIRED.match(line)
        if match and (extra is None or extra[1] in extras):
            found.append((normal(match[1]), tuple(filter(None, (match[2] or "").replace(" ", "").split(",")))))
    return found


def brought(extras: tuple[str, ...]) -> set[str]:
    """Names of all packages that foretouch with these extras brings."""
    there: set[tuple[str, tuple[str, ...]]] = set()
    todo = [("foretouch", extras)]
    while todo:
        one = todo.pop()
        if one in there:
            continue
        there.add(one)
        try:
            todo += required(*one)
        except metadata.PackageNotFoundError:
            continue
    return {name for name, _ in there}


def rows() -> list[tuple[str, str, str, str]]:
    """Name, version, licence and what brings it, of every package of the lock."""
    known = metadata.metadata("foretouch").get_all("Provides-Extra", [])
    base = brought(())
    by_extra = {extra: brought((extra,)) - base for extra in known if extra != "all"}
    found = []
    for name, version in LOCKED.findall((ROOT / "requirements.lock").read_text()):
        by = "base" if name in base else ", ".join(extra for extra in by_extra if name in by_extra[extra])
        try:
            stated = licence(name)
        except metadata.PackageNotFoundError:
            stated = ELSEWHERE
        found.append((name, version, stated, by or "the lock"))
    return found


if __name__ == "__main__":
    for row in rows():
        print(" | ".join(row))

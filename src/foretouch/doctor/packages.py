"""Python, the packages that foretouch needs, and its extras, as the installed metadata names them."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from typing import Any

from foretouch.doctor.finding import Finding, Verdict
from foretouch.errors import install_command

__all__ = ["check_extras", "check_packages", "check_python", "parts_of", "satisfies"]

NEEDED = ("sim", "link")
"""Extras without which no session runs; others are for what their names say."""

FOR_DEVELOPERS = ("dev", "docs", "all")
"""Extras that are no part of what the package can do."""

_REQUIREMENT = re.compile(r"(?P<name>[A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*(?P<rule>[^;]*)(?:;(?P<marker>.*))?")
_EXTRA = re.compile(r"""extra\s*==\s*['"](?P<extra>[^'"]+)['"]""")
_RULE = re.compile(r"(?P<sign>>=|<=|==|!=|>|<)\s*(?P<version>\d+(?:\.\d+)*)")


def check_python() -> Finding:
    """Version and implementation, beside what the package was made for."""
    version, implementation = platform.python_version(), platform.python_implementation()
    wanted = str(metadata.metadata("foretouch")["Requires-Python"] or "")
    free_threaded = not getattr(sys, "_is_gil_enabled", lambda: True)()
    found = f"{implementation} {version}{', free-threaded' if free_threaded else ''}, {platform.machine()}"
    figures = {"version": version, "implementation": implementation, "wanted": wanted, "machine": platform.machine()}
    if implementation != "CPython" or free_threaded or not satisfies(version, wanted):
        found += f"; needed is CPython {wanted} with its global lock"
        return Finding("Python", Verdict.BAD, found, "uv venv --python 3.13", figures)
    return Finding("Python", Verdict.GOOD, found, figures=figures)


def check_packages(requirements: Iterable[str] | None = None) -> Finding:
    """The packages that are always needed.

    Args:
        requirements: As in the metadata of a distribution; foretouch's own where none are given.
    """
    needed = parts_of(_own(requirements)).get("", {})
    problems = _problems(needed)
    figures: dict[str, Any] = {"needed": {name: _version(name) for name in needed}, "problems": problems}
    if problems:
        mend = install_command(again=True)
        return Finding("packages", Verdict.BAD, "; ".join(problems.values()), mend, figures)
    found = ", ".join(f"{name} {_version(name)}" for name in needed)
    return Finding("packages", Verdict.GOOD, found, figures=figures)


def check_extras(requirements: Iterable[str] | None = None) -> Finding:
    """Which extras are complete, and which are not: those without which no session runs are worth a warning.

    Args:
        requirements: As in the metadata of a distribution; foretouch's own where none are given.
    """
    extras = {name: part for name, part in parts_of(_own(requirements)).items() if name not in ("", *FOR_DEVELOPERS)}
    problems = {name: list(wrong.values()) for name, part in extras.items() if (wrong := _problems(part))}
    complete = [name for name in extras if name not in problems]
    outdated = [name for name in problems if any(_version(package) for package in extras[name])]
    figures = {"complete": complete, "incomplete": problems}
    found = f"there: {', '.join(complete) or 'none'}"
    if not problems:
        return Finding("extras", Verdict.GOOD, found, figures=figures)
    found += f"; not there: {', '.join(problems)}"
    missed = [name for name in problems if name in NEEDED or name in outdated]
    if missed:
        details = "; ".join(text for extra in missed for text in problems[extra])
        found += f" ({details})"
    mend = install_command(*(missed or problems))
    return Finding("extras", Verdict.WARNING if missed else Verdict.GOOD, found, mend, figures)


def parts_of(requirements: Iterable[str]) -> dict[str, dict[str, str]]:
    """Requirements by extra, "" for those that are always needed: package and rule on its version."""
    parts: dict[str, dict[str, str]] = {}
    for line in requirements:
        match = _REQUIREMENT.match(line.strip())
        if match is None:
            continue
        extra = _EXTRA.search(match["marker"] or "")
        parts.setdefault(extra["extra"] if extra else "", {})[match["name"]] = match["rule"].strip()
    return parts


def satisfies(version: str, rule: str) -> bool:
    """Whether a version keeps rules such as ``>=3.11,<3.14``; a rule of another form is taken as kept.

    Versions are compared by their numbers, as PEP 440 does for releases; what follows them (``rc1``) is left out.
    """
    ours = _numbers(version)
    for match in _RULE.finditer(rule):
        theirs = _numbers(match["version"])
        size = max(len(ours), len(theirs))
        a, b = (part + (0,) * (size - len(part)) for part in (ours, theirs))
        kept = {">=": a >= b, "<=": a <= b, "==": a == b, "!=": a != b, ">": a > b, "<": a < b}
        if not kept[match["sign"]]:
            return False
    return True


def _numbers(version: str) -> tuple[int, ...]:
    match = re.match(r"\d+(?:\.\d+)*", version)
    return tuple(int(part) for part in match[0].split(".")) if match else ()


def _own(requirements: Iterable[str] | None) -> Iterable[str]:
    return (metadata.requires("foretouch") or ()) if requirements is None else requirements


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _problems(needed: Mapping[str, str]) -> dict[str, str]:
    """By package, what is wrong with it."""
    problems = {}
    for name, rule in needed.items():
        version = _version(name)
        if version is None:
            problems[name] = f"{name} is not installed"
        elif not satisfies(version, rule):
            problems[name] = f"{name} {version} is installed, needed is {rule}"
    return problems

"""What else a session meets on this machine: Python, packages and extras, text, disk, ports, keys.

Packages and extras are those that the installed metadata names.
"""

from __future__ import annotations

import locale
import os
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Mapping
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from foretouch.doctor.finding import Finding, Verdict
from foretouch.errors import ForetouchError, LinkError, MissingExtraError, install_command

NEEDED = ("sim", "link")  # Extras without which no session runs; others are for what their names say
FOR_DEVELOPERS = ("dev", "docs", "all")  # Extras that are no part of what the package can do

_REQUIREMENT = re.compile(r"(?P<name>[A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*(?P<rule>[^;]*)(?:;(?P<marker>.*))?")
_EXTRA = re.compile(r"""extra\s*==\s*['"](?P<extra>[^'"]+)['"]""")
_RULE = re.compile(r"(?P<sign>>=|<=|==|!=|>|<)\s*(?P<version>\d+(?:\.\d+)*)")


def check_python() -> Finding:
    """Version and implementation, beside what the package was made for."""
    version, implementation = platform.python_version(), platform.python_implementation()
    wanted = str(metadata.metadata("foretouch")["Requires-Python"] or "")
    free_threaded = not getattr(sys, "_is_gil_enabled", lambda: True)()
    text = f"{implementation} {version}{', free-threaded' if free_threaded else ''}, {platform.machine()}"
    figures = {"version": version, "implementation": implementation, "wanted": wanted, "machine": platform.machine()}
    if implementation != "CPython" or free_threaded or not satisfies(version, wanted):
        text += f"; needed is CPython {wanted} with its global lock"
        return Finding("Python", Verdict.BAD, text, "uv venv --python 3.13", figures)
    return Finding("Python", Verdict.GOOD, text, figures=figures)


def check_packages(requirements: Iterable[str] | None = None) -> Finding:
    """The packages that are always needed, of requirements as in metadata, by default foretouch's own."""
    needed = parts_of(_own(requirements)).get("", {})
    problems = _problems(needed)
    figures: dict[str, Any] = {"needed": {name: _version(name) for name in needed}, "problems": problems}
    if problems:
        mend = install_command(again=True)
        return Finding("packages", Verdict.BAD, "; ".join(problems.values()), mend, figures)
    text = ", ".join(f"{name} {_version(name)}" for name in needed)
    return Finding("packages", Verdict.GOOD, text, figures=figures)


def check_extras(requirements: Iterable[str] | None = None) -> Finding:
    """Complete and incomplete extras of such requirements; those without which no session runs are worth a warning."""
    extras = {name: part for name, part in parts_of(_own(requirements)).items() if name not in ("", *FOR_DEVELOPERS)}
    problems = {name: list(wrong.values()) for name, part in extras.items() if (wrong := _problems(part))}
    complete = [name for name in extras if name not in problems]
    outdated = [name for name in problems if any(_version(package) for package in extras[name])]
    figures = {"complete": complete, "incomplete": problems}
    finding = f"there: {', '.join(complete) or 'none'}"
    if not problems:
        return Finding("extras", Verdict.GOOD, finding, figures=figures)
    finding += f"; not there: {', '.join(problems)}"
    missed = [name for name in problems if name in NEEDED or name in outdated]
    if missed:
        details = "; ".join(text for extra in missed for text in problems[extra])
        finding += f" ({details})"
    mend = install_command(*(missed or problems))
    return Finding("extras", Verdict.WARNING if missed else Verdict.GOOD, finding, mend, figures)


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
    problems = {}
    for name, rule in needed.items():
        version = _version(name)
        if version is None or not satisfies(version, rule):
            what = "is not installed" if version is None else f"{version} is installed, needed is {rule}"
            problems[name] = f"{name} {what}"
    return problems


PORTS = {8080: "the console", 7447: "a link"}  # Ports that commands take by default, and their use

LITTLE, TOO_LITTLE = 2e9, 2e8
"""Free space [bytes]: a session writes 25 MB a minute, so they are enough for 80 and for 8 minutes."""


def check_text() -> Finding:
    """Whether units and Greek letters can be printed, and file names read."""
    shown = {
        "output": getattr(sys.stdout, "encoding", None) or "none",
        "locale": locale.getpreferredencoding(False),
        "file_names": sys.getfilesystemencoding(),
    }
    others = {what: name for what, name in shown.items() if name.lower().replace("-", "").replace("_", "") != "utf8"}
    figures = {**shown, "LANG": os.environ.get("LC_ALL") or os.environ.get("LANG", "")}
    if not others:
        return Finding("text", Verdict.GOOD, "UTF-8", figures=figures)
    text = ", ".join(f"{what.replace('_', ' ')}: {name}" for what, name in others.items())
    return Finding("text", Verdict.WARNING, f"not all is UTF-8 ({text})", "export PYTHONUTF8=1", figures)


def check_disk(
    folders: Iterable[Path] | None = None, *, little: float = LITTLE, too_little: float = TOO_LITTLE
) -> Finding:
    """Free space where recordings, temporary files and compiled code go: here, in the temporary folder and at home.

    Less than `little` [bytes] is worth a warning, less than `too_little` is bad.
    """
    looked = [Path.cwd(), Path(tempfile.gettempdir()), Path.home()] if folders is None else list(folders)
    free: dict[str, int] = {}
    for folder in looked:
        try:
            free[str(folder)] = shutil.disk_usage(folder).free
        except OSError as error:
            text, figures = f"{folder}: {error.strerror}", {"free_bytes": free}
            return Finding("disk", Verdict.BAD, text, f"mkdir -p {folder}", figures)
    least = min(free, key=free.__getitem__)
    text = ", ".join(f"{folder} {size / 1e9:.1f} GB" for folder, size in free.items()) + " free"
    verdict = Verdict.BAD if free[least] < too_little else Verdict.WARNING if free[least] < little else Verdict.GOOD
    mend = "" if verdict is Verdict.GOOD else f"du -xh {least} | sort -h | tail"
    return Finding("disk", verdict, text, mend, {"free_bytes": free})


def check_compiled() -> Finding:
    """Whether the code of sessions was compiled here: else the first start takes about a minute longer."""
    from foretouch.core.compiling import compiled_root
    from foretouch.session.runners.warm_up import is_compiled

    root = compiled_root()
    figures = {"folder": "" if root is None else str(root), "compiled": root is not None and is_compiled()}
    if root is None:
        text = "no folder of your own to keep it in: each start compiles for about a minute"
        return Finding("compiled", Verdict.WARNING, text, "export NUMBA_CACHE_DIR=~/.foretouch-compiled", figures)
    if not is_compiled():
        text = "never, of these sources: the first start takes about a minute longer"
        return Finding("compiled", Verdict.WARNING, text, "foretouch warm-up", figures)
    return Finding("compiled", Verdict.GOOD, "all that a session runs", figures=figures)


def check_port(port: int) -> Finding:
    """Whether a process could listen at a port of 127.0.0.1 now."""
    from foretouch.link import check_port_free

    name, figures = f"port {port}", {"port": port, "for": PORTS.get(port, "")}
    try:
        check_port_free(f"tcp/127.0.0.1:{port}")
    except LinkError as error:
        mend = f"ss -ltnp 'sport = :{port}'"
        return Finding(name, Verdict.WARNING, f"{error}", mend, figures | {"free": False})
    wanted = f", for {PORTS[port]}" if port in PORTS else ""
    return Finding(name, Verdict.GOOD, f"free{wanted}", figures=figures | {"free": True})


def check_keys(folder: Path | None = None, *, now: datetime | None = None) -> Finding:
    """The certificates in a folder, by default the usual one, their names, and the time [UTC] until which they last."""
    from foretouch.link import WARNING_DAYS, KeyFolder
    from foretouch.link.certificates import utc_now

    keys, now = KeyFolder(folder), utc_now() if now is None else now
    if not keys.path.exists():
        text = f"none in {keys.path}; needed between machines only (foretouch keys init)"
        return Finding("keys", Verdict.GOOD, text, figures={"folder": str(keys.path)})
    try:
        authority, here, _ = keys.read()
        stranger = [name for name, identity in here.items() if not identity.issued_by(authority)]
    except MissingExtraError as error:
        return Finding("keys", Verdict.UNKNOWN, str(error), install_command("security"))
    except ForetouchError as error:
        mend = str(error).rpartition(": ")[2]
        command = mend if mend.startswith(("chmod", "mkdir")) else "foretouch keys show"
        return Finding("keys", Verdict.BAD, str(error), command, {"folder": str(keys.path)})
    left = {name: identity.days_left(now) for name, identity in {"authority": authority, **here}.items()}
    figures: dict[str, object] = {"folder": str(keys.path), "days_left": left, "of_another_authority": stranger}
    first = min(left, key=left.__getitem__)
    mend = "foretouch keys rotate --authority" if first == "authority" else f"foretouch keys rotate {first}"
    ends = f"{', '.join(left)}; the first to end is {first}, in {left[first]:.1f} days"
    if left[first] <= 0.0:
        return Finding("keys", Verdict.BAD, f"{first} has expired {-left[first]:.1f} days ago", mend, figures)
    if stranger:
        text = f"{', '.join(stranger)}: from another authority than authority.crt, let in nowhere"
        return Finding("keys", Verdict.BAD, text, f"foretouch keys rotate {stranger[0]}", figures)
    if left[first] <= WARNING_DAYS:
        return Finding("keys", Verdict.WARNING, ends, mend, figures)
    return Finding("keys", Verdict.GOOD, ends, figures=figures)

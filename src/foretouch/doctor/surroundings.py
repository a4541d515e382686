"""What else a session meets on this machine: text, disk, ports, keys."""

from __future__ import annotations

import locale
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

from foretouch.doctor.finding import Finding, Verdict
from foretouch.errors import ForetouchError, LinkError, MissingExtraError, install_command

__all__ = ["PORTS", "check_compiled", "check_disk", "check_keys", "check_port", "check_text"]

PORTS = {8080: "the console", 7447: "a link"}
"""Ports that commands take unless they are told otherwise, and what for."""

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
    if others:
        found = ", ".join(f"{what.replace('_', ' ')}: {name}" for what, name in others.items())
        return Finding("text", Verdict.WARNING, f"not all is UTF-8 ({found})", "export PYTHONUTF8=1", figures)
    return Finding("text", Verdict.GOOD, "UTF-8", figures=figures)


def check_disk(
    folders: Iterable[Path] | None = None, *, little: float = LITTLE, too_little: float = TOO_LITTLE
) -> Finding:
    """Free space where recordings, temporary files and compiled code go.

    Args:
        folders: To look at; where none are given, this folder, the temporary one and the home.
        little: Less is worth a warning [bytes].
        too_little: Less is bad [bytes].
    """
    looked = [Path.cwd(), Path(tempfile.gettempdir()), Path.home()] if folders is None else list(folders)
    free: dict[str, int] = {}
    for folder in looked:
        try:
            free[str(folder)] = shutil.disk_usage(folder).free
        except OSError as error:
            return Finding(
                "disk", Verdict.BAD, f"{folder}: {error.strerror}", f"mkdir -p {folder}", {"free_bytes": free}
            )
    least = min(free, key=free.__getitem__)
    found = ", ".join(f"{folder} {size / 1e9:.1f} GB" for folder, size in free.items()) + " free"
    verdict = Verdict.BAD if free[least] < too_little else Verdict.WARNING if free[least] < little else Verdict.GOOD
    mend = "" if verdict is Verdict.GOOD else f"du -xh {least} | sort -h | tail"
    return Finding("disk", verdict, found, mend, {"free_bytes": free})


def check_compiled() -> Finding:
    """Whether the code of sessions was compiled here: else the first start takes about a minute longer."""
    from foretouch.core.compiling import compiled_root
    from foretouch.session.warm_up import is_compiled

    root = compiled_root()
    figures = {"folder": "" if root is None else str(root), "compiled": root is not None and is_compiled()}
    if root is None:
        found = "no folder of your own to keep it in: each start compiles for about a minute"
        return Finding("compiled", Verdict.WARNING, found, "export NUMBA_CACHE_DIR=~/.foretouch-compiled", figures)
    if not is_compiled():
        found = "never, of these sources: the first start takes about a minute longer"
        return Finding("compiled", Verdict.WARNING, found, "foretouch warm-up", figures)
    return Finding("compiled", Verdict.GOOD, "all that a session runs", figures=figures)


def check_port(port: int) -> Finding:
    """Whether somebody could listen there now.

    Args:
        port: On 127.0.0.1.
    """
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
    """The certificates here, whose they are, and until when they last.

    Args:
        folder: Of keys; the usual one where none is given.
        now: UTC; this machine's clock where none is given.
    """
    from foretouch.link import WARNING_DAYS, KeyFolder
    from foretouch.link.certificates import utc_now

    keys, now = KeyFolder(folder), utc_now() if now is None else now
    if not keys.path.exists():
        found = f"none in {keys.path}; needed between machines only (foretouch keys init)"
        return Finding("keys", Verdict.GOOD, found, figures={"folder": str(keys.path)})
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
    return _judge_keys(left, stranger, figures, WARNING_DAYS)


def _judge_keys(left: dict[str, float], stranger: list[str], figures: dict[str, object], warning: float) -> Finding:
    """The worst of what was found of the certificates."""
    first = min(left, key=left.__getitem__)
    mend = "foretouch keys rotate --authority" if first == "authority" else f"foretouch keys rotate {first}"
    ends = f"{', '.join(left)}; the first to end is {first}, in {left[first]:.1f} days"
    if left[first] <= 0.0:
        return Finding("keys", Verdict.BAD, f"{first} has expired {-left[first]:.1f} days ago", mend, figures)
    if stranger:
        found = f"{', '.join(stranger)}: from another authority than authority.crt, let in nowhere"
        return Finding("keys", Verdict.BAD, found, f"foretouch keys rotate {stranger[0]}", figures)
    if left[first] <= warning:
        return Finding("keys", Verdict.WARNING, ends, mend, figures)
    return Finding("keys", Verdict.GOOD, ends, figures=figures)

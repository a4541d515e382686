"""Sessions with a plug-in that is made for a test."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from plugin_packages import make_package

COMMAND = [sys.executable, "-m", "foretouch"]


class Ran(NamedTuple):
    """A command that has ended: its exit code, what it printed, what it said, and how long it took [s]."""

    code: int
    out: str
    err: str
    seconds: float


def environment(site: Path) -> dict[str, str]:
    """Of processes that find the packages in this folder."""
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}


def run_with(folder: Path, kind: str, source: str, target: str, *arguments: object, seconds: float = 90.0) -> Ran:
    """Run a `foretouch` command where a package of this source is installed, in this folder.

    Args:
        folder: To run in.
        kind: Of the entry point.
        source: Of the package's module.
        target: The entry point's name, and that of the function that it is.
        *arguments: Of the command.
        seconds: It has to end within.
    """
    site = folder / "site"
    if not site.exists():
        make_package(site, "made-up", {kind: {target: f"made_up:{target}"}}, source)
    begun = time.monotonic()
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment(site),
        timeout=seconds,
    )
    return Ran(done.returncode, done.stdout, done.stderr, time.monotonic() - begun)

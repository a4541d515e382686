"""Sessions with a device that the package brings as a plug-in, as processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def teleop(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A session in real time, where the packages in a folder are installed too.

    Args:
        site: That folder.
        folder: To run in.
        *words: Of the command.
    """
    path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "foretouch", "teleop", "--headless", "--json", *words],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        timeout=120.0,
    )

"""The process of `other_node.py`, for a test."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parent / "other_node.py"


class OtherNode:
    """The running process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def set(self, **values: object) -> None:
        """Have it say something else from now on."""
        assert self.process.stdin is not None
        for name, value in values.items():
            text = {True: "yes", False: "no"}[value] if isinstance(value, bool) else value
            self.process.stdin.write(f"{name} {text}\n")
        self.process.stdin.flush()

    def says(self) -> dict[str, Any]:
        """What it has heard, and its state."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("say\n")
        self.process.stdin.flush()
        said: dict[str, Any] = json.loads(self.process.stdout.readline())
        return said

    def got(self) -> list[float] | None:
        """The force of the newest wrench [N]; None before the first."""
        last = self.says()["last"]
        return None if last is None else last["force"]  # type: ignore[no-any-return]


@contextmanager
def other_node(what: str, endpoint: str) -> Iterator[OtherNode]:
    """An arm or a hand's device on the graph at a router; it ends with the block."""
    command = [sys.executable, str(SCRIPT), what, endpoint.rpartition(":")[2]]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        try:
            yield OtherNode(process)
        finally:
            process.kill()

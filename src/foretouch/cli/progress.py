"""How far something is that takes more than a moment: a bar on a terminal, and nothing for those who have none."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from foretouch.cli.options import say

__all__ = ["SHOWN_AFTER", "Bar", "progress_bar"]

SHOWN_AFTER = 1.0
"""What takes less than this [s] shows no bar."""


class Bar:
    """A bar on the error stream, or nothing where that is no terminal: the output stays clean in either case.

    Attributes:
        shown: Whether there is a terminal to show it on.
    """

    def __init__(self, title: str) -> None:
        self.shown = sys.stderr.isatty()
        self._title = title
        self._begun = time.monotonic()
        self._drawn: Any = None
        self._task: Any = None

    def update(self, done: float, total: float | None, title: str = "") -> None:
        """Say how far it is.

        Args:
            done: In the same unit as `total`.
            total: None where nobody knows.
            title: What is being done now; without one, the bar's own.
        """
        if not self.shown:
            return
        if self._drawn is None:
            if time.monotonic() - self._begun < SHOWN_AFTER and total is not None:
                return
            self._draw()
        self._drawn.update(self._task, completed=done, total=total, description=title or self._title)

    def say(self, line: str) -> None:
        """A line for people, above the bar."""
        if self._drawn is None:
            say(line)
        else:
            self._drawn.console.print(line, highlight=False, markup=False, soft_wrap=True)

    def close(self) -> None:
        """Take the bar away."""
        if self._drawn is not None:
            self._drawn.stop()
            self._drawn = None

    def _draw(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
        from rich.progress import TimeRemainingColumn as Left

        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), Left())
        self._drawn = Progress(*columns, console=Console(stderr=True), transient=True)
        self._task = self._drawn.add_task(self._title, total=None)
        self._drawn.start()


@contextmanager
def progress_bar(title: str) -> Iterator[Bar]:
    """A bar that is gone when the work is done, however it ends.

    Args:
        title: What is being done.
    """
    bar = Bar(title)
    try:
        yield bar
    finally:
        bar.close()

"""Progress of work that takes more than a moment: a bar on a terminal, and nothing elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

from foretouch.cli.options import say

Given = ParamSpec("Given")
Made = TypeVar("Made")

SHOWN_AFTER = 1.0  # What takes less than this [s] shows no bar


class Bar:
    """A bar on the error stream, or nothing where that is no terminal (`shown`): the output stays clean either way.

    A thread keeps it moving; one that is not `refreshing` is drawn when it is updated, and disturbs no measurement.
    """

    def __init__(self, title: str, *, refreshing: bool = True) -> None:
        self.shown = sys.stderr.isatty()
        self._state: dict[str, Any] = {"completed": 0.0, "total": None, "description": title}
        self._title = title
        self._refreshing = refreshing
        self._waits: threading.Timer | None = None
        self._drawing = threading.Lock()
        self._begun = time.monotonic()
        self._drawn: Any = None
        self._task: Any = None

    def update(self, done: float, total: float | None, title: str = "") -> None:
        """Update the progress."""
        if not self.shown:
            return
        self._state = {"completed": done, "total": total, "description": title or self._title}
        if self._drawn is None and self._refreshing and time.monotonic() - self._begun < SHOWN_AFTER:
            return
        self._draw()
        self._drawn.update(self._task, **self._state, refresh=not self._refreshing)

    def pulse(self) -> None:
        """Be shown from `SHOWN_AFTER` on while something runs that reports no progress."""
        if self.shown:
            self._waits = threading.Timer(SHOWN_AFTER, self._draw)
            self._waits.daemon = True
            self._waits.start()

    def say(self, line: str) -> None:
        """A line for people, above the bar."""
        if self._drawn is None:
            say(line)
        else:
            self._drawn.console.print(line, highlight=False, markup=False, soft_wrap=True)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """The bar is away meanwhile: the output stream may be the same terminal."""
        if self._drawn is not None:
            self._drawn.stop()
        try:
            yield
        finally:
            if self._drawn is not None:
                self._drawn.start()

    def close(self) -> None:
        """Take the bar away."""
        with self._drawing:
            self.shown = False
            if self._waits is not None:
                self._waits.cancel()
            if self._drawn is not None:
                self._drawn.stop()
                self._drawn = None

    def _draw(self) -> None:
        from rich.console import Console
        from rich.progress import Progress, TimeElapsedColumn

        with self._drawing:
            if self.shown and self._drawn is None:
                text, bar, percent, left = Progress.get_default_columns()
                columns = (text, bar, percent, TimeElapsedColumn(), left)
                console, moving = Console(stderr=True), self._refreshing
                drawn = Progress(*columns, console=console, transient=True, auto_refresh=moving, redirect_stdout=False)
                self._task = drawn.add_task(**self._state)
                drawn.start()
                self._drawn = drawn


@contextmanager
def progress_bar(title: str, *, refreshing: bool = True) -> Iterator[Bar]:
    """A bar that is gone when the work is done, however it ends."""
    bar = Bar(title, refreshing=refreshing)
    try:
        yield bar
    finally:
        bar.close()


def pulsing(title: str, work: Callable[Given, Made], *given: Given.args, **named: Given.kwargs) -> Made:
    """Do work that reports no progress, under a bar that only shows that it goes on."""
    with progress_bar(title) as bar:
        bar.pulse()
        return work(*given, **named)


def compile_first() -> bool:
    """Compile everything on the first use, and say so, by a bar on a terminal; whether everything is compiled now."""
    from foretouch.session.runners.warm_up import compile_all, is_compiled

    if is_compiled():
        return True
    say("compiling what sessions run, once for this code on this machine, in about a minute")
    reported = 0.2
    with progress_bar("compiling") as bar:

        def progress(fraction: float) -> None:
            nonlocal reported
            bar.update(fraction, 1.0)
            if not bar.shown and reported <= fraction < 1.0:
                say(f"compiling, {fraction:.0%}")
                reported += 0.2

        return compile_all(progress)

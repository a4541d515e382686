"""The emergency stop: asked for again and again, until the robot says that it has stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable

__all__ = ["ASKING_PERIOD", "EmergencyCall"]

ASKING_PERIOD = 0.05
"""Between two askings [s]."""
LEAST_ASKED = 4
"""So often at least: what says that it has stopped may have been under way since an earlier stop."""


class EmergencyCall:
    """Asks on a thread of its own: neither a slow picture nor a browser that is gone keeps it from asking.

    Args:
        ask: Sends one message; it should return at once.
    """

    def __init__(self, ask: Callable[[], None]) -> None:
        self._ask = ask
        self._asked = 0
        self._wanted = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="emergency stop", daemon=True)
        self._thread.start()

    @property
    def asking(self) -> bool:
        """Whether there is no answer yet."""
        return self._wanted.is_set()

    def press(self) -> None:
        """Ask from now on."""
        self._asked = 0
        self._wanted.set()

    def answered(self) -> None:
        """The robot has said that it has stopped, or that nobody here can stop it: ask no more."""
        if self._asked >= LEAST_ASKED:
            self._wanted.clear()

    def close(self) -> None:
        """Ask no more, ever."""
        self._closed.set()
        self._wanted.set()
        self._thread.join()

    def _run(self) -> None:
        while self._wanted.wait() and not self._closed.is_set():
            self._ask()
            self._asked += 1
            self._closed.wait(ASKING_PERIOD)

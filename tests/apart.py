"""Something of a test in a process of its own: some libraries wait with Python's lock held, so for no thread of it."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from typing import Any


def _serve(make: Callable[[], Any], asked: Any) -> None:
    """Do what is asked, until nobody asks any more."""
    with make() as made:
        asked.send(None)
        while True:
            try:
                what, name, value = asked.recv()
            except EOFError:
                return
            if what == "set":
                asked.send(setattr(made, name, value))
            elif what == "call":
                asked.send(getattr(made, name)(*value))
            else:
                found = getattr(made, name)
                asked.send(("method", None) if callable(found) else ("value", found))


class Apart:
    """What `make` makes, a context manager, in a process of its own; its attributes and methods are reached as here."""

    def __init__(self, make: Callable[[], Any]) -> None:
        context = multiprocessing.get_context("spawn")
        ask, asked = context.Pipe()
        process = context.Process(target=_serve, args=(make, asked), daemon=True)
        process.start()
        ask.recv()
        self.__dict__.update(_ask=ask, _process=process)

    def __enter__(self) -> Apart:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def kill(self) -> None:
        """End the process at once, as where a machine loses its power."""
        self._process.kill()
        self._process.join()

    def __getattr__(self, name: str) -> Any:
        kind, value = self._asked("get", name, None)
        return value if kind == "value" else lambda *given: self._asked("call", name, given)

    def __setattr__(self, name: str, value: object) -> None:
        self._asked("set", name, value)

    def _asked(self, what: str, name: str, value: object) -> Any:
        self._ask.send((what, name, value))
        return self._ask.recv()

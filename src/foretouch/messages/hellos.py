"""What the sides say of themselves in `Hello` messages, heard over a whole session."""

from __future__ import annotations

from collections.abc import Mapping

from foretouch.messages.schema import SPEAKERS, Hello

__all__ = ["COUNT_PREFIX", "NEWS", "PROCESS", "Hellos", "split_texts"]

COUNT_PREFIX = "count_"
"""Begins the names of counters among the texts of a `Hello`."""

PROCESS = "process"
"""Name of the text that tells the processes of a side apart: the epoch of each."""

NEWS = ("control", "contest", "trouble", "stopped")
"""Texts that change while a session runs: who holds control and who else would, what is not as it should be, and why it
was stopped."""

TELLERS = ("follower", "simulation")
"""Who says `NEWS`: what holds of the robot, its own side knows, and nobody else is believed."""

ROLES = (*SPEAKERS, "simulation")
"""Who says hello on a network or in a recording."""

MOST_PROCESSES, MOST_NEWS = 64, 64
"""So many processes of each role and so many different news are remembered: who says hello without end fills nothing,
and takes nobody's place."""


def split_texts(texts: Mapping[str, str]) -> tuple[dict[str, str], dict[str, int]]:
    """The settings and the counters among the texts of a `Hello`."""
    counts = {
        name.removeprefix(COUNT_PREFIX): int(value)
        for name, value in texts.items()
        if name.startswith(COUNT_PREFIX) and value.isascii() and value.isdigit() and len(value) < 20
    }
    others = (PROCESS, *NEWS)
    return {
        name: value for name, value in texts.items() if not name.startswith(COUNT_PREFIX) and name not in others
    }, counts


class Hellos:
    """All that was said of settings, counters and news.

    It holds what each role said last, and no more than a known number of anything: whoever says hello without end, or
    with other names each time, fills nothing.

    Attributes:
        news: By name of `NEWS`, what was said, in order, each text once.
    """

    def __init__(self) -> None:
        self._settings: dict[str, dict[str, str]] = {}
        self.news: dict[str, tuple[str, ...]] = {}
        self._counts: dict[str, dict[str, dict[str, int]]] = {role: {} for role in ROLES}

    def take(self, hello: Hello) -> None:
        """Hear one."""
        texts = hello.texts
        settings, counts = split_texts(texts)
        if hello.role not in ROLES:
            return
        self._settings.pop(hello.role, None)  # who spoke last stands last
        self._settings[hello.role] = settings
        processes, process = self._counts[hello.role], texts.get(PROCESS, "")
        if process in processes or len(processes) < MOST_PROCESSES:
            processes[process] = counts
        for name in NEWS if hello.role in TELLERS else ():
            said, known = texts.get(name), self.news.get(name, ())
            if said and said not in known and len(known) < MOST_NEWS:
                self.news[name] = (*known, said)

    @property
    def settings(self) -> dict[str, str]:
        """Settings by name, as said last."""
        return {name: value for said in self._settings.values() for name, value in said.items()}

    @property
    def counts(self) -> dict[str, int]:
        """Counters by name: each process of a side counts from 0, and they are summed."""
        total: dict[str, int] = {}
        for counts in (counts for processes in self._counts.values() for counts in processes.values()):
            for name, count in counts.items():
                total[name] = total.get(name, 0) + count
        return total

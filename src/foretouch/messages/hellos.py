"""The settings that each process of a session reported in `Hello` messages, and the time from which each held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from foretouch.messages.schema import SIDES, SPEAKERS, Hello


class SettingsReport(NamedTuple):
    """The settings that one process reported, from some time on.

    Attributes:
        role: Role of the process.
        process: Epoch of the process; 0 for one that reports none.
        since_ns: Time from which they hold, by that process's own clock [ns]; 0 for those it reported first.
        settings: Settings by name, as text.
    """

    role: str
    process: int
    since_ns: int
    settings: Mapping[str, str]


def settings_at(
    reports: Sequence[SettingsReport],
    epoch: int,
    run: int,
    leader_ns: int | None = None,
    follower_ns: int | None = None,
) -> dict[str, str]:
    """The settings with which one process of the leader and one of the follower worked at a moment.

    Each side is believed for itself, and the leader where both report a setting, as of the hand. The reports are in
    the order of arrival; epoch and run are those of the leader's and of the follower's process; the moment is by the
    clock of each [ns], None for the last report.
    """
    processes = {"leader": (epoch, leader_ns), "follower": (run, follower_ns)}
    others = [role for role in dict.fromkeys(one.role for one in reports) if role not in SIDES]
    settings: dict[str, str] = {}
    for role in (*others, "follower", "leader"):
        process, time_ns = processes.get(role, (0, None))
        spoken = [one for one in reports if one.role == role]
        own = [one for one in spoken if one.process == process] or spoken[-1:]  # a process without reports
        then = [one for one in own if time_ns is None or one.since_ns <= time_ns] or own[:1]
        if then:
            settings |= then[-1].settings
    return settings


COUNT_PREFIX = "count_"
"""Begins the names of counters among the texts of a `Hello`."""

PROCESS = "process"
"""Name of the text that tells the processes of a side apart: the epoch of each."""

LEAVES = "leaves"
"""Name of a text that a process says last which ends so that another of its role begins."""

SINCE = "settings_since_ns"
"""Name of the text that says since when a process has the settings that it says, by its own clock [ns]; one that has
changed none does not say it."""

NEWS = ("control", "contest", "trouble", "stopped")
"""Texts that change while a session runs: the holder of control and others that ask for it, faults, and the reason of a
stop."""

TELLERS = ("follower", "simulation")
"""Roles that send `NEWS`: the robot's own side knows its state, and no other role is believed."""

ROLES = (*SPEAKERS, "simulation")
"""Roles that send hellos on a network or in a recording."""

MOST_PROCESSES, MOST_NEWS = 64, 64
"""Processes remembered of each role, and different news: endless hellos take neither memory nor another's entry."""

MOST_CHANGES, MOST_TEXT = 256, 1_000_000
"""Changes of settings remembered of each role: a slider drawn to and fro for two minutes; and their characters in
total, twice what that takes."""


def split_texts(texts: Mapping[str, str]) -> tuple[dict[str, str], dict[str, int]]:
    """The settings and the counters among the texts of a `Hello`."""
    settings, counts = {}, {}
    for name, value in texts.items():
        if not name.startswith(COUNT_PREFIX):
            settings[name] = value
        elif _is_count(value):
            counts[name.removeprefix(COUNT_PREFIX)] = int(value)
    return {name: value for name, value in settings.items() if name not in (PROCESS, SINCE, LEAVES, *NEWS)}, counts


class Hellos:
    """All settings, counters and news that were reported.

    It holds the last report of each role, and a bounded number of everything: a process that sends hellos without end,
    or with other names each time, fills no memory.

    Attributes:
        news: News by name of `NEWS`, in order, each text once.
    """

    def __init__(self) -> None:
        self._settings: dict[str, dict[str, str]] = {}
        self._reports: dict[str, list[SettingsReport]] = {role: [] for role in ROLES}
        self.news: dict[str, tuple[str, ...]] = {}
        self._counts: dict[str, dict[str, dict[str, int]]] = {role: {} for role in ROLES}

    def take(self, hello: Hello) -> None:
        """Hear one."""
        texts = hello.texts
        settings, counts = split_texts(texts)
        if hello.role not in ROLES:
            return
        self._settings.pop(hello.role, None)  # the last sender comes last
        self._settings[hello.role] = settings
        self._remember(hello, settings)
        processes, process = self._counts[hello.role], texts.get(PROCESS, "")
        if process in processes or len(processes) < MOST_PROCESSES:
            processes[process] = counts
        for name in NEWS if hello.role in TELLERS else ():
            text, known = texts.get(name), self.news.get(name, ())
            if text and text not in known and len(known) < MOST_NEWS:
                self.news[name] = (*known, text)

    def _remember(self, hello: Hello, settings: dict[str, str]) -> None:
        """Remember from when on a side's process has its settings, and of any other role its last settings."""
        process, since = (int(text) if _is_count(text := hello.texts.get(name, "")) else 0 for name in (PROCESS, SINCE))
        reports = self._reports[hello.role]
        if hello.role not in SIDES:
            reports[:] = [SettingsReport(hello.role, process, 0, settings)]
            return
        before = next((one for one in reversed(reports) if one.process == process), None)
        if before is not None and before.settings == settings:
            return
        new = SettingsReport(hello.role, process, 0 if before is None else since or hello.time_ns, settings)
        while reports and (len(reports) >= MOST_CHANGES or _length((*reports, new)) > MOST_TEXT):
            reports.pop()
        reports.append(new)

    @property
    def reports(self) -> tuple[SettingsReport, ...]:
        """Settings that each process reported, and the times from which they hold."""
        return tuple(one for reports in self._reports.values() for one in reports)

    @property
    def settings(self) -> dict[str, str]:
        """Settings by name, as reported last."""
        return {name: value for settings in self._settings.values() for name, value in settings.items()}

    @property
    def counts(self) -> dict[str, int]:
        """Counters by name: each process of a side counts from 0, and they are summed."""
        total: dict[str, int] = {}
        for counts in (counts for processes in self._counts.values() for counts in processes.values()):
            for name, count in counts.items():
                total[name] = total.get(name, 0) + count
        return total


def _length(reports: Sequence[SettingsReport]) -> int:
    return sum(len(name) + len(value) for report in reports for name, value in report.settings.items())


def _is_count(text: str) -> bool:
    """Whether it is a whole number that fits a message."""
    return text.isascii() and text.isdigit() and len(text) < 20

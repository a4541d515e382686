"""Which settings held when: what each process of a session said of itself, and from when on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from foretouch.messages.schema import SIDES

__all__ = ["Said", "settings_at"]


class Said(NamedTuple):
    """What one process said of the settings of its session, from some time on.

    Attributes:
        role: Of who said it.
        process: Its epoch; 0 for one that says none.
        since_ns: From when on it holds, by that process's own clock [ns]; 0 for what it said first.
        settings: By name, as text.
    """

    role: str
    process: int
    since_ns: int
    settings: Mapping[str, str]


def settings_at(
    said: Sequence[Said], epoch: int, run: int, leader_ns: int | None = None, follower_ns: int | None = None
) -> dict[str, str]:
    """The settings with which one process of the leader and one of the follower worked at a moment.

    Each side is believed for itself, and the leader where both say something: what is the hand's is the leader's.

    Args:
        said: In the order in which it was heard.
        epoch: Of the leader's process.
        run: Of the follower's.
        leader_ns: The moment by the leader's clock [ns]; None for the last that was said.
        follower_ns: And by the follower's.
    """
    processes = {"leader": (epoch, leader_ns), "follower": (run, follower_ns)}
    others = [role for role in dict.fromkeys(one.role for one in said) if role not in SIDES]
    found: dict[str, str] = {}
    for role in (*others, "follower", "leader"):
        process, time_ns = processes.get(role, (0, None))
        spoken = [one for one in said if one.role == role]
        own = [one for one in spoken if one.process == process] or spoken[-1:]  # a process that was never heard
        then = [one for one in own if time_ns is None or one.since_ns <= time_ns] or own[:1]
        if then:
            found |= then[-1].settings
    return found

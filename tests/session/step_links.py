"""A loop in real time without network and clock: a link that says what a leader would, ticks that pass at once."""

from __future__ import annotations

import collections
import time
from collections.abc import Callable
from typing import Any

from foretouch.messages import VERSION, Command, Message, Telemetry

MS = 1_000_000


class Ticks:
    def __init__(self, period: float = 1e-3, begin_ns: int | None = None) -> None:
        self.woke_ns = time.monotonic_ns() if begin_ns is None else begin_ns
        self.count = 0

    def wait(self) -> tuple[int, int]:
        self.woke_ns += MS
        self.count += 1
        return self.woke_ns, 1 if self.count > 1 else 0


class Spoken:
    """A link on which a leader speaks that is where `place` says [m], or [m, m, m], at a time since the begin [s]."""

    undecodable = unsent = foreign = 0
    too_large = ""

    def __init__(self, place: Callable[[float], Any]) -> None:
        self.inboxes: dict[str, Any] = collections.defaultdict(collections.deque)
        self.place, self.number = place, 0
        self.now = time.monotonic_ns()
        self.begun = self.now
        self.said: list[Message] = []
        self.telemetry: list[Telemetry] = []

    def take(self, name: str) -> list[tuple[int, Any]]:
        if name != "command":
            return []
        self.now += MS
        self.number += 1
        place = self.place((self.now - self.begun) * 1e-9)
        along = place if isinstance(place, float) else 0.0
        command = Command(VERSION, self.number, self.now, along, 0, holder="anna", epoch=5)
        if along is not place:
            command = Command(VERSION, self.number, self.now, 0.0, 0, holder="anna", epoch=5, place=place)
        return [(self.now, command)]

    def publish(self, message: Message) -> None:
        if isinstance(message, Telemetry):
            self.telemetry.append(message)
        else:
            self.said.append(message)

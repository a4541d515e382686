"""Commands and telemetry of a moving hand, and both halves of a direction with a network between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from foretouch.messages import VERSION, Command, FollowerSpace, Message, Telemetry
from foretouch.session.thin.lines.kinds import UNSEEN, Commands, Seen
from foretouch.session.thin.lines.sides import CONTEXT, Hearing, Saying
from foretouch.session.thin.lines.stream import NOTHING

MS = 1_000_000
EPOCH, RUN = 3_000_000_000_000_000_001, 3_000_000_000_000_000_777


def place_at(tick: int) -> tuple[float, float, float]:
    """Where a slow hand is [m]."""
    phase = 2e-3 * math.pi * 0.4 * tick
    return 0.02 * math.sin(phase), 0.01 * math.cos(0.7 * phase), -0.01 + 0.005 * math.sin(1.3 * phase)


def command_at(tick: int, *, space: bool = False, time_ns: int | None = None, **changes: Any) -> Command:
    place = place_at(tick)
    fields: dict[str, Any] = {
        "position": place[2],
        "acknowledged_model": tick // 500,
        "guarded": tick % 700 < 300,
        "holder": "somebody@here",
        "epoch": EPOCH,
        "place": place if space else (),
        "telemetry_sequence": max(tick - 80, 0),
        "run": RUN,
    }
    return Command(VERSION, tick, tick * MS if time_ns is None else time_ns, **(fields | changes))


def telemetry_at(tick: int, *, space: bool = False, **changes: Any) -> Telemetry:
    place = place_at(tick)
    force = max(2.0 * math.sin(2e-3 * math.pi * 0.4 * tick), 0.0)
    fields: dict[str, Any] = {
        "command_sequence": max(tick - 90, 0),
        "desired_position": place[2],
        "position": place[2] - 1e-3,
        "velocity": 0.1,
        "sensor_force": force + 0.3,
        "force": force,
        "exact_force": math.nan,
        "in_contact": force > 0.1,
        "clipped": tick % 900 < 100,
        "model_sequence": tick // 20,
        "period_ns": MS,
        "compute_ns": 0,
        "guarded": tick % 700 < 300,
        "status": tick // 400 % 11,
        "validity": tick // 1100 % 3,
        "epoch": EPOCH,
        "run": RUN,
    }
    if space:
        deeper = tuple(one + 1e-3 for one in place)
        fields["space"] = FollowerSpace(*place, *deeper, force, 0.5 * force, -force, *UNSEEN)
    return Telemetry(VERSION, tick, tick * MS, **(fields | changes))


KINDS: dict[str, tuple[Any, Callable[..., Any]]] = {
    "commands": (Commands, command_at),
    "telemetry": (Seen, telemetry_at),
}


@dataclass
class Direction:
    """What says and what hears of a direction; `arrives` sees each record's tick and says when it comes, if ever."""

    kind: str
    arrives: Callable[[int], Iterable[int]] = lambda now: (now,)
    coming: list[tuple[int, bytes]] = field(default_factory=list)
    records: int = 0

    def __post_init__(self) -> None:
        made, self.message_at = KINDS[self.kind]
        self.saying, self.hearing = Saying(made()), Hearing(made())

    def say(self, message: Message, now: int, saying: Any = None) -> None:
        saying = saying or self.saying
        saying.note(message)
        if saying.urgency != NOTHING:
            self.records += 1
            record = saying.record()
            self.coming += [(due, record) for due in self.arrives(now)]

    def hear(self, now: int) -> Any:
        """The message of a tick."""
        due = sorted((one for one in self.coming if one[0] <= now), key=lambda one: one[0])
        self.coming = [one for one in self.coming if one[0] > now]
        for _, record in due:
            self.take(record)
        return self.hearing.next()

    def take(self, record: bytes) -> None:
        at = 0
        while 0 <= at < len(record):
            if record[at] == CONTEXT:
                end = at + 2 + record[at + 1]
                self.hearing.context(record[at + 2 : end])
                at = end
            else:
                at = self.hearing.lines(record, at)

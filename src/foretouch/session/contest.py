"""Noticing who else would command, and who speaks with the name of the one who does."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.messages import Command, Hello
from foretouch.session.lease import LEASE, ControlLease

__all__ = ["Contest", "ContestHeard"]

MANY = 20
"""Another leader is told of once so many of its commands have come within `WINDOW_NS`: one that was just killed may
have some under way."""

WINDOW_NS = 1_000_000_000
"""[ns]"""

TOLD_NS = 5_000_000_000
"""What was noticed is told until it has not been noticed for so long [ns]."""


class Contest:
    """Looks at commands as they arrive, before any fault is simulated, and says who contests control.

    Between machines a leader is known by its certificate, so that nobody else can speak with its name; on one machine,
    or where two hold the same key, somebody can. The commands of one process come over one connection in the order in
    which they were made, and each has the number after the last one's. So where a second speaks with its name and
    epoch, some number is not larger than the one that came before it, whatever numbers the second chooses: between
    those of the first none is free. One is enough, for one command far ahead silences the leader for seconds.

    It decides nothing: who is obeyed, `ControlLease` says. It is asked in every tick and keeps three names.

    Args:
        lease: Says who is obeyed.
    """

    __slots__ = (
        "_begun_ns", "_collides", "_contender", "_counted", "_epoch", "_former", "_holder", "_last", "_lease",
        "_since_ns"
    )  # fmt: skip

    def __init__(self, lease: ControlLease) -> None:
        self._lease = lease
        self._holder = self._former = self._contender = ""
        self._epoch = self._last = self._counted = 0
        self._collides = False
        self._begun_ns = self._since_ns = -2 * TOLD_NS

    def hear(self, command: Command, now_ns: int) -> None:
        """Take note of one command that has arrived.

        Args:
            command: As it came.
            now_ns: This side's monotonic clock [ns].
        """
        lease = self._lease
        if lease.epoch != self._epoch or lease.holder != self._holder:
            self._change(now_ns)
        if command.epoch == lease.epoch and command.holder == lease.holder:
            if command.sequence <= self._last:
                self._tell(command.holder, now_ns, collides=True)
            self._last = command.sequence
        elif lease.is_held(now_ns):
            if now_ns - self._begun_ns > WINDOW_NS:
                self._begun_ns, self._counted = now_ns, 0
            self._counted += 1
            if self._counted >= MANY:
                self._tell(command.holder, now_ns)

    def sentence(self, now_ns: int) -> str:
        """What people have to know of it; "" where nobody contests control.

        Args:
            now_ns: This side's monotonic clock [ns].
        """
        holder, contender = self._holder, self._contender or "somebody without a name"
        if now_ns - self._since_ns > TOLD_NS:
            return ""
        if self._former:
            return f"CONTROL TAKEN: {holder} has it, since {self._former} had been silent for {LEASE:g} s"
        if self._collides:
            return f"CONTROL CONTESTED: two command as {holder}, for the numbers of their commands collide: end both"
        other = "another process of that name" if contender == holder else contender
        return f"CONTROL CONTESTED: {other} would command too, and is not obeyed: {holder} holds control"

    def _change(self, now_ns: int) -> None:
        """Another holds control than before, or the same from another process."""
        lease = self._lease
        self._former = self._holder if self._holder != lease.holder else ""
        if self._former:
            self._since_ns = now_ns
        self._holder, self._epoch = lease.holder, lease.epoch
        self._last = self._counted = 0

    def _tell(self, contender: str, now_ns: int, *, collides: bool = False) -> None:
        self._contender, self._collides, self._former, self._since_ns = contender, collides, "", now_ns


class ContestHeard:
    """Says in the terminal of who only listens what the follower says of a contest, once each time that it changes.

    Args:
        role: Of who listens.
        say: Prints one line for people.
        parent: Process id of a parent, whose other children say it in the same terminal: then nothing is said here.
    """

    __slots__ = ("_role", "_say", "_told")

    def __init__(self, role: str, say: Callable[[str], None], parent: int | None = None) -> None:
        self._role, self._told = role, ""
        self._say = say if parent is None else None

    def hear(self, hello: Hello) -> None:
        """Take a `Hello` of anybody; only the follower's tells of a contest."""
        if hello.role != "follower":
            return
        contest = hello.texts.get("contest", "")
        if contest and contest != self._told and self._say is not None:
            self._say(f"{self._role}: {contest}")
        self._told = contest

"""Control lease: one leader commands at a time; contending leaders and duplicate names are detected."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable

from foretouch.errors import SettingError
from foretouch.messages import Command, Hello

LEASE = 1.0  # Silence after which a leader no longer holds control [s]

MOST_ENDED = 4096
"""Largest number of ended tenures remembered; then no new one is admitted, for a forgotten one could return."""

RANDOM_BITS = 21  # Number of random bits in an epoch; the rest is the time in milliseconds

_MS_NS = 1_000_000


def own_epoch() -> int:
    """Epoch of this process, from its wall clock and the operating system's randomness."""
    return make_epoch(time.time_ns(), secrets.randbits(RANDOM_BITS))


def make_epoch(wall_ns: int, random_bits: int) -> int:
    """Epoch of a process, made once when it starts: above 0, at most 2^63 - 1.

    Epochs of later starts are larger as long as the wall clock goes forward, which nothing relies on; two starts within
    a millisecond, on any machines, have the same with a probability of 1 in 2 million.

    Raises:
        SettingError: A wall clock [ns] that is negative, or random bits not below 2^21.
    """
    if not 0 <= random_bits < 1 << RANDOM_BITS:
        raise SettingError("random_bits", random_bits, f"must lie between 0 and {(1 << RANDOM_BITS) - 1}")
    epoch = wall_ns // _MS_NS << RANDOM_BITS | random_bits
    if not 0 < epoch < 1 << 63:
        raise SettingError("wall_ns", wall_ns, "must be above 0 and before the year 2109")
    return epoch


class ControlLease:
    """Lets one leader command, and names it to the others.

    A tenure is a holder's name with its epoch. It begins with the first command that is admitted and lasts as long as
    commands come; after `lease` of silence control is free, and the next leader to send a command gets it, be it the
    last holder or a new start of it. A tenure that another has followed is over for good: its commands are never
    admitted again, however late they come.

    Time is the receiver's own monotonic clock; a call with an earlier time than before counts as no later.

    Args:
        lease: Silence after which control is free [s], above 0.

    Attributes:
        holder: Name of the last holder of control, "" before the first.
        epoch: Epoch of that tenure, 0 before the first.
        refused: Number of commands that were not admitted.

    Raises:
        SettingError: The lease is not a positive number.
    """

    __slots__ = ("_ended", "_heard_ns", "_lease_ns", "epoch", "holder", "refused")

    def __init__(self, lease: float = LEASE) -> None:
        if not 0.0 < lease <= 3600.0:
            raise SettingError("lease", lease, "must be above 0 and at most 3600 s")
        self._lease_ns = round(lease * 1e9)
        self._heard_ns = 0
        self._ended: set[tuple[str, int]] = set()
        self.holder = ""
        self.epoch = 0
        self.refused = 0

    def admit(self, holder: str, epoch: int, now_ns: int) -> bool:
        """Whether a command of this holder and epoch may be obeyed now [ns]; if so, it has control from now on."""
        if epoch != self.epoch or holder != self.holder or not holder:
            if not self._may_follow(holder, epoch, now_ns):
                self.refused += 1
                return False
            if self.holder:
                self._ended.add((self.holder, self.epoch))
            self.holder, self.epoch = holder, epoch
        if now_ns > self._heard_ns:
            self._heard_ns = now_ns
        return True

    def is_held(self, now_ns: int) -> bool:
        """Whether any leader holds control now, by the receiver's monotonic clock [ns]."""
        return bool(self.holder) and now_ns - self._heard_ns < self._lease_ns

    def refusal(self, holder: str, epoch: int, now_ns: int) -> str:
        """One sentence for a leader that is not admitted: the holder of control, or why it gets none; "" if it is."""
        if self._holds(holder, epoch) or self._may_follow(holder, epoch, now_ns):
            return ""
        if not (holder and epoch):
            return "a leader without a name or an epoch is given no control"
        if (holder, epoch) in self._ended:
            return f"{holder} lost control to {self.holder}: start it again to have it back"
        if self.is_held(now_ns):
            return f"{self.holder} holds control: {holder} may have it after {self._lease_ns / 1e9:g} s of silence"
        return f"{len(self._ended)} leaders have held control in turn: start the follower again"

    def _holds(self, holder: str, epoch: int) -> bool:
        return epoch == self.epoch and holder == self.holder != ""

    def _may_follow(self, holder: str, epoch: int, now_ns: int) -> bool:
        """Whether a new tenure may begin now."""
        if not holder or not epoch or (holder, epoch) in self._ended or len(self._ended) >= MOST_ENDED:
            return False
        return not self.is_held(now_ns)


MANY = 20
"""Number of another leader's commands within `WINDOW_NS` above which it is reported: some of a leader that was just
killed may still be under way."""

WINDOW_NS = 1_000_000_000  # Time over which these commands are counted [ns]
TOLD_NS = 5_000_000_000  # Time for which a contest is reported after it was last detected [ns]


class Contest:
    """Inspects commands as they arrive, before any simulated fault, and reports a contest for control.

    Between machines a leader is known by its certificate; on one machine, or with one key for two, another can use its
    name. The commands of one process come in order over one connection, each numbered one above the last: where a
    second process uses its name and epoch, some number is not larger than the one before, whatever the second chooses.
    One is enough to report, for one command far ahead silences the leader for seconds.

    It decides nothing, which `ControlLease` does, and keeps three names.
    """

    def __init__(self, lease: ControlLease) -> None:
        self._lease = lease
        self._holder = self._former = self._contender = ""
        self._epoch = self._last = self._counted = 0
        self._collides = False
        self._begun_ns = self._since_ns = -2 * TOLD_NS

    def hear(self, command: Command, now_ns: int) -> None:
        """Take note of one command that has arrived now [ns]."""
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
        """Sentence for people about the contest; "" where control is uncontested now [ns]."""
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
        """Start again: control is held by another leader than before, or by another process of the same."""
        lease = self._lease
        self._former = self._holder if self._holder != lease.holder else ""
        if self._former:
            self._since_ns = now_ns
        self._holder, self._epoch = lease.holder, lease.epoch
        self._last = self._counted = 0

    def _tell(self, contender: str, now_ns: int, *, collides: bool = False) -> None:
        self._contender, self._collides, self._former, self._since_ns = contender, collides, "", now_ns


class ContestPrinter:
    """Prints in a listener's terminal what the follower reports of a contest, once per change.

    Args:
        role: Role of the listener.
        say: Prints one line for people.
        parent: Process id of a parent, whose other children print it in the same terminal: then nothing is printed.
    """

    __slots__ = ("_printed", "_role", "_say")

    def __init__(self, role: str, say: Callable[[str], None], parent: int | None = None) -> None:
        self._role, self._printed = role, ""
        self._say = say if parent is None else None

    def take(self, hello: Hello) -> None:
        """Take a `Hello` of any role; only the follower's reports a contest."""
        if hello.role != "follower":
            return
        contest = hello.texts.get("contest", "")
        if contest and contest != self._printed and self._say is not None:
            self._say(f"{self._role}: {contest}")
        self._printed = contest

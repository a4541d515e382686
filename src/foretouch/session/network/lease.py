"""Control lease: one leader commands at a time; contending leaders and duplicate names are detected."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled, kernel
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


class Lease(Record):
    """State of a `ControlLease`; a holder is the number of its name."""

    lease_ns: int  # silence after which control is free [ns]
    heard_ns: int  # when the newest command that was admitted came [ns]
    number: int  # of the last holder, 0 before the first
    epoch: int
    refused: int  # commands that were not admitted
    ended: int  # tenures that another has followed
    numbers: Annotated[NDArray[Any], int, MOST_ENDED]  # theirs
    epochs: Annotated[NDArray[Any], int, MOST_ENDED]


@compiled
def is_held(lease: Lease, now_ns: int) -> bool:
    """See `ControlLease.is_held`."""
    return bool(lease.number != 0 and now_ns - lease.heard_ns < lease.lease_ns)


@compiled
def _has_ended(lease: Lease, holder: int, epoch: int) -> bool:
    """Whether a tenure is over for good."""
    over = False
    for place in range(lease.ended):
        over = over or (lease.numbers[place] == holder and lease.epochs[place] == epoch)
    return over


@compiled
def may_follow(lease: Lease, holder: int, epoch: int, now_ns: int) -> bool:
    """Whether a new tenure may begin now [ns]."""
    known = holder != 0 and epoch != 0 and lease.ended < MOST_ENDED
    return known and not is_held(lease, now_ns) and not _has_ended(lease, holder, epoch)


@kernel("b1(Lease, i8, i8, i8)")
def admit(lease: Lease, holder: int, epoch: int, now_ns: int) -> bool:
    """See `ControlLease.admit`."""
    if epoch != lease.epoch or holder != lease.number or holder == 0:
        if not may_follow(lease, holder, epoch, now_ns):
            lease.refused += 1
            return False
        if lease.number != 0:
            lease.numbers[lease.ended], lease.epochs[lease.ended] = lease.number, lease.epoch
            lease.ended += 1
        lease.number, lease.epoch = holder, epoch
    lease.heard_ns = max(lease.heard_ns, now_ns)
    return True


BASE, PRIME = 131, 2**55 - 55
"""Base and modulus of the number of a name: no product of them is beyond 63 bits."""


@compiled
def number_of_bytes(name: NDArray[np.uint8]) -> int:
    """Number by which a holder's name is compared; 0 for that of no letters."""
    number = 0
    for letter in name:
        number = int((number * BASE + np.int64(letter) + 1) % PRIME)
    return number


@lru_cache(maxsize=MOST_ENDED)
def number_of(name: str) -> int:
    """Number by which a holder's name is compared, of its letters in UTF-8."""
    return _number.entry(np.frombuffer(name.encode(errors="surrogatepass"), np.uint8))


_number = Kernel(number_of_bytes, "i8(u1[::1])")
_held, _follow = Kernel(is_held, "b1(Lease, i8)"), Kernel(may_follow, "b1(Lease, i8, i8, i8)")
_over = Kernel(_has_ended, "b1(Lease, i8, i8)")


class ControlLease(Held):
    """Lets one leader command, and names it to the others.

    A tenure is a holder's name with its epoch. It begins with the first command that is admitted and lasts as long as
    commands come; after `lease` of silence control is free, and the next leader to send a command gets it, be it the
    last holder or a new start of it. A tenure that another has followed is over for good: its commands are never
    admitted again, however late they come.

    Time is the receiver's own monotonic clock; a call with an earlier time than before counts as no later.

    Args:
        lease: Silence after which control is free [s], above 0.
        leases: Array of one `Lease` that this one takes, part of another record; None for one of its own.

    Attributes:
        holder: Name of the last holder of control, "" before the first.
        epoch: Epoch of that tenure, 0 before the first.
        refused: Number of commands that were not admitted.

    Raises:
        SettingError: The lease is not a positive number.
    """

    epoch: int
    refused: int
    lease_ns: int

    def __init__(self, lease: float = LEASE, *, leases: NDArray[np.void] | None = None) -> None:
        if not 0.0 < lease <= 3600.0:
            raise SettingError("lease", lease, "must be above 0 and at most 3600 s")
        super().__init__(Lease.new() if leases is None else leases)
        self.records[:] = Lease.new(lease_ns=round(lease * 1e9))
        self.holder, self._admit = "", admit.entry

    def admit(self, holder: str, epoch: int, now_ns: int) -> bool:
        """Whether a command of this holder and epoch may be obeyed now [ns]; if so, it has control from now on."""
        admitted = self._admit(self.records[0], number_of(holder), epoch, now_ns)
        if admitted:
            self.holder = holder
        return admitted

    def is_held(self, now_ns: int) -> bool:
        """Whether any leader holds control now, by the receiver's monotonic clock [ns]."""
        return _held.entry(self.records[0], now_ns)

    def refusal(self, holder: str, epoch: int, now_ns: int) -> str:
        """One sentence for a leader that is not admitted: the holder of control, or why it gets none; "" if it is."""
        record, number = self.records[0], number_of(holder)
        if (holder and epoch == self.epoch and holder == self.holder) or _follow.entry(record, number, epoch, now_ns):
            return ""
        if not (holder and epoch):
            return "a leader without a name or an epoch is given no control"
        if _over.entry(record, number, epoch):
            return f"{holder} lost control to {self.holder}: start it again to have it back"
        if self.is_held(now_ns):
            return f"{self.holder} holds control: {holder} may have it after {self.lease_ns / 1e9:g} s of silence"
        return f"{self.ended} leaders have held control in turn: start the follower again"


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

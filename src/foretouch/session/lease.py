"""Who may command: one leader at a time."""

from __future__ import annotations

import secrets
import time

from foretouch.errors import SettingError

__all__ = ["LEASE", "ControlLease", "make_epoch", "own_epoch"]

LEASE = 1.0
"""A leader that is silent for so long [s] holds control no longer."""

MOST_ENDED = 4096
"""Tenures that are remembered as ended. Beyond them nobody new is let in: to forget one could let it come back."""

RANDOM_BITS = 21
"""Of an epoch; the rest is the time in milliseconds."""

_MS_NS = 1_000_000


def own_epoch() -> int:
    """Epoch of this process, from its wall clock and the operating system's randomness."""
    return make_epoch(time.time_ns(), secrets.randbits(RANDOM_BITS))


def make_epoch(wall_ns: int, random_bits: int) -> int:
    """Epoch of a process, made once when it starts.

    Epochs of later starts are larger as long as the wall clock goes forward, which nothing relies on; two starts within
    a millisecond, on any machines, have the same with a probability of 1 in 2 million.

    Args:
        wall_ns: Wall clock [ns], not negative.
        random_bits: A random number below 2^21, from the operating system.

    Returns:
        At most 2^63 - 1, above 0.

    Raises:
        SettingError: A number out of range.
    """
    if not 0 <= random_bits < 1 << RANDOM_BITS:
        raise SettingError("random_bits", random_bits, f"must lie between 0 and {(1 << RANDOM_BITS) - 1}")
    epoch = wall_ns // _MS_NS << RANDOM_BITS | random_bits
    if not 0 < epoch < 1 << 63:
        raise SettingError("wall_ns", wall_ns, "must be above 0 and before the year 2109")
    return epoch


class ControlLease:
    """Lets one leader command, and tells the others who does.

    A tenure is a holder's name with its epoch. It begins with the first command that is let in and goes on as long as
    commands come; after `lease` of silence control is free, and whoever speaks first has it, the last holder like any
    other, and like its own next start. A tenure that somebody else has followed is over for good: its commands are let
    in never again, however late they come.

    Time is the receiver's own monotonic clock; a call with an earlier time than before counts as no later.

    Args:
        lease: Silence after which control is free [s], above 0.

    Attributes:
        holder: Who held control last, "" before the first.
        epoch: Of that tenure, 0 before the first.
        refused: Commands that were not let in.

    Raises:
        SettingError: A lease that is none.
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
        """Whether a command of this holder may be obeyed now; if so, it has control from now on.

        Args:
            holder: Name of the leader, not empty.
            epoch: Of its process, above 0.
            now_ns: Receiver's monotonic clock [ns].
        """
        if not self._holds(holder, epoch):
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
        """Whether somebody holds control.

        Args:
            now_ns: Receiver's monotonic clock [ns].
        """
        return bool(self.holder) and now_ns - self._heard_ns < self._lease_ns

    def refusal(self, holder: str, epoch: int, now_ns: int) -> str:
        """One sentence for a leader that is not let in: who holds control, or why it does not get it; "" if it is.

        Args:
            holder: Name of the leader.
            epoch: Of its process.
            now_ns: Receiver's monotonic clock [ns].
        """
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

"""Network faults of our own, seeded: `Faults` says what each does and its range, `FaultStage` applies them.

The stage holds the messages of one direction back, loses them and doubles them, one function a fault, in real and in
simulated time. Measured networks (`foretouch.link.networks`) come first.
"""

from __future__ import annotations

import dataclasses
import heapq
import math
import random
from collections import deque
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from foretouch.errors import SettingError
from foretouch.link.networks.named import network_trace
from foretouch.link.networks.trace import Way

LONGEST_DELAY = 10.0  # Delays beyond this [s] are refused: they are in other units
SPELL_SPACING = 10.0  # Length of the windows [s] in each of which one outage and one stall begin, at seeded moments

LONGEST_START = 86_400.0  # Latest moment of a network's trace at which a session begins [s]: traces are shorter

LONGEST_BURST = 10_000.0
"""Longest mean burst of losses [messages]: 10 s at 1 kHz. What lasts longer is an outage."""


@dataclass(frozen=True, slots=True)
class Faults:
    r"""Faults of one direction of the network.

    Losses come in bursts by the model of Gilbert (1960) and Elliott (1963), with a good state that loses nothing and a
    bad state that loses everything. Before each message the state changes from good to bad with probability
    :math:`p`, and from bad to good with probability :math:`r`. Bursts are then :math:`1/r` messages long on average,
    and :math:`p/(p + r)` of all messages are lost, so that

    .. math:: r = 1/\mathtt{burst}, \qquad p = \frac{\mathtt{loss}}{(1 - \mathtt{loss})\,\mathtt{burst}}.

    A probability cannot exceed 1, so `loss` is at most `burst / (1 + burst)`: at least one message arrives between two
    bursts. Independent losses are the case :math:`p + r = 1`, whose bursts are `1 / (1 - loss)` messages long; `burst`
    of exactly 1 means them too, at any loss. Longer bursts than theirs cluster, shorter ones spread out.

    Args:
        delay: One-way delay [s], 0 to 10.
        jitter: Largest change of the delay, to either side, uniformly distributed and drawn for each message [s];
            messages may overtake each other. The delay never falls below 0.
        loss: Mean fraction of messages lost, 0 to 1.
        outage: Length of an outage [s], 0 to 10; one begins at a random moment of every 10 s, and what is sent
            meanwhile is lost.
        burst: Mean length of a burst of losses [messages], 1 to 10,000; 1: each message is lost independently.
        reorder: Fraction of messages, 0 to 1, that are held back by further 5 to 50 ms, uniformly distributed, so that
            5 to 50 later ones of a stream at 1 kHz overtake them.
        duplicate: Fraction of messages, 0 to 1, that come twice, the copy 1 to 20 ms after the first, uniformly
            distributed.
        stall: Length of a stall [s], 0 to 10; one begins at a random moment of every 10 s. Nothing arrives in it: what
            would have is held, and released together at its end in the order in which it was sent. TCP and TLS lose
            packets so: nothing is lost, and all of it is late at once.
        network: A network by name, or a file of its delays (`foretouch.link.networks`), whose delays come first: in it
            nothing overtakes. All others are added to what comes of it.
        network_start: Where in it the first message is sent [s], 0 or more.
        seed: Seed of the random draws.

    Raises:
        SettingError: A value out of range, or more loss than bursts of this length can make.

    References:
        E. N. Gilbert, "Capacity of a burst-noise channel", Bell System Technical Journal 39(5), 1960, 1253-1265.
        E. O. Elliott, "Estimates of error rates for codes on burst-noise channels", Bell System Technical Journal
        42(5), 1963, 1977-1997.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    burst: float = 1.0
    reorder: float = 0.0
    duplicate: float = 0.0
    stall: float = 0.0
    network: str = ""
    network_start: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        lengths = dict.fromkeys(("delay", "jitter"), LONGEST_DELAY) | dict.fromkeys(("outage", "stall"), SPELL_SPACING)
        ranges = {name: (0.0, most, f"must lie between 0 and {most:g} s") for name, most in lengths.items()}
        ranges |= dict.fromkeys(("loss", "reorder", "duplicate"), (0.0, 1.0, "must lie between 0 and 1"))
        ranges["network_start"] = (0.0, LONGEST_START, f"must lie between 0 and {LONGEST_START:g} s")
        ranges["burst"] = (1.0, LONGEST_BURST, f"must lie between 1 and {LONGEST_BURST:g} messages")
        for name, (least, most, rule) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise SettingError(name, getattr(self, name), rule)
        most = self.most_loss
        if self.loss > most:
            # Rounded down, so that the value we name works.
            raise SettingError(
                "loss",
                self.loss,
                f"with burst = {self.burst:g} must not exceed burst / (1 + burst), because a message arrives between "
                f"two bursts: take at most {math.floor(most * 1000) / 1000:g}, or burst = 1 for independent losses",
            )

    @property
    def most_loss(self) -> float:
        """Largest fraction of losses that bursts of this length can make."""
        return 1.0 if self.burst == 1.0 else self.burst / (1.0 + self.burst)

    @property
    def loss_transitions(self) -> tuple[float, float]:
        """Probabilities of losing a message after one that arrived, `p`, and after one that was lost, `1 - r`."""
        if self.burst == 1.0 or self.loss == 0.0:
            return self.loss, self.loss
        return min(1.0, self.loss / ((1.0 - self.loss) * self.burst)), 1.0 - 1.0 / self.burst


T = TypeVar("T")

HELD_BACK, COPY_LATER = (0.005, 0.05), (0.001, 0.02)
"""Ranges of the time by which a message that others are to overtake is held back, and by which the copy of a message
comes later than the first [s], uniformly distributed."""
MOST_HELD = 2**18
"""Messages that wait, of one direction; more are dropped. With the longest delay, jitter and stall that there are, a
session's own are fewer than 100,000."""


class FaultStage(Generic[T]):
    """Takes messages as they are sent and gives them as they arrive.

    Two messages due at the same moment come out in the order in which they went in. Each fault has random draws of its
    own, made for every message whether they are needed or not, so that one setting does not shift another's.

    Args:
        faults: Faults to apply; `change` replaces them while it runs.

    Raises:
        InputError: The faults name a network that does not exist, or is not here, or a file that is no trace.

    Attributes:
        delay: One-way delay [s]; may be changed at any time, for messages that follow.
        dropped: Number of messages lost.
        duplicated: Number of messages that come, or came, a second time.
    """

    def __init__(self, faults: Faults) -> None:
        self.faults = faults
        self.delay = faults.delay
        self.dropped = 0
        self.duplicated = 0
        self._draw = random.Random(faults.seed).random
        self._reorder = _Extra("reorder", faults.reorder, HELD_BACK, faults.seed) if faults.reorder else None
        self._duplicate = _Extra("duplicate", faults.duplicate, COPY_LATER, faults.seed) if faults.duplicate else None
        self._way = Way(network_trace(faults.network), faults.network_start) if faults.network else None
        self._epoch_ns = 0  # from which outages and stalls count
        self._outage = self._spells("outage", faults.outage)
        self._stall = self._spells("stall", faults.stall)
        self._after_arrival, self._after_loss = faults.loss_transitions
        self._chance_of_loss = faults.loss
        # When each is due, its number, and it: those that come in the order in which they went in, and as a heap those
        # that come before one of these.
        self._waiting: deque[tuple[int, int, T]] = deque()
        self._overtaking: list[tuple[int, int, T]] = []
        self._count = 0
        self._begun = False

    def change(self, *, delay: float, jitter: float, loss: float, outage: float) -> None:
        """Other faults from the next message on; what waits is due when it was.

        The draws go on: the same changes before the same messages give the same arrivals. Where the delay becomes
        shorter, later messages overtake those that wait. A value out of the range of `Faults` counts as the nearest
        one within it, and so does more loss than bursts of the length at hand can make: nothing is raised.

        Args:
            delay: As in `Faults` [s].
            jitter: As in `Faults` [s].
            loss: Fraction of messages lost.
            outage: As in `Faults` [s].
        """
        most = {"delay": LONGEST_DELAY, "jitter": LONGEST_DELAY, "loss": self.faults.most_loss, "outage": SPELL_SPACING}
        asked: dict[str, Any] = {"delay": delay, "jitter": jitter, "loss": loss, "outage": outage}
        for name, value in asked.items():
            asked[name] = min(max(value, 0.0), most[name]) if math.isfinite(value) else 0.0
        faults = dataclasses.replace(self.faults, **asked)
        if faults.outage != self.faults.outage:
            self._outage = self._spells("outage", faults.outage)
        if faults.loss != self.faults.loss:
            self._after_arrival, self._after_loss = faults.loss_transitions
            self._chance_of_loss = faults.loss
        self.faults, self.delay = faults, faults.delay

    def _spells(self, name: str, length: float) -> _Spells | None:
        return _Spells(name, length, self.faults.seed, self._epoch_ns) if length else None

    def push(self, now_ns: int, message: T) -> None:
        """Take a message that was sent at `now_ns`, the receiver's clock."""
        draw = self._draw
        # Whether it is lost is one step of the chain, which starts in its long-term mean.
        lost = draw() < self._chance_of_loss
        self._chance_of_loss = self._after_loss if lost else self._after_arrival
        delay, copied = self.delay + self.faults.jitter * (-1.0 + 2.0 * draw()), 0.0
        if delay < 0.0:
            delay = 0.0
        if self._reorder is not None:
            delay += self._reorder.draw()
        if self._duplicate is not None:
            copied = self._duplicate.draw()
        if not (self._begun or lost):  # outages and stalls count their time from here
            self._begun, self._epoch_ns = True, now_ns
            for spells in filter(None, (self._outage, self._stall)):
                spells.epoch_ns = now_ns
        if lost or (self._outage is not None and self._outage.end_ns(now_ns) is not None):
            self.dropped += 1
            return
        if self._way is not None:
            if not self._way.takes(now_ns, type(message)):
                self.dropped += 1
                return
            now_ns = self._way.arrival_ns(now_ns)
        self._hold(now_ns + round(delay * 1e9), message)
        if copied:
            self.duplicated += 1
            self._hold(now_ns + round((delay + copied) * 1e9), message)

    def pop_due(self, now_ns: int) -> list[T]:
        """Messages that are due by `now_ns`, earliest first."""
        due: list[T] = []
        waiting, overtaking = self._waiting, self._overtaking
        while overtaking and overtaking[0][0] <= now_ns:
            while waiting and waiting[0] < overtaking[0]:
                due.append(waiting.popleft()[2])
            due.append(heapq.heappop(overtaking)[2])
        while waiting and waiting[0][0] <= now_ns:
            due.append(waiting.popleft()[2])
        return due

    def _hold(self, due_ns: int, message: T) -> None:
        waiting = self._waiting
        if len(waiting) + len(self._overtaking) >= MOST_HELD:
            self.dropped += 1
            return
        if self._stall is not None and (end_ns := self._stall.end_ns(due_ns)) is not None:
            due_ns = end_ns
        self._count += 1
        if waiting and due_ns < waiting[-1][0]:
            heapq.heappush(self._overtaking, (due_ns, self._count, message))
        else:
            waiting.append((due_ns, self._count, message))


class _Extra:
    """A further delay for a fraction of the messages.

    A generator of its own, asked twice for every message: whose turn it is depends on the seed and the message's
    number alone, and of two fractions the larger takes the messages of the smaller and more.
    """

    def __init__(self, name: str, fraction: float, bounds: tuple[float, float], seed: int) -> None:
        self._fraction = fraction
        self._least, self._range = bounds[0], bounds[1] - bounds[0]
        self._random = random.Random(f"{seed}/{name}").random

    def draw(self) -> float:
        """The next message's further delay [s], 0 if it is not among the delayed."""
        chance, part = self._random(), self._random()
        return self._least + self._range * part if chance < self._fraction else 0.0


class _Spells:
    """One spell of the same length at a seeded moment within every `SPELL_SPACING` seconds; they never overlap.

    A generator for each: when spells happen depends on the seed, not on how many messages were sent.
    """

    def __init__(self, name: str, length: float, seed: int, epoch_ns: int) -> None:
        self.epoch_ns = epoch_ns
        self._name = f"{seed}/{name}"
        self._length = length
        self._window = -1
        self._start = self._end = 0.0

    def end_ns(self, moment_ns: int) -> int | None:
        """End [ns] of the spell that goes on at `moment_ns`, None between spells."""
        elapsed = (moment_ns - self.epoch_ns) * 1e-9
        window = int(elapsed // SPELL_SPACING)
        if window != self._window:
            moment = random.Random(f"{self._name}/{window}").random()
            self._window = window
            self._start = window * SPELL_SPACING + moment * (SPELL_SPACING - self._length)
            self._end = self._start + self._length
        return self.epoch_ns + round(self._end * 1e9) if self._start <= elapsed < self._end else None

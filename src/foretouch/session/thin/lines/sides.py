"""What a side says of its ticks over a thin link, and what is heard of the other's: lines, and their bytes.

A record begins with its kind. What seldom changes, such as the leader's name and process, is the sender's context and
has a record of its own; what names another context is not understood. Ticks, times and numbers of messages are said by
their lowest bits, and are those nearest to what was heard before.
"""

from __future__ import annotations

import math
import struct
import zlib
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np

from foretouch.messages import Message
from foretouch.session.thin.lines import stream
from foretouch.session.thin.lines.kinds import ABSENT, TICK_NS, Context, Kind
from foretouch.session.thin.lines.stream import DUE, LONGEST_GAP, MISSING, MOST, NOTHING, SOON, WORTH

CONTEXT, LINES = 1, 2  # Kinds of a record
CONTEXT_PERIOD = 1000  # Ticks between two records of the same context
NEWS = 3  # Packets that carry a new context: some may be lost
TAKEN_OVER = 1000  # Ticks of silence after which another sender is heard, as long as a `foretouch.session` lease lasts
LARGEST = 1 << 62  # Largest tick, time and number of messages: what comes later is below a message's largest
QUARTER_NS = 250_000  # In which times are said [ns]

HEAD = struct.Struct("<BHHHHHBBH")
"""Kind, context, tick, time in quarters of a millisecond, two numbers of messages, flags, status and validity, and
which numbers have lines, a bit for each. Of these follow three bytes for the value and two for the slope, in steps."""
NUMBER = 5  # Bytes of a number

M = TypeVar("M", bound=Message)

_decode_context = msgspec.msgpack.Decoder(Context).decode


def unwrapped(low: int, bits: int, near: int) -> int:
    """The number with these lowest bits that is nearest to another, and not negative."""
    span = 1 << bits
    number = near + (low - near + span // 2) % span - span // 2
    return number if number >= 0 else number + span


class Saying(Generic[M]):
    """What a side says of its ticks.

    Args:
        kind: Of its messages.

    Attributes:
        urgency: Of saying a record of the newest tick: `NOTHING`, `WORTH`, `SOON` or `DUE`.
    """

    def __init__(self, kind: Kind[M]) -> None:
        self.urgency = NOTHING
        self._kind, self._words = kind, np.zeros(2 * MOST, np.int64)
        self._note, self._say = stream.note.entry, stream.say.entry
        self._fixed: tuple[bool, int, int, str] | None = None
        self._lines: Any = None
        self._padding: tuple[float, ...] = ()  # numbers that there are not, to `MOST`
        self._message: M | None = None
        self._now = self._told = (0, 0)  # what is said at once, and what of it the newest record said
        self._context = self._news = self._context_tick = self._tick = 0

    def note(self, message: M) -> None:
        """Note the message of a tick."""
        kind, tick = self._kind, message.sequence
        fixed = kind.fixed(message)
        if fixed != self._fixed:
            self._begin(fixed)
        self._message, state = message, kind.state(message)
        urgency = self._note(self._lines, tick, kind.told(message) + self._padding)
        if urgency == MISSING:
            state = state[0] | ABSENT, state[1]
            urgency = DUE if tick - self._tick >= LONGEST_GAP else NOTHING
        self._now = state
        if urgency < SOON:
            if self._is_context_due(tick):
                urgency = SOON
            elif state != self._told:
                urgency = WORTH
        self.urgency = urgency

    def _begin(self, fixed: tuple[bool, int, int, str]) -> None:
        """From now on this is the context; its lines are new ones where it has other numbers."""
        if self._fixed is None or fixed[0] != self._fixed[0]:
            numbers = self._kind.numbers[fixed[0]]
            self._lines = stream.said(numbers, self._kind.positions(fixed[0]))
            self._padding = (0.0,) * (MOST - len(numbers))
        self._fixed, self._news, self._context = fixed, NEWS, zlib.crc32(repr(fixed).encode()) & 0xFFFF

    def _is_context_due(self, tick: int) -> bool:
        return self._news > 0 or tick - self._context_tick >= CONTEXT_PERIOD

    def record(self, flags: int = 0, most: int = MOST, *, spare: bool = True, known: int = LARGEST) -> bytes:
        """The record of the newest tick, with these flags; before it that of its context, where it is due.

        Args:
            flags: Further ones.
            most: How many numbers are said at most; beside a context that has been said before it is one.
            spare: Whether there is room for a context that has been said before.
            known: Newest tick of the other side that a record has told; a later one is not acknowledged.
        """
        message, chosen, words = self._message, 0, b""
        assert message is not None
        context = b""
        if self._news or (spare and self._is_context_due(message.sequence)):
            most = most if self._news else 1
            context = self._context_record(message, known)
        self._told, self._tick, self.urgency = self._now, message.sequence, NOTHING
        state, status = self._now
        if not state & ABSENT:
            chosen = self._say(self._lines, self._words, most)
            pairs = self._words[: 2 * chosen.bit_count()].tolist()
            words = b"".join(
                value.to_bytes(3, "little", signed=True) + slope.to_bytes(2, "little", signed=True)
                for value, slope in zip(pairs[::2], pairs[1::2], strict=True)
            )
        numbers = message.sequence, message.time_ns // QUARTER_NS, *self._counts(message, known)
        head = HEAD.pack(LINES, self._context, *(number & 0xFFFF for number in numbers), flags | state, status, chosen)
        return context + head + words

    def _counts(self, message: M, known: int) -> tuple[int, int]:
        """Its numbers of messages; of telemetry that newest that said something, not one that goes on from it."""
        first, second = self._kind.counts(message)
        return first, min(second, known)

    def _context_record(self, message: M, known: int) -> bytes:
        assert self._fixed is not None
        self._news, self._context_tick = max(self._news - 1, 0), message.sequence
        space, epoch, run, holder = self._fixed
        counts = self._counts(message, known)
        context = Context(self._context, message.sequence, message.time_ns, counts, space, epoch, run, holder)
        data = msgspec.msgpack.encode(context)
        return bytes((CONTEXT, len(data))) + data


class Hearing(Generic[M]):
    """What is heard of the other side's ticks.

    Args:
        kind: Of its messages.

    Attributes:
        sender: Name of the certificate that sent the packet which is read; "" where there is none.
        flags: Of its newest record.
        counts: Numbers of messages that this said.
        tick: Its tick.
    """

    def __init__(self, kind: Kind[M]) -> None:
        self.sender, self.flags, self.counts = "", 0, (0, 0)
        self._kind, self._words = kind, np.zeros(2 * MOST, np.int64)
        self._take: Any
        self._go_on: Any
        self._take, self._go_on = stream.take.entry, stream.go_on.entry
        self._context: Context | None = None
        self._other: Context | None = None  # of a sender that is not heard yet
        self._lines: Any = None
        self._numbers: Any = None  # a view of those of the newest tick
        self.tick = self._time_ns = self._status = self._given = self._silent = self._waiting = 0

    def context(self, data: bytes) -> bool:
        """Take the record of a context, of which one that is none is left out; whether another sender is heard now."""
        try:
            context = _decode_context(data)
        except (msgspec.DecodeError, UnicodeDecodeError):
            return False
        if max(context.tick, context.time_ns, *context.counts) > LARGEST or not context.holder.isprintable():
            return False
        if self.sender not in ("", context.holder):  # control is a certificate's
            return False
        before, kind = self._context, self._kind
        if before is not None and kind.who(before) == kind.who(context):
            if context.tick >= before.tick:
                self._begin(context)
            return False
        # Another sender is heard once this one is silent: two of them may say lines at a time.
        self._other, self._waiting = context, 0
        return self._take_over()

    def _begin(self, context: Context) -> None:
        """From now on this is the context; its lines are new ones where there was none, or one of other numbers."""
        if self._context is None or self._context.space != context.space:
            numbers = self._kind.numbers[context.space]
            self._lines = stream.heard(numbers, self._kind.positions(context.space))
            self._numbers = self._lines["given"][0, : len(numbers)]
        self._context = context

    def _wait(self) -> None:
        """Let a tick pass for another sender that waits to be heard."""
        self._waiting += 1
        if self._waiting > CONTEXT_PERIOD + LONGEST_GAP:  # it is silent, too
            self._other = None
        self._take_over()

    def _take_over(self) -> bool:
        """Hear another sender, if the one before has been silent for long; whether it is so."""
        context = self._other
        if context is None or (self._context is not None and self._silent < TAKEN_OVER):
            return False
        self._context = self._other = None
        self._begin(context)
        self.tick, self._time_ns, self.counts = max(context.tick - 1, 0), context.time_ns, context.counts
        self.flags = self._silent = self._given = 0
        return True

    def lines(self, data: bytes, at: int) -> int:
        """Take a record of lines at a place; where it ends, or a negative number where it is none."""
        if at + HEAD.size > len(data):
            return -1
        _, number, tick, quarters, first, second, flags, status, chosen = HEAD.unpack_from(data, at)
        at += HEAD.size
        end: int = at + NUMBER * chosen.bit_count()
        if end > len(data):
            return -1
        context = self._context
        if context is None or self.sender not in ("", context.holder):
            return end
        if number != context.number or chosen >> len(self._kind.numbers[context.space]):
            return end
        before = max((self.tick, self._time_ns, self.counts), (context.tick, context.time_ns, context.counts))
        tick = unwrapped(tick, 16, before[0])
        if tick <= self.tick:
            return end
        places = range(at, end, NUMBER)
        for index, place in enumerate(places):
            self._words[2 * index] = int.from_bytes(data[place : place + 3], "little", signed=True)
            self._words[2 * index + 1] = int.from_bytes(data[place + 3 : place + 5], "little", signed=True)
        time_ns = before[1] + (tick - before[0]) * TICK_NS
        self._time_ns = unwrapped(quarters, 16, time_ns // QUARTER_NS) * QUARTER_NS
        self.counts = unwrapped(first, 16, before[2][0]), unwrapped(second, 16, before[2][1])
        self.tick, self._silent, self.flags, self._status = tick, 0, flags, status
        if not flags & ABSENT:
            self._take(self._lines, tick, chosen, self._words)
        return end

    def next(self) -> M | None:
        """The message of the next tick of the other side, None where there is none."""
        self._silent += 1
        if self._other is not None:
            self._wait()
        context = self._context
        if context is None or not self.tick:
            return None
        if self.flags & ABSENT:
            tick, told = max(self._given + 1, self.tick), [math.nan] * self._numbers.size
            if tick - self.tick > stream.REACH:
                return None
        else:
            tick = self._go_on(self._lines)
            if tick <= self._given:  # none, or as the numbers were missing these ticks were given
                return None
            told = self._numbers.tolist()
        self._given = tick
        time_ns = max(self._time_ns + (tick - self.tick) * TICK_NS, 0)
        return self._kind.made(context, tick, time_ns, self.counts, (self.flags, self._status), told)

"""What of commands and of telemetry crosses a thin link, and how the message is made again from it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar, Generic, TypeVar

import msgspec

from foretouch.messages import VERSION, Command, FollowerSpace, Message, Telemetry
from foretouch.messages.schema import Count, Name
from foretouch.session.thin.lines.stream import FORCE, PLACE, POSITION, Number

ABSENT, WANTS, GUARDED, CONTACT, CLIPPED = 1, 2, 4, 8, 16
"""Flags of a record: its numbers are missing; its sender needs a whole model; what is guarded; contact; a force that
was cut."""

TICK_NS = 1_000_000  # A tick [ns]

M = TypeVar("M", bound=Message)
Numbers = tuple[Number, ...]
Pair = tuple[int, int]
Told = list[float]


class Context(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, gc=False):
    """What seldom changes of a side's messages; and a tick, a time [ns] and numbers of messages to count from."""

    number: int
    tick: Count
    time_ns: Count
    counts: tuple[Count, Count]
    space: bool
    epoch: Count
    run: Count
    holder: Name = ""


class Kind(ABC, Generic[M]):
    """How messages of a kind are said."""

    numbers: ClassVar[tuple[Numbers, Numbers]]  # along a line, and in space
    robot: ClassVar[bool]  # whether these are positions that a robot goes to

    def positions(self, space: bool) -> int:
        """How many of the numbers are positions that a robot goes to."""
        return len(self.numbers[space]) if self.robot else 0

    @abstractmethod
    def fixed(self, message: M) -> tuple[bool, int, int, str]:
        """Whether it is in space, epoch, run and holder: its context."""

    @abstractmethod
    def who(self, context: Context) -> tuple[int, str]:
        """The process that sent a context, and its name."""

    @abstractmethod
    def told(self, message: M) -> tuple[float, ...]:
        """Its numbers that have lines."""

    @abstractmethod
    def counts(self, message: M) -> Pair:
        """The two numbers of messages that it says."""

    @abstractmethod
    def state(self, message: M) -> Pair:
        """Its flags, and status and validity as a byte: a change of one is said at once."""

    @abstractmethod
    def made(self, context: Context, tick: int, time_ns: int, counts: Pair, state: Pair, told: Told) -> M:
        """The message again; `counts` are as of `tick`."""


class Commands(Kind[Command]):
    """Commands: their position, and their place in space, are what a robot goes to."""

    numbers, robot = ((POSITION,), (POSITION,) * 4), True

    def fixed(self, message: Command) -> tuple[bool, int, int, str]:
        """See `Kind.fixed`."""
        return bool(message.place), message.epoch, message.run, message.holder

    def who(self, context: Context) -> tuple[int, str]:
        """See `Kind.who`."""
        return context.epoch, context.holder

    def told(self, message: Command) -> tuple[float, ...]:
        """See `Kind.told`."""
        return (message.position, *message.place)

    def counts(self, message: Command) -> Pair:
        """See `Kind.counts`."""
        return message.acknowledged_model, message.telemetry_sequence

    def state(self, message: Command) -> Pair:
        """See `Kind.state`; a model that is used now is told at once, too."""
        return GUARDED * message.guarded, message.acknowledged_model & 0xFF

    def made(self, context: Context, tick: int, time_ns: int, counts: Pair, state: Pair, told: Told) -> Command:
        """See `Kind.made`."""
        guarded, place = state[0] & GUARDED != 0, tuple(told[1:])
        who = context.holder, context.epoch, place, counts[1], context.run
        return Command(VERSION, tick, time_ns, told[0], counts[0], guarded, *who)


UNSEEN = (0.0, 0.0, 1.0, math.nan, math.nan, math.nan, math.nan, 0.0, 0.0, 0.0)
"""What is not said of space: normal, depth, and pose of the fixture."""


ALONG_A_LINE = 3  # Numbers of telemetry there


class Seen(Kind[Telemetry]):
    """Telemetry: commanded and true position and force; in space these places and that force, too.

    What only pictures show of space is not said: normal, fixture, touch and joints.
    """

    numbers, robot = ((PLACE, PLACE, FORCE), (PLACE, PLACE, FORCE, *(PLACE,) * 6, *(FORCE,) * 3)), False

    def fixed(self, message: Telemetry) -> tuple[bool, int, int, str]:
        """See `Kind.fixed`."""
        return message.space is not None, message.epoch, message.run, ""

    def who(self, context: Context) -> tuple[int, str]:
        """See `Kind.who`."""
        return context.run, ""

    def told(self, message: Telemetry) -> tuple[float, ...]:
        """See `Kind.told`."""
        numbers, s = (message.desired_position, message.position, message.force), message.space
        if s is None:
            return numbers
        places = s.desired_x, s.desired_y, s.desired_z, s.place_x, s.place_y, s.place_z
        return (*numbers, *places, s.force_x, s.force_y, s.force_z)

    def counts(self, message: Telemetry) -> Pair:
        """See `Kind.counts`."""
        return message.command_sequence, message.model_sequence

    def state(self, message: Telemetry) -> Pair:
        """See `Kind.state`."""
        flags = GUARDED * message.guarded | CONTACT * message.in_contact | CLIPPED * message.clipped
        return flags, (message.status & 15) << 4 | message.validity & 15

    def made(self, context: Context, tick: int, time_ns: int, counts: Pair, state: Pair, told: Told) -> Telemetry:
        """See `Kind.made`; the velocity is not said, and the force is that of the sensor, too."""
        flags, force, space = state[0], told[2], None
        if len(told) > ALONG_A_LINE:
            space = FollowerSpace(*told[6:9], *told[3:6], *told[9:12], *UNSEEN)  # type: ignore[arg-type, call-arg]
        moved = told[0], told[1], 0.0, force, force, math.nan
        contact = flags & CONTACT != 0, flags & CLIPPED != 0, counts[1], TICK_NS, 0, flags & GUARDED != 0
        who = state[1] >> 4, state[1] & 15, context.epoch, context.run, space
        return Telemetry(VERSION, tick, time_ns, counts[0], *moved, *contact, *who)

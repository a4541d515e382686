"""The two ends of a thin link: full messages go in at one and come out at the other, in between go few bytes.

An end stands between the steps of its side and the network. What it sends in a second is kept within a budget, the most
urgent first: an emergency stop at once; then the lines of commands or telemetry, in each
`foretouch.session.thin.lines.stream.LONGEST_GAP` ticks at least, which is also the sign of life; models; and what is
only looked at, such as images.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, Generic, TypeVar

from foretouch.errors import DecodeError, PeerVersionError, printable
from foretouch.link import SequenceCounter, network_trace
from foretouch.messages import (
    COUNT_PREFIX,
    VERSION,
    CameraImage,
    Command,
    EmergencyStop,
    FieldUpdate,
    FollowerPacket,
    Hello,
    LeaderPacket,
    Message,
    ModelUpdate,
    Stop,
    Telemetry,
    decode,
    encode,
)
from foretouch.session.network.erasure import MOST_PARITIES
from foretouch.session.network.pieces import PARITIES, PIECE, PIECE_HEAD, Inbox, Outbox
from foretouch.session.thin.lines.kinds import WANTS, Commands, Kind, Seen
from foretouch.session.thin.lines.sides import CONTEXT, HEAD, LARGEST, LINES, NUMBER, Hearing, Saying
from foretouch.session.thin.lines.stream import DUE, NOTHING, SOON, WORTH
from foretouch.session.thin.models.heard import ModelsHeard
from foretouch.session.thin.models.said import ModelsSaid

EMERGENCY = 5  # Kind of a record: an emergency stop
LONGEST_WORD, LARGEST_PRESS = 12, (1 << 63) - 1  # Bytes of its reason, and its number at most

ENVELOPE = 11  # Bytes of a packet around its content, at most
HELD_UP = 0.02  # Time that one packet may take, by the budget, so that a stop waits no longer for the one before it [s]
ENOUGH = 1000.0  # Bytes a second that are enough for models as they are said over the thinnest links
SHARE = 0.7  # Part of the budget that lines may take beyond what is due while models or others wait
NEVER_NS = 2**62  # Time since what never was [ns]
HELLO_NS, UNHEARD_NS = 10_000_000_000, 1_000_000_000
"""Time between two hellos of the same texts, and the silence after which they are said all the time [ns]: who is to
answer may wait for one."""

NAMES, URGENT = ("stop", "model", "field", "hello", "image"), 2
"""Of what goes in pieces, the most urgent first; and how many of them are: what is only looked at takes turns."""


USUAL = "parity"
PROTECTIONS: dict[str, Callable[[int], int]] = {
    "none": lambda pieces: 0,
    USUAL: lambda pieces: int(pieces > 1),
    "strong": lambda pieces: min(pieces // 2 + 1, MOST_PARITIES),
}
"""What an end sends against loss: how many parities so many pieces have. The other end understands all."""

Said = TypeVar("Said", bound=Message)
Heard = TypeVar("Heard", bound=Message)


class End(ABC, Generic[Said, Heard]):
    """One end of a thin link.

    Args:
        budget: Bytes a second that it may send.
        says: How its messages are said.
        hears: How the other end's are.
        spacing: Shortest time between two packets, where the network takes no more of them [s].
        protection: What it sends against loss, of `PROTECTIONS`.

    Attributes:
        deliver: Takes what is heard and is no message for the side's step.
        tell: Takes a copy of each message for the step, to tell others at this site; None where there are none.
        sent: Bytes sent.
        packets: Number of packets sent.
        arrived: Counts the packets that arrived.
    """

    tick: ClassVar[type[Message]]  # of which its side makes one a tick
    packet: ClassVar[type[Message]]
    from_other: ClassVar[str]  # channel of the other end's packets
    other: ClassVar[str]  # role of the other side
    takes: ClassVar[dict[str, type[Message]]] = {"stop": Stop, "hello": Hello}  # what comes in pieces, by name

    def __init__(self, budget: float, says: Kind[Said], hears: Kind[Heard], spacing: float, protection: str) -> None:
        self.deliver: Callable[[Message], None] = _nobody
        self.tell: Callable[[Message], None] | None = None
        self.sent = self.packets = 0
        self.arrived = SequenceCounter()
        self._saying, self._hearing = Saying(says), Hearing(hears)
        self._rate = budget * 1e-9
        self._longest = max(round(budget * max(HELD_UP, spacing)), 36)
        self._spacing_ns, self._packet_ns = round(spacing * 1e9), -NEVER_NS
        self._outbox = Outbox(NAMES, self._longest, PROTECTIONS[protection], URGENT)
        self._inbox = Inbox(NAMES)
        self._allowance = self._for_lines = 0.0
        self._most_lines, self._now_ns = SHARE * self._longest, NEVER_NS
        self._emergency: EmergencyStop | None = None
        self._beside: dict[type[Message], Callable[[Any], None]] = {
            EmergencyStop: self._offer_emergency,
            Hello: self._offer_hello,
            Stop: self._offer_stop,
        }
        self._of_step = self._beside | {self.tick: self._saying.note}
        self._texts: dict[str, str] = {}
        self._hello_ns, self._heard_ns = -HELLO_NS, -NEVER_NS

    def offer(self, message: Message) -> None:
        """Take a message that this side says beside its step; what does not cross is left out."""
        offer = self._beside.get(type(message))
        if offer is not None:
            offer(message)

    def _offer_emergency(self, emergency: EmergencyStop) -> None:
        self._emergency = emergency

    def _offer_stop(self, stop: Stop) -> None:
        self._outbox.put("stop", encode(stop))

    def _offer_hello(self, hello: Hello) -> None:
        """A hello that says something new, the first for long, or any while the other end is silent."""
        texts = {name: text for name, text in hello.texts.items() if not name.startswith(COUNT_PREFIX)}
        every = HELLO_NS if hello.time_ns - self._heard_ns <= UNHEARD_NS else 0
        if texts != self._texts or hello.time_ns - self._hello_ns >= every:
            self._texts, self._hello_ns = texts, hello.time_ns
            self._outbox.put("hello", encode(Hello.of(hello.role, hello.sequence, hello.time_ns, texts)))

    def show(self, image: bytes) -> None:
        """Send an image with what nothing else needs, the bytes of a `CameraImage`, unless a newer one comes before."""
        self._outbox.put("image", image)

    def counts(self) -> dict[str, int]:
        """What this end sent, by name."""
        return {"thin_packets": self.packets, "thin_bytes": self.sent}

    def said(self, messages: Iterable[Message], now_ns: int) -> list[Message]:
        """The messages of this tick with the packet behind them that is sent in it, if there is one."""
        if now_ns > self._now_ns:
            self._gain((now_ns - self._now_ns) * self._rate)
        self._now_ns, messages = now_ns, list(messages)
        for message in messages:
            offer = self._of_step.get(type(message))
            if offer is not None:
                offer(message)
        content = self._content() if now_ns - self._packet_ns >= self._spacing_ns else b""
        if content:
            self._packet_ns = now_ns
            self.packets += 1
            packet = self.packet(VERSION, self.packets, 0, content)  # type: ignore[call-arg]
            self.sent += len(content) + ENVELOPE
            self._allowance -= len(content) + ENVELOPE
            messages.append(packet)
        return messages

    def _gain(self, more: float) -> None:
        """Allow so many bytes more; what is not sent now may be sent later, as far as a packet.

        More would queue up before a stop.
        """
        allowance, for_lines = self._allowance + more, self._for_lines + SHARE * more
        self._allowance = allowance if allowance < self._longest else float(self._longest)
        self._for_lines = for_lines if for_lines < self._most_lines else self._most_lines

    @property
    def models_broken(self) -> int:
        """Models of which some came, but too little."""
        return self._inbox.broken["model"]

    @property
    def models_came(self) -> tuple[int, int]:
        """Number of models that came whole, and of those before the newest that did not."""
        box = self._inbox
        return box.whole["model"], box.broken["model"] + box.missed["model"]

    @property
    def _flags(self) -> int:
        return 0

    @property
    def _known(self) -> int:
        """Newest tick of the other side that a record has told; later ones were gone on to from it."""
        return LARGEST

    def _content(self) -> bytes:
        """What is sent now; nothing where nothing is worth it, or allowed."""
        if (emergency := self._emergency) is not None:
            self._emergency = None
            reason = emergency.reason.encode()[:LONGEST_WORD]
            return bytes((EMERGENCY, len(reason))) + emergency.press.to_bytes(8, "little") + reason
        urgency, content, allowed = self._saying.urgency, b"", self._allowance >= 0.0
        alone = self._outbox.is_empty  # then lines may take all
        if alone and urgency == NOTHING:
            return b""
        least = WORTH if alone or self._for_lines >= 0.0 else SOON
        if urgency == DUE or (allowed and urgency >= least):
            most = (self._longest - HEAD.size) // NUMBER if allowed else 1
            content = self._saying.record(self._flags, most, spare=allowed, known=self._known)
            self._for_lines -= 0.0 if alone else len(content) + ENVELOPE
        room = self._longest - len(content)
        return content + self._outbox.next(room) if allowed and room > PIECE_HEAD else content

    def heard(self, packets: Iterable[Message], now_ns: int) -> list[Message]:
        """The messages for this side's step in a tick in which these packets have come."""
        due: list[Message] = []
        for packet in packets:
            if packet.sequence == 1:  # of another process, which counts from there
                self.arrived.restart()
                self._inbox.restart()
            if now_ns - self._heard_ns > UNHEARD_NS:  # it may not have heard the hellos that were said before
                self._hello_ns = -HELLO_NS
            self._heard_ns = now_ns
            self.arrived.is_newest(packet.sequence)
            self._hearing.sender = getattr(packet, "sender", "")
            self._take(packet.content, due, now_ns)  # type: ignore[attr-defined]
        message = self._hearing.next()
        if message is not None:
            due.append(message)
        if self.tell is not None:
            for heard in due:
                self.tell(heard)
        return due

    def _take(self, data: bytes, due: list[Message], now_ns: int) -> None:
        """Take the records of a packet, up to the first that is none."""
        at = 0
        while 0 <= at < len(data):
            kind = data[at]
            if kind == LINES:
                at = self._hearing.lines(data, at)
            elif kind == CONTEXT and at + 2 <= len(data):
                end = at + 2 + data[at + 1]
                if self._hearing.context(data[at + 2 : end]):
                    self._inbox.restart()
                at = end
            elif kind == PIECE or kind in PARITIES:
                at, name, whole = self._inbox.take(data, at)
                if whole:
                    self._take_whole(name, whole, due)
            elif kind == EMERGENCY and self.other == "leader" and at + 10 <= len(data):
                end = at + 10 + data[at + 1]
                press, reason = int.from_bytes(data[at + 2 : at + 10], "little"), data[at + 10 : end]
                said = printable(reason.decode(errors="replace"))[:LONGEST_WORD]
                self._pass_on(EmergencyStop(VERSION, 1, now_ns, said, press & LARGEST_PRESS), due)
                at = end
            else:
                return

    def _take_whole(self, name: str, data: bytes, due: list[Message]) -> None:
        try:
            message = decode(data, self.takes[name])
        except (DecodeError, PeerVersionError, KeyError):
            return
        if not isinstance(message, Hello) or message.role == self.other:
            self._pass_on(message, due)

    def _pass_on(self, message: Message, due: list[Message]) -> None:
        if isinstance(message, FieldUpdate):
            due.append(message)
        else:
            self.deliver(message)


def _nobody(message: Message) -> None:
    """Drop a message: no link has been joined yet that would take it."""


class LeaderEnd(End[Command, Telemetry]):
    """The end at the leader, of so many bytes a second."""

    tick, packet, from_other, other = Command, LeaderPacket, "back", "follower"
    takes: ClassVar[dict[str, type[Message]]] = End.takes | {"field": FieldUpdate, "image": CameraImage}

    def __init__(self, budget: float, spacing: float = 0.0, protection: str = USUAL) -> None:
        super().__init__(budget, Commands(), Seen(), spacing, protection)
        self._models = ModelsHeard()

    @property
    def _known(self) -> int:
        return self._hearing.tick

    @property
    def _flags(self) -> int:
        return WANTS if self._models.wants_whole else 0

    def _take_whole(self, name: str, data: bytes, due: list[Message]) -> None:
        if name != "model":
            super()._take_whole(name, data, due)
        elif (model := self._models.take(data)) is not None:
            due.append(model)


class FollowerEnd(End[Telemetry, Command]):
    """The end at the follower, of so many bytes a second."""

    tick, packet, from_other, other = Telemetry, FollowerPacket, "forth", "leader"

    def __init__(self, budget: float, spacing: float = 0.0, protection: str = USUAL) -> None:
        super().__init__(budget, Seen(), Commands(), spacing, protection)
        self._models = ModelsSaid(plenty=budget / ENOUGH)
        self._of_step |= {ModelUpdate: self._offer_model, FieldUpdate: self._offer_field}

    def _offer_model(self, update: ModelUpdate) -> None:
        if self._hearing.flags & WANTS:
            self._models.ask_whole()
        data = self._models.offer(update, self._hearing.counts[0], self._now_ns)
        if data is not None:
            self._outbox.put("model", data)

    def _offer_field(self, field: FieldUpdate) -> None:
        self._outbox.put("field", encode(field))


ENDS: dict[str, Any] = {"leader": LeaderEnd, "follower": FollowerEnd}


def end_of(side: str, settings: Any) -> LeaderEnd | FollowerEnd | None:
    """The end of a side, "leader" or "follower", by the settings of the session; None without a budget."""
    if not settings.budget:
        return None
    spacing = network_trace(settings.network).spacing if settings.network else 0.0
    made: LeaderEnd | FollowerEnd = ENDS[side](settings.budget, spacing, settings.protection)
    return made

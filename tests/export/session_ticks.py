"""What may come to a leader and a follower: random ticks, and what Python makes of them; the same as `session_ticks.c`.

As a program it reads what the program of C reads, and writes what that writes with "shown", so that it can run with
nothing compiled.
"""

from __future__ import annotations

import struct
import subprocess
import sys
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray
from session_log import Log

from foretouch.errors import ForetouchError
from foretouch.export.beginnings import OWN, beginnings
from foretouch.messages import Command, Message, ModelUpdate, Telemetry, decode, encode
from foretouch.models.law_kernel import LAW_NAMES
from foretouch.session import SessionSettings
from foretouch.session.steps import following, leading

M = TypeVar("M", bound=Message)
EPOCH, ASSUMED = 1, 1000  # Number of the leader's process; bytes that a model is taken to have
TICK, SAMPLE = struct.Struct("<qdqBB"), struct.Struct("<6dBdqqqBBB")
SENT: int = (following.Published.layout.fields or {})["sent"][1]


class Player:
    """Both sides of a session, without the steps of Python."""

    def __init__(self) -> None:
        self.begun = {one.name: one.record for one in beginnings(SessionSettings())}
        self.leader = leading.Leader.new()
        self.follower = following.Following.new()
        self.shown: list[bytes] = []
        self.felt, self.statuses = 0.0, set[int]()

    def play(self, taken: bytes) -> bytes:
        """What the program writes for this."""
        at = 0
        while at < len(taken):
            letter, at = taken[at : at + 1], at + 1
            at += getattr(self, f"_take_{letter.decode()}")(taken, at)
        return b"".join(self.shown)

    def _take_L(self, taken: bytes, at: int) -> int:
        self.leader = np.frombuffer(taken, leading.Leader.layout, 1, at).copy()
        return self.leader.nbytes

    def _take_F(self, taken: bytes, at: int) -> int:
        self.follower = np.frombuffer(taken, following.Following.layout, 1, at).copy()
        return self.follower.nbytes

    def _take_l(self, _: bytes, __: int) -> int:
        self.leader = clean(self.begun["leader_init"])
        self.leader["views"]["epoch"] = EPOCH
        return 0

    def _take_f(self, _: bytes, __: int) -> int:
        self.follower = clean(self.begun["follower_init"])
        self.follower["hearings"]["run"] = OWN
        return 0

    def _take_h(self, taken: bytes, at: int) -> int:
        m, size = message(taken, at, Telemetry)
        if m is not None:
            place = m.position, m.desired_position, m.force, m.in_contact
            leading.hear.entry(self.leader[0], m.run, m.sequence, m.epoch, int(m.status), *place)
        return size

    def _take_a(self, taken: bytes, at: int) -> int:
        m, size = message(taken, at, ModelUpdate)
        if m is None:
            return size
        received = self.leader["received"][0]
        for name in ("run", "sequence", "epoch", "command_sequence", "surface", "valid"):
            received[name] = getattr(m, name)
        received["law"] = LAW_NAMES.index(m.law) if m.law in LAW_NAMES else -1
        for name, values in (("parameters", m.parameters), ("state", m.state)):
            received[name][: len(values)] = values[: received[name].size]
            received[f"{name.rstrip('s')}_count"] = len(values)
        if len(m.map) <= received["map"].nbytes:
            received["map"].view(np.uint8)[: len(m.map)] = np.frombuffer(m.map, np.uint8)
        received["map_count"] = -1 if len(m.map) % 4 else len(m.map) // 4
        leading.adopt.entry(self.leader[0])
        return size

    def _take_t(self, taken: bytes, at: int) -> int:
        now_ns, hand, period_ns, clutched, stopping = TICK.unpack_from(taken, at)
        leading.tick.entry(self.leader[0], now_ns, hand, period_ns, bool(clutched), bool(stopping))
        self.shown.append(clean(self.leader["shown"]).tobytes())
        self.felt = max(self.felt, self.leader["shown"]["rendered_force"].item())
        return TICK.size

    def _take_c(self, taken: bytes, at: int) -> int:
        (now_ns,) = struct.unpack_from("<q", taken, at)
        m, size = message(taken, at + 8, Command)
        if m is not None:
            received, name = self.follower["received"][0], m.holder.encode()
            for field in received.dtype.names[2:]:
                received[field] = getattr(m, field)
            received["holder"][: len(name)], received["holder_size"] = np.frombuffer(name, np.uint8), len(name)
            following.take.entry(self.follower[0], now_ns)
        return 8 + size

    def _take_s(self, taken: bytes, at: int) -> int:
        *sample, now_ns, period_ns, _, stop, release, ended = SAMPLE.unpack_from(taken, at)
        sample[6] = bool(sample[6])
        record, flags = self.follower[0], (bool(stop), bool(release), bool(ended))
        following.tick.entry(record, tuple(sample), now_ns, period_ns, *flags)
        self.shown.append(clean(self.follower["shown"]).tobytes())
        self.statuses.add(self.follower["shown"]["status"].item())
        if following.publish.entry(record, now_ns):
            self.shown.append(clean(self.follower["published"]).tobytes()[:SENT])
            following.published.entry(record, ASSUMED)
        return SAMPLE.size


def clean(record: NDArray[np.void]) -> NDArray[np.void]:
    """A copy of a record that has zeros between its fields, as in C."""
    copied = np.zeros(1, record.dtype)
    copied[:] = record
    return copied


def message(taken: bytes, at: int, kind: type[M]) -> tuple[M | None, int]:
    """The message at a place, None where it is none, and its size there."""
    (size,) = struct.unpack_from("<I", taken, at)
    try:
        return decode(taken[at + 4 : at + 4 + size], kind), 4 + size
    except ForetouchError:
        return None, 4 + size


KINDS: dict[str, type[Message]] = {"h": Telemetry, "a": ModelUpdate, "c": Command}
NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-9, 1e9, -1e9, 1e300, float("inf"), -float("inf"), float("nan"))
COUNTS = (0, 1, 2, 11, 1000, 2**31, 2**53 + 1, 2**63 - 1)
WORDS = ("", "anna", "bert", "contact-map", "kelvin-voigt", "hunt-crossley", "no-law")


def random_ticks(log: Log, count: int, seed: int) -> bytes:
    """What came in a session, again and again until there are so many ticks, and anything else among it."""
    random = np.random.default_rng(seed)
    pieces = [piece for piece in _pieces(bytes(log.taken)) if piece[0] not in "LF"]
    taken, ticks, kept = [], 0, [b"\x90"]
    while ticks < count:
        taken.append(b"lf")
        clutched = stopping = stop = release = False
        for letter, content in pieces:
            if letter == "t":
                clutched ^= random.random() < (0.05 if clutched else 0.001)
                stopping ^= random.random() < (0.05 if stopping else 0.0005)
                content = _moved(random, content, clutched, stopping)
            elif letter == "s":
                stop, release = random.random() < 2e-4, random.random() < 1e-3
                content = _felt(random, content, stop, release)
            else:
                content = _said(random, letter, content, kept)
            ticks += letter in "ts"
            if content:
                taken.append(letter.encode() + content)
            if ticks >= count:
                break
    return b"".join(taken)


def _pieces(taken: bytes) -> list[tuple[str, bytes]]:
    """What came, one by one: its letter, and what is behind it."""
    records = {"L": leading.Leader.layout.itemsize, "F": following.Following.layout.itemsize}
    sizes, result, at = records | {"t": TICK.size, "s": SAMPLE.size}, [], 0
    while at < len(taken):
        letter = chr(taken[at])
        before = 8 if letter == "c" else 0
        size = sizes.get(letter, 0) or before + 4 + struct.unpack_from("<I", taken, at + 1 + before)[0]
        result.append((letter, taken[at + 1 : at + 1 + size]))
        at += 1 + size
    return result


def _moved(random: np.random.Generator, content: bytes, clutched: bool, stopping: bool) -> bytes:
    now_ns, hand, period_ns, *_ = TICK.unpack(content)
    if random.random() < 0.002:
        hand = random.choice(NUMBERS)
    if random.random() < 0.002:
        hand += random.normal(0.0, 0.01)
    if random.random() < 0.002:
        now_ns, period_ns = now_ns - int(random.integers(0, 3_000_000)), int(random.integers(0, 2**40))
    return TICK.pack(now_ns, hand, period_ns, clutched, stopping)


def _felt(random: np.random.Generator, content: bytes, stop: bool, release: bool) -> bytes:
    sample = list(SAMPLE.unpack(content))
    if random.random() < 0.002:
        sample[random.choice([0, 1, 2, 5, 7])] = random.choice(NUMBERS)
    if random.random() < 0.002:
        sample[0] += random.normal(0.0, 1e-3)
    if random.random() < 0.002:
        sample[1] += random.normal(0.0, 5.0)
    if random.random() < 0.002:
        sample[8], sample[9] = sample[8] - int(random.integers(0, 3_000_000)), int(random.integers(0, 2**40))
    sample[11], sample[12] = stop, release
    return SAMPLE.pack(*sample)


def _said(random: np.random.Generator, letter: str, content: bytes, kept: list[bytes]) -> bytes:
    """A message as it may come: lost, late and once more, of other bytes, or with another field."""
    before = 8 if letter == "c" else 0
    head, said, chance = content[:before], content[before + 4 :], random.random()
    if chance < 0.02:
        return b""
    if chance < 0.03:
        said = kept[random.integers(len(kept))]
    elif chance < 0.04:
        place = int(random.integers(len(said)))
        said = said[:place] + bytes([int(random.integers(256))]) + said[place + int(random.integers(2)) :]
    elif chance < 0.06:
        said = encode(_changed(random, decode(said, KINDS[letter])))
    if len(kept) < 1000:
        kept.append(said)
    return head + struct.pack("<I", len(said)) + said


def _changed(random: np.random.Generator, m: Message) -> Message:
    """A message with another value of one field."""
    name = str(random.choice([field for field in m.__struct_fields__ if field not in ("version", "space", "map")]))
    value = getattr(m, name)
    other: Any = value
    if isinstance(value, bool):
        other = not value
    elif isinstance(value, float):
        other = float(random.choice(NUMBERS))
    elif isinstance(value, int):
        other = int(random.choice(COUNTS)) if random.random() < 0.5 else value + int(random.integers(1, 50))
    elif isinstance(value, str):
        other = str(random.choice(WORDS))
    elif value:
        numbers = list(value)
        numbers[random.integers(len(numbers))] = float(random.choice(NUMBERS))
        other = tuple(numbers[: int(random.integers(1, len(numbers) + 1))])
    return msgspec.structs.replace(m, **{name: other})


def plain(output: bytes) -> NDArray[np.uint64]:
    """The words of an output, all that are no number as the same."""
    words = np.frombuffer(output[: len(output) // 8 * 8], "<u8").copy()
    words[np.isnan(words.view(np.float64))] = 0x7FF8 << 48
    return words


def randomly(command: list[object], taken: bytes) -> NDArray[np.uint64]:
    done = subprocess.run([*map(str, command), "shown"], input=taken, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    return plain(done.stdout)


if __name__ == "__main__":
    sys.stdout.buffer.write(Player().play(sys.stdin.buffer.read()))

"""The form in which a model crosses a thin link, and the end that hears it: texts that changed, and numbers in steps.

A message begins with a byte that says what it is; that which differs from another model then has two bytes that name
it. Texts that changed follow as msgpack, with their length before them, and then the bits of the numbers.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.errors import ForetouchError
from foretouch.identification import Status
from foretouch.messages import VERSION, ModelUpdate, decode, encode
from foretouch.models import ContactMapModel
from foretouch.models.contact_map.layout import MEMORY, PLAYS, Map
from foretouch.session.thin import coding, compact

PHRASES = (
    "",
    "nothing has been touched yet",
    "too few samples in contact, or too alike",
    *(status.value for status in Status),
)
"""Reasons that say nothing new: of them the number crosses."""
OTHER = len(PHRASES)  # Number of a reason that is none of them, and crosses as a text

PLAIN, WHOLE, DIFFERENCE, TEXTS, SALT = 0, 1, 2, 4, 8
"""First byte of a message: what it is; and whether texts follow, before the numbers. What is above that only makes the
message another one."""

NO_MEMORY, MEMORIES, UNTOUCHED = range(3)  # State of a model: empty, of as many numbers, or all not a number

TAG, LENGTH = struct.Struct("<H"), struct.Struct("<H")
encode_texts, decode_texts = msgspec.msgpack.encode, msgspec.msgpack.decode


class Texts(NamedTuple):
    """What changes seldom: each field crosses where it differs from that of the base."""

    law: str = ""
    estimator: str = ""
    reason: str = ""
    run: int = 0
    epoch: int = 0
    valid: bool = False
    parameters: int = 0
    state: int = NO_MEMORY
    is_map: bool = False
    fixture: int = 0
    deviation: int = 0
    friction: int = 0
    errors: int = 0


NO_TEXTS = Texts()


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """A model that crossed, as both ends know it."""

    tag: int
    sequence: int
    time_ns: int
    command_sequence: int
    texts: Texts
    reason: int
    steps: NDArray[np.int64]


NOTHING = Kept(0, 0, 0, 0, NO_TEXTS, 0, np.zeros(compact.COUNT, np.int64))
"""What there is before the first model: a whole one is the difference to it."""


def texts_of(update: ModelUpdate, is_map: bool) -> tuple[Texts, int] | None:
    """Texts of a model and the number of its reason; None where it has no such form."""
    state = NO_MEMORY
    if update.state:
        state = UNTOUCHED if all(map(math.isnan, update.state)) else MEMORIES
    reason = PHRASES.index(update.reason) if update.reason in PHRASES else OTHER
    texts = Texts(
        update.law,
        update.estimator,
        update.reason if reason == OTHER else "",
        update.run,
        update.epoch,
        update.valid,
        len(update.parameters),
        state,
        is_map,
        len(update.fixture),
        len(update.fixture_deviation),
        len(update.friction),
        len(update.standard_errors),
    )
    fits = _fits(texts) and bool(update.map) == is_map and len(update.state) in (0, MEMORY)
    return (texts, reason) if fits and math.isfinite(sum(update.state)) != (state == UNTOUCHED) else None


def _fits(texts: Texts) -> bool:
    """Whether the lengths are those of a model's numbers."""
    most = compact.MOST_PARAMETERS
    lengths = texts.parameters <= most and texts.errors <= most and texts.friction <= 8 and texts.state <= UNTOUCHED
    posed = texts.fixture in (0, 6) and texts.deviation in (0, 6)
    law = (texts.parameters == 4) if texts.is_map else texts.state == NO_MEMORY
    return lengths and posed and law and min(texts.run, texts.epoch, *texts[6:8], *texts[9:]) >= 0


ABSENT, ENDLESS = -1.0, 1e11  # Numbers for a deviation or an age that is not a number, or infinite


def row_of(update: ModelUpdate, model: ContactMapModel | None) -> NDArray[np.float64] | None:
    """The numbers of a model, shape (`compact.COUNT`,); None where one is out of every range."""
    row = np.zeros(compact.COUNT)
    row[0] = update.surface
    row[1 : 1 + len(update.parameters)] = update.parameters
    if model is not None:
        row[compact.AT_MAP : compact.AT_SPACE] = model.record.view(np.float64)
    at = compact.AT_SPACE
    row[at : at + len(update.fixture)] = update.fixture
    if update.fixture:
        row[at + 12] = update.fixture_age
    row[at + 6 : at + 6 + len(update.fixture_deviation)] = update.fixture_deviation
    row[at + 13 : at + 13 + len(update.friction)] = update.friction
    row[compact.AT_ERRORS : compact.AT_ERRORS + len(update.standard_errors)] = update.standard_errors
    seldom = row[at + 6 :]
    seldom[np.isnan(seldom)] = ABSENT
    np.clip(seldom, ABSENT, ENDLESS, out=seldom)
    return row if compact.fits(row, model is not None) else None


def _fields_of(row: NDArray[np.float64], texts: Texts) -> dict[str, Any]:
    """Fields of a message of the numbers of a model that are for people or of space."""
    at = compact.AT_SPACE
    row = row.copy()
    seldom = row[at + 6 :]
    seldom[seldom > 0.5 * ENDLESS] = math.inf
    seldom[seldom < 0.5 * ABSENT] = math.nan
    pose, deviation, friction = at + texts.fixture, at + 6 + texts.deviation, at + 13 + texts.friction
    return {
        "surface": float(row[0]),
        "parameters": tuple(row[1 : 1 + texts.parameters].tolist()),
        "fixture": tuple(row[at:pose].tolist()),
        "fixture_deviation": tuple(row[at + 6 : deviation].tolist()),
        "fixture_age": float(row[at + 12]) if texts.fixture else math.inf,
        "friction": tuple(row[at + 13 : friction].tolist()),
        "standard_errors": tuple(row[compact.AT_ERRORS : compact.AT_ERRORS + texts.errors].tolist()),
    }


PLAY_STEP, AVERAGE_STEP = 5e-6, 2e-5  # Steps of the memory's plays and averages [m]
BETWEEN = round((PLAYS[1] - PLAYS[0]) / PLAY_STEP)  # From one play to the other while the probe moves [steps]
FARTHEST_PLAY = 1e3  # Memory beyond this has no such form [m]


def steps_of_memory(state: tuple[float, ...]) -> list[int]:
    """A memory in steps, each from the one before, which is near it."""
    near, far = round(state[0] / PLAY_STEP), round(state[1] / PLAY_STEP)
    inside = max(near, 0) * PLAY_STEP
    short, middle, long = (round((inside - average) / AVERAGE_STEP) for average in state[2:5])
    return [near, int(far > near), BETWEEN - abs(near - far), short, middle - short, long - middle, round(state[5])]


def memory_of_steps(steps: list[int]) -> tuple[float, ...]:
    """The reverse of `steps_of_memory`."""
    near, beyond, less, short, middle, long, stuck = steps
    inside, away = max(near, 0) * PLAY_STEP, BETWEEN - less
    averages = (inside - step * AVERAGE_STEP for step in (short, short + middle, short + middle + long))
    return (near * PLAY_STEP, (near + (away if beyond else -away)) * PLAY_STEP, *averages, float(stuck))


MILLISECOND = 1_000_000  # [ns]
USUAL_MS = 20  # From one model to the next, as they are made [ms]
LARGEST_NUMBERS = 1024  # Bytes of the numbers of a model, at most


class Form:
    """What both ends need to write and read numbers: room for them."""

    def __init__(self) -> None:
        self.coder, self.maps = coding.Coder.new(), Map.new()
        self.room = np.zeros(LARGEST_NUMBERS, np.uint8)
        for each in (compact.settle, compact.unsettle, coding.code):
            each.entry  # noqa: B018  # asked for, it is compiled or loaded: nothing of that in the loop

    def write(self, heads: list[int], base: NDArray[np.int64], steps: NDArray[np.int64], is_map: bool) -> bytes:
        """The bytes of a model's steps; none where they are too many."""
        asked = np.array(heads, np.int64)
        arguments = asked, base, steps, compact.grids_of(is_map), self.maps, is_map, False
        size = coding.code.entry(self.coder[0], self.room, *arguments)
        return self.room[:size].tobytes() if size < LARGEST_NUMBERS else b""

    def read(
        self, data: bytes, count: int, base: NDArray[np.int64], is_map: bool
    ) -> tuple[list[int], NDArray[np.int64]]:
        """The reverse of `write`, of so many heads."""
        steps, heads = base.copy(), np.zeros(count, np.int64)
        arguments = heads, base, steps, compact.grids_of(is_map), self.maps, is_map, True
        coding.code.entry(self.coder[0], np.frombuffer(data, np.uint8).copy(), *arguments)
        return heads.tolist(), steps

    def update_of(self, kept: Kept, memory: tuple[float, ...]) -> ModelUpdate | None:
        """The message of a model that crossed; None where there is no such model."""
        texts, row = kept.texts, np.zeros(compact.COUNT)
        compact.unsettle.entry(kept.steps, compact.grids_of(texts.is_map), row, self.maps)
        content = b""
        if texts.is_map:
            model = ContactMapModel.of(self.maps)
            if model is None:
                return None
            content = model.map
        fields = _fields_of(row, texts)
        return ModelUpdate(
            VERSION,
            kept.sequence,
            kept.time_ns,
            kept.command_sequence,
            law=texts.law,
            state=memory,
            valid=texts.valid,
            reason=PHRASES[kept.reason] if kept.reason < OTHER else texts.reason,
            estimator=texts.estimator,
            map=content,
            epoch=texts.epoch,
            run=texts.run,
            **fields,
        )


def tag_of(data: bytes) -> int:
    """By what a later message names this one."""
    return zlib.crc32(data) & 0xFFFF


def start_of(base: Kept, law: str) -> NDArray[np.int64]:
    """Steps that those of a model of this law are differences to."""
    return base.steps if base.texts.law == law else NOTHING.steps


_FIGURES = re.compile(r"[\d.]+")


def calm(texts: Texts, base: Texts) -> Texts:
    """Texts with the base's reason, where the two differ in figures only: those count the time."""
    alike = _FIGURES.sub("", texts.reason) == _FIGURES.sub("", base.reason)
    return texts._replace(reason=base.reason) if alike else texts


def is_news(before: Texts, now: Texts) -> bool:
    """Whether what is told in texts is worth a message by itself."""
    return calm(now, before)._replace(errors=0) != before._replace(errors=0)


def head_of(base: Kept, texts: Texts, update: ModelUpdate) -> tuple[bytes, list[int]]:
    """The bytes before the numbers, and number, time and command as heads."""
    changed = [index for index, pair in enumerate(zip(texts, base.texts, strict=True)) if pair[0] != pair[1]]
    told: list[Any] = [sum(1 << index for index in changed), *(texts[index] for index in changed)]
    kind = WHOLE if base is NOTHING else DIFFERENCE
    heads = [0, 0, 0]
    if kind == WHOLE:
        told += [update.sequence, update.time_ns, update.command_sequence]
    else:
        passed = round((update.time_ns - base.time_ns) / MILLISECOND)
        commands = update.command_sequence - base.command_sequence
        number = update.sequence - base.sequence
        heads = [number, passed - USUAL_MS * number, commands - passed]
    head = bytes([kind | (TEXTS if len(told) > 1 else 0)]) + (TAG.pack(base.tag) if kind == DIFFERENCE else b"")
    if len(told) > 1:
        content = encode_texts(told)
        head += LENGTH.pack(len(content)) + content
    return head, heads


def texts_from(base: Texts, told: list[Any]) -> tuple[Texts, list[int]]:
    """The texts of a model, and what stands after them: number, time and command of a whole one."""
    mask, *values = told or [0]
    if type(mask) is not int:
        raise ValueError("no such texts")
    changed = [name for index, name in enumerate(Texts._fields) if mask >> index & 1]
    named = dict(zip(changed, values, strict=False))
    for name, value in named.items():
        if type(value) is not type(getattr(NO_TEXTS, name)):
            raise ValueError("no such text")
    texts, rest = base._replace(**named), values[len(changed) :]
    if not _fits(texts) or not all(type(value) is int for value in rest):
        raise ValueError("no such model")
    return texts, rest


KEPT = 64  # Models that both ends keep


class ModelsHeard:
    """The leader's end: what arrives becomes the messages that the follower made, as far as they can be felt.

    Attributes:
        wants_whole: Whether a model came that differs from one that is not here.
    """

    def __init__(self) -> None:
        self._form = Form()
        self._kept: dict[int, Kept] = {}  # by their numbers
        self.wants_whole = False

    def take(self, data: bytes) -> ModelUpdate | None:
        """The model of these bytes; None where they are none, or its base is not known: then `wants_whole` is True."""
        try:
            return self._take(data)
        except (ForetouchError, msgspec.MsgspecError, struct.error, ValueError, OverflowError, RecursionError):
            return None

    def _take(self, data: bytes) -> ModelUpdate | None:
        if not data:
            return None
        if data[0] == PLAIN:
            update = decode(data[1:], ModelUpdate)
            self._keep(Kept(tag_of(data), update.sequence, 0, 0, NO_TEXTS, 0, NOTHING.steps), update.run)
            return update
        kind, told, at = data[0] % TEXTS, [], 1
        if kind not in (WHOLE, DIFFERENCE):
            return None
        base = NOTHING
        if kind == DIFFERENCE:
            (tag,) = TAG.unpack_from(data, at)
            at += TAG.size
            known = [kept for kept in self._kept.values() if kept.tag == tag]
            if not known:
                self.wants_whole = True
                return None
            base = max(known, key=lambda kept: kept.sequence)
        if data[0] & TEXTS:
            (length,) = LENGTH.unpack_from(data, at)
            at += LENGTH.size
            told, at = decode_texts(data[at : at + length], type=list), at + length
        texts, whole = texts_from(base.texts, told)
        if len(whole) != (3 if kind == WHOLE else 0):
            return None
        kept, memory = self._read(data[at:], base, texts, whole)
        found = self._form.update_of(Kept(tag_of(data), *kept), memory)
        if found is None:
            return None
        update = decode(encode(found), ModelUpdate)
        self._keep(Kept(tag_of(data), *kept), update.run)
        self.wants_whole = self.wants_whole and kind != WHOLE
        return update

    def _read(self, data: bytes, base: Kept, texts: Texts, whole: list[int]) -> Any:
        """The fields of a `Kept` after its tag, and the state."""
        memories = len(coding.MEMORY) if texts.state == MEMORIES else 0
        heads, steps = self._form.read(data, len(coding.HEAD) + memories, start_of(base, texts.law), texts.is_map)
        number, passed, commands, reason = heads[: len(coding.HEAD)]
        if not 0 <= reason <= OTHER:
            raise ValueError("no such reason")
        state = memory_of_steps(heads[len(coding.HEAD) :]) if memories else ()
        if texts.state == UNTOUCHED:
            state = (math.nan,) * MEMORY
        if not whole:
            passed += USUAL_MS * number
            time_ns = base.time_ns + passed * MILLISECOND
            whole = [base.sequence + number, time_ns, base.command_sequence + commands + passed]
        return (*whole, texts, reason, steps), state

    def _keep(self, kept: Kept, run: int) -> None:
        """Remember a model that came; those of another run of the follower are of no use any more."""
        self._kept = {
            number: one for number, one in self._kept.items() if one.texts.run == run or one.steps is NOTHING.steps
        }
        self._kept[kept.sequence] = kept
        if len(self._kept) > KEPT:
            del self._kept[min(self._kept)]

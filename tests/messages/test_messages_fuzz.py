"""Whatever bytes arrive: a message or our errors, a finite force or a refusal; at once, and in bounded memory."""

from __future__ import annotations

import math
import random
import resource
import time
from collections import Counter

import msgspec
import numpy as np
import pytest

from foretouch.errors import DecodeError, InputError, PeerVersionError
from foretouch.identification import Learner, make_estimator
from foretouch.messages import CHANNELS, VERSION, Message, ModelUpdate, decode, encode
from foretouch.models import LAWS, ContactMapModel, ContactModel, advance, make_model
from foretouch.models.contact_map.layout import SIZE
from foretouch.models.contact_map.wire import unpack

KINDS = [channel.kind for channel in CHANNELS.values()]
LONGEST = 1.0
"""No case may take more of a processor [s]."""
MOST_MEMORY = 48_000
"""All cases together may take so much memory [kB]."""
FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-300, 5e-324, 1e300, 1.7e308, math.inf, -math.inf, math.nan, 400.0, 0.012)
COUNTS = (0, 1, 2**31, 2**63 - 1, 2**63, 2**64 - 1, -1)
TEXTS = ("", "x", "contact-map", "hunt-crossley", "x" * 400, "x" * 401, "\x00", "\U0001f9e4", "count_lost")
HEADS = (
    b"\xdd\xff\xff\xff\xff",
    b"\xdc\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xdb\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff",
)
"""Arrays, byte strings, texts and maps that claim to be as long as msgpack can say."""


@pytest.fixture(scope="module")
def valid_map() -> bytes:
    learner = Learner(make_estimator("contact-map", "bank"), surface=0.0, force_offset=0.0)
    for tick in range(1000):
        depth = 0.004 * (1.0 - abs(1.0 - tick / 500))
        learner.update(tick * 1e-3, depth, 500.0 * depth)
    model = learner.learnt().model
    assert isinstance(model, ContactMapModel)
    return model.map


class Fuzz:
    """Seeded messages, models and maps, most of them nearly right."""

    def __init__(self, seed: int, valid_map: bytes) -> None:
        self.random = random.Random(seed)
        self.map = valid_map
        self.count: Counter[str] = Counter()
        self.slowest = 0.0
        self.longest = 0

    def content(self) -> bytes:
        draw = self.random
        kind = draw.randrange(5)
        if kind == 0:
            return self.map
        if kind == 1:
            return draw.randbytes(draw.choice((0, 3, 4 * draw.randrange(SIZE + 2), 4 * SIZE, 4096)))
        numbers = np.frombuffer(self.map, dtype="<f4").copy()
        for _ in range(draw.choice((1, 1, 3, 40))):
            index = draw.randrange(20 if draw.random() < 0.7 else numbers.size)
            numbers[index] = draw.choice((0.0, 1.0, -1.0, 3e38, -3e38, 1e-45, 0.004, 1e3, draw.uniform(-10, 10)))
        if kind == 2 and draw.random() < 0.3:
            numbers[draw.randrange(20)] = math.nan
        data = numbers.tobytes()
        return data if kind < 4 else data[: 4 * draw.randrange(len(data) // 4)]

    def number(self) -> float:
        draw = self.random
        return draw.choice(FLOATS) if draw.random() < 0.3 else draw.uniform(0.0, 10.0) * 10.0 ** draw.randrange(-3, 5)

    def numbers(self) -> tuple[float, ...]:
        return tuple(self.number() for _ in range(self.random.choice((0, 1, 2, 3, 4, 4, 4, 5, 6, 50))))

    def update(self) -> ModelUpdate:
        draw = self.random
        law = draw.choice((*LAWS, "contact-map", "contact-map", "jelly", ""))
        parameters = self.numbers()
        if law in LAWS and draw.random() < 0.8:
            parameters = tuple(self.number() for _ in LAWS[law].parameter_names)
        content = self.content() if law == "contact-map" or draw.random() < 0.1 else b""
        return ModelUpdate(VERSION, 1, 1, 1, law, parameters, self.numbers(), self.number(), True, "", "x", content)

    def value(self, field: msgspec.inspect.Field) -> object:
        """A value of a field: right, at its bounds, beyond them, or of another type."""
        draw, kind = self.random, field.type
        if draw.random() < 0.05:
            return draw.choice((None, True, 1, 0.5, "x", b"x", [], [1, [2]], {"a": 1}, 2**64 - 1))
        if isinstance(kind, msgspec.inspect.IntType):
            return draw.choice(COUNTS) if draw.random() < 0.2 else draw.randrange(2**40)
        if isinstance(kind, msgspec.inspect.FloatType):
            return self.number()
        if isinstance(kind, msgspec.inspect.BoolType):
            return draw.random() < 0.5
        if isinstance(kind, msgspec.inspect.StrType):
            return draw.choice(TEXTS)
        if isinstance(kind, msgspec.inspect.BytesType):
            return self.content()
        if isinstance(kind, msgspec.inspect.UnionType):  # what there is in space
            (record,) = (one for one in kind.types if isinstance(one, msgspec.inspect.StructType))
            return [self.value(one) for one in record.fields][: draw.choice((99, 99, 99, 19, 3))]
        assert isinstance(kind, msgspec.inspect.VarTupleType)
        if isinstance(kind.item_type, msgspec.inspect.FloatType):
            return self.numbers()
        return [draw.choice(TEXTS) for _ in range(draw.choice((0, 1, 3, 64, 65)))]

    def data(self, kind: type[Message]) -> bytes:
        draw = self.random
        info = msgspec.inspect.type_info(kind)
        assert isinstance(info, msgspec.inspect.StructType)
        values = [VERSION, *(self.value(field) for field in info.fields[1:])]
        if draw.random() < 0.1:
            values[0] = draw.choice((0, VERSION + 1, "x", None, -1))
        if draw.random() < 0.1:
            values = values[: draw.randrange(len(values))] if draw.random() < 0.5 else [*values, 1]
        data = bytearray(msgspec.msgpack.encode([-1 if value == -1 else value for value in values]))
        for _ in range(draw.choice((0, 0, 0, 1, 1, 2, 8))):
            index = draw.randrange(len(data))
            how = draw.randrange(5)
            if how == 0:
                data[index] ^= 1 << draw.randrange(8)
            elif how == 1:
                data[index] = draw.randrange(256)
            elif how == 2:
                del data[index : index + draw.randrange(1, 9)]
            elif how == 3:
                data[index:index] = draw.randbytes(draw.randrange(1, 9))
            else:
                data[index : index + draw.choice((1, 5))] = draw.choice(HEADS)
            if not data:
                break
        return bytes(data)

    def case(self) -> None:
        begin = time.thread_time()
        kind = self.random.choice((*KINDS, ModelUpdate))
        shape = self.random.randrange(20)
        if shape == 0:
            data = self.random.randbytes(self.random.choice((0, 1, 9, 200, 66_000)))
        elif shape == 1:
            data = self.random.choice((b"\x91", b"\xdd\x00\x01\xff\xff", b"\x81\x01")) * self.random.randrange(16_000)
        elif shape < 10:
            kind, data = ModelUpdate, encode(self.update())
        else:
            data = self.data(kind)
        try:
            message: Message = decode(data, kind)
        except PeerVersionError:
            self.count["version"] += 1
        except DecodeError:
            self.count["refused"] += 1
        else:
            self.count["message"] += 1
            if isinstance(message, ModelUpdate):
                self.run(message)
        self.slowest = max(self.slowest, time.thread_time() - begin)

    def run(self, update: ModelUpdate) -> None:
        unpack(update.map)
        try:
            model = make_model(update.law, update.parameters, update.map)
        except InputError as error:
            self.count["no model"] += 1
            self.longest = max(self.longest, len(str(error)))
            return
        self.count["model"] += 1
        for state in (update.state, model.initial_state()):
            self.press(model, state)

    def press(self, model: ContactModel, state: tuple[float, ...]) -> None:
        for depth, velocity in ((0.003, 0.02), (self.number(), self.number()), (-0.001, -0.1), (math.nan, math.inf)):
            state, force, _ = advance(model, state, depth, velocity, 1e-3)
            assert math.isfinite(force), (model, depth, velocity, force)
            assert force >= 0.0, (model, depth, velocity, force)


def memory_kilobytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@pytest.mark.parametrize(
    ("cases", "seed"), [(10_000, 1), *(pytest.param(100_000, 100 + n, marks=pytest.mark.long) for n in range(10))]
)
def test_ten_thousand_messages_and_a_million(cases: int, seed: int, valid_map: bytes) -> None:
    warm = Fuzz(seed + 1, valid_map)  # compiles what is compiled
    for _ in range(500):
        warm.case()
    before, made = memory_kilobytes(), Fuzz(seed, valid_map)
    for _ in range(cases):
        made.case()
    assert made.slowest < LONGEST
    assert made.longest < 1000
    assert memory_kilobytes() - before < MOST_MEMORY
    # It is worth something only if every way is gone.
    ways = ("version", "refused", "message", "no model", "model")
    assert min(made.count[name] for name in ways) > cases / 100, made.count


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("head", HEADS)
def test_what_claims_to_be_long_takes_no_memory(kind: type[Message], head: bytes) -> None:
    before = memory_kilobytes()
    for data in (head, bytes([0x9C]) + head, b"\x9c" + encode_version() + 2 * b"\x01" + head, 13_000 * head):
        with pytest.raises((DecodeError, PeerVersionError)):
            decode(data, kind)
    assert memory_kilobytes() - before < 10_000


def encode_version() -> bytes:
    return msgspec.msgpack.encode(VERSION)

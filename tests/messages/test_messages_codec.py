"""Messages survive the wire exactly; nothing else gets through."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import DecodeError, PeerVersionError
from foretouch.messages import (
    CHANNELS,
    FOLLOWER_DTYPE,
    FOLLOWER_SPACE_DTYPE,
    LEADER_DTYPE,
    LEADER_SPACE_DTYPE,
    VERSION,
    Command,
    FollowerSpace,
    LeaderSpace,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Stop,
    Telemetry,
    as_row,
    decode,
    encode,
)

KINDS = [channel.kind for channel in CHANNELS.values()]
numbers = st.integers(0, 2**63 - 1)


def field_strategy(field: msgspec.inspect.Field) -> st.SearchStrategy[Any]:
    kind = field.type
    if isinstance(kind, msgspec.inspect.IntType):
        return numbers
    if isinstance(kind, msgspec.inspect.FloatType):
        low = -math.inf if kind.ge is None else kind.ge
        high = math.inf if kind.le is None else kind.le
        return st.floats(low, high, allow_nan=False) if math.isfinite(low) else st.floats(allow_nan=False)
    if isinstance(kind, msgspec.inspect.BoolType):
        return st.booleans()
    if isinstance(kind, msgspec.inspect.StrType) and kind.pattern is not None:
        return st.from_regex(kind.pattern).filter(lambda text: len(text) <= (kind.max_length or len(text)))
    if isinstance(kind, msgspec.inspect.StrType):
        return st.text(max_size=20)
    if isinstance(kind, msgspec.inspect.BytesType):
        return st.binary(max_size=20)
    assert isinstance(kind, msgspec.inspect.VarTupleType)
    inner = st.floats(allow_nan=False) if isinstance(kind.item_type, msgspec.inspect.FloatType) else st.text(max_size=5)
    return st.lists(inner, max_size=min(kind.max_length or 5, 5)).map(tuple)


def messages(kind: type[Message]) -> st.SearchStrategy[Message]:
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, msgspec.inspect.StructType)
    fields = {field.name: field_strategy(field) for field in info.fields if field.name != "version"}
    return st.builds(kind, version=st.just(VERSION), **fields)


@given(st.sampled_from(KINDS).flatmap(messages))
def test_every_message_survives_the_wire(message: Message) -> None:
    assert decode(encode(message), type(message)) == message


@given(st.binary(max_size=80), st.sampled_from(KINDS))
def test_arbitrary_bytes_raise_our_errors_only(data: bytes, kind: type[Message]) -> None:
    with pytest.raises((DecodeError, PeerVersionError)):
        decode(data, kind)


@given(st.sampled_from(KINDS).flatmap(messages), st.integers(0, 30))
def test_truncated_messages_are_refused(message: Message, cut: int) -> None:
    data = encode(message)
    with pytest.raises((DecodeError, PeerVersionError)):
        decode(data[: max(0, len(data) - 1 - cut)], type(message))


def test_a_message_of_another_channel_is_refused() -> None:
    with pytest.raises(DecodeError, match="not a Telemetry"):
        decode(encode(Command(VERSION, 1, 2, 0.1, 0)), Telemetry)


def test_another_version_is_told_apart_from_garbage() -> None:
    stop = Stop(VERSION + 1, 1, 2, "end")
    with pytest.raises(PeerVersionError, match=f"version {VERSION + 1}.* version {VERSION}: install the same"):
        decode(encode(stop), Stop)
    with pytest.raises(PeerVersionError):  # another version may have other fields
        decode(msgspec.msgpack.encode([VERSION + 1, "anything"]), Stop)


def test_too_long_a_message_is_refused_unread() -> None:
    with pytest.raises(DecodeError, match="bytes, at most"):
        decode(bytes(100_000), Stop)


def test_tables_hold_the_fields_of_their_messages() -> None:
    tables = {
        LeaderState: LEADER_DTYPE,
        Telemetry: FOLLOWER_DTYPE,
        LeaderSpace: LEADER_SPACE_DTYPE,
        FollowerSpace: FOLLOWER_SPACE_DTYPE,
    }
    for kind, dtype in tables.items():
        assert dtype.names == kind.__struct_fields__[1:]


def telemetry(tick: int, command: int) -> Telemetry:
    return Telemetry(VERSION, tick, tick, command, 0, 0, 0, 0, 0, 0, False, False, 0, 0, 0)


def test_rows_pair_a_command_with_the_first_tick_that_applied_it() -> None:
    leader = [LeaderState(VERSION, s, s, 0.1 * s, 0, 0, 0, 0, 0, 0, 0.0, False, 0, 0) for s in range(1, 6)]
    follower = [telemetry(tick, command) for tick, command in enumerate((0, 1, 1, 3, 3, 4), start=1)]
    rows = SessionLog.from_messages(leader, follower, [], {}, {}).rows()
    assert rows.leader["sequence"].tolist() == [1, 3, 4]
    assert rows.follower["sequence"].tolist() == [2, 4, 6]
    assert rows.never_applied == 2
    assert np.isclose(rows.leader["position"], [0.1, 0.3, 0.4]).all()


def test_a_row_is_the_message_without_its_version() -> None:
    model = ModelUpdate(VERSION, 3, 4, 5, "law", (1.0,), (), 0.0, True, "", "fprls", b"map", 6, 7)
    along_a_line = ((), (), math.inf, ())  # no fixture, no friction
    untold = ((),)  # standard errors
    assert as_row(model) == (3, 4, 5, "law", (1.0,), (), 0.0, True, "", "fprls", b"map", 6, 7, *along_a_line, *untold)

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
    LARGEST_MESSAGE,
    LEADER_DTYPE,
    LEADER_SPACE_DTYPE,
    SPEAKERS,
    VERSION,
    CameraImage,
    Command,
    EmergencyStop,
    FixtureBelief,
    FollowerSpace,
    Hello,
    LeaderSpace,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Stop,
    Telemetry,
    as_printed,
    as_row,
    decode,
    encode,
    foreign_speaker,
)
from foretouch.messages.schema import MOST_TEXTS
from foretouch.messages.spatial import LARGEST_JPEG

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
    assert decode(encode(message), type(message)) == as_printed(message)


HOSTILE = "\x1b]0;mine\x07\x1b[2J\r\nfollower: released \u202eDETIUQ\u2066\x9b31m\x7f"


def texts_of(message: Message) -> list[str]:
    values = msgspec.structs.astuple(message)
    return [
        text for value in values for text in (value if isinstance(value, tuple) else (value,)) if isinstance(text, str)
    ]


@pytest.mark.parametrize(
    "message",
    [
        EmergencyStop(VERSION, 1, 1, HOSTILE, 5),
        Stop(VERSION, 1, 1, HOSTILE),
        Hello(VERSION, 1, 1, "follower", ("trouble", HOSTILE[:60]), (HOSTILE, "foam")),
        Command(VERSION, 1, 1, 0.01, 0, False, HOSTILE[:60], 3),
        ModelUpdate(VERSION, 1, 1, 0, HOSTILE, (), (), 0.0, False, HOSTILE, HOSTILE, b""),
        CameraImage(VERSION, 1, 1, 1, b"", (), (), 0, HOSTILE, ()),
        FixtureBelief(VERSION, 1, 1, (), (), 0.0, 0, 0, 0, HOSTILE),
    ],
)
def test_control_characters_of_a_peer_are_shown_and_not_done(message: Message) -> None:
    arrived = decode(encode(message), type(message))
    assert all(text.isprintable() for text in texts_of(arrived))
    assert any(r"\x1b]0;mine\x07\x1b[2J\r\nfollower: released \u202e" in text for text in texts_of(arrived))
    assert as_printed(arrived) == arrived


def test_hellos_of_roles_that_there_are_not_are_refused() -> None:
    for role in SPEAKERS:
        assert decode(encode(Hello(VERSION, 1, 1, role, (), ())), Hello).role == role
    for role in ("", "x", "r17", "leader ", "LEADER", "leader\n", "watcher", "simulation"):
        with pytest.raises(DecodeError, match="not a Hello"):
            decode(encode(Hello(VERSION, 1, 1, role, (), ())), Hello)


def test_a_hello_is_cut_to_what_a_peer_takes() -> None:
    said = Hello.of("leader", 1, 1, {f"{i}" + "n" * 100: "v" * 5000 for i in range(20)} | {"material": "foam"})
    assert decode(encode(said), Hello) == said
    assert said.texts["material"] == "foam"
    most = Hello.of("leader", 1, 1, {str(i): "" for i in range(500)})
    assert len(decode(encode(most), Hello).names) == MOST_TEXTS


@pytest.mark.parametrize(
    "fields", [[], [VERSION + 1], [VERSION + 1, 1, 1], [VERSION + 1, 1, 1, 7], [VERSION + 1, 1, 1, "x"]]
)
def test_what_is_no_hello_of_another_version_says_nothing_about_anybody(fields: list[object]) -> None:
    assert foreign_speaker(msgspec.msgpack.encode(fields)) == ""
    assert foreign_speaker(msgspec.msgpack.encode([VERSION + 1, 1, 1, "follower", {"more": 1}])) == "follower"
    assert foreign_speaker(b"\x91\x07") == foreign_speaker(b"garbage") == foreign_speaker(b"") == ""


def test_the_largest_image_goes_over_the_network() -> None:
    image = CameraImage(
        2**63 - 1, 2**63 - 1, 2**63 - 1, 2**63 - 1, b"x" * LARGEST_JPEG, (1.5,) * 6, (1.5,) * 36, 2**63 - 1,
        "\U0001f9e4" * 400, (1.5,) * 15, 2**63 - 1,
    )  # fmt: skip
    assert len(encode(image)) <= LARGEST_MESSAGE


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
    rows = SessionLog.from_messages([*leader, *follower]).rows()
    assert rows.leader["sequence"].tolist() == [1, 3, 4]
    assert rows.follower["sequence"].tolist() == [2, 4, 6]
    assert rows.never_applied == 2
    assert np.isclose(rows.leader["position"], [0.1, 0.3, 0.4]).all()


def test_a_row_is_the_message_without_its_version() -> None:
    model = ModelUpdate(VERSION, 3, 4, 5, "law", (1.0,), (), 0.0, True, "", "fprls", b"map", 6, 7)
    along_a_line = ((), (), math.inf, ())  # no fixture, no friction
    untold = ((),)  # standard errors
    assert as_row(model) == (3, 4, 5, "law", (1.0,), (), 0.0, True, "", "fprls", b"map", 6, 7, *along_a_line, *untold)

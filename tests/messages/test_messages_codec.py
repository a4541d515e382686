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
    COUNT_PREFIX,
    LARGEST_MESSAGE,
    NEWS,
    PROCESS,
    SPEAKERS,
    VERSION,
    CameraImage,
    Command,
    EmergencyStop,
    FixtureBelief,
    Hello,
    Hellos,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Stop,
    Telemetry,
    as_printed,
    decode,
    encode,
    fixture_of,
    foreign_speaker,
    split_texts,
)
from foretouch.messages.schema import MOST_TEXTS
from foretouch.messages.states import LARGEST_JPEG, in_space

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
    if isinstance(kind, msgspec.inspect.UnionType):
        (record,) = (one for one in kind.types if isinstance(one, msgspec.inspect.StructType))
        return st.none() | st.builds(record.cls, **{one.name: field_strategy(one) for one in record.fields})
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
    values = [value if isinstance(value, tuple) else (value,) for value in msgspec.structs.astuple(message)]
    return [text for value in values for text in value if isinstance(text, str)]


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
    message = Hello.of("leader", 1, 1, {f"{i}" + "n" * 100: "v" * 5000 for i in range(20)} | {"material": "foam"})
    assert decode(encode(message), Hello) == message
    assert message.texts["material"] == "foam"
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


@given(st.sampled_from(KINDS).flatmap(messages), st.integers(0, 30))
def test_truncated_messages_are_refused(message: Message, cut: int) -> None:
    data = encode(message)
    with pytest.raises((DecodeError, PeerVersionError)):
        decode(data[: max(0, len(data) - 1 - cut)], type(message))


def test_another_version_another_channel_and_too_long_a_message_are_told_apart_from_garbage() -> None:
    with pytest.raises(DecodeError, match="not a Telemetry"):
        decode(encode(Command(VERSION, 1, 2, 0.1, 0)), Telemetry)
    stop = Stop(VERSION + 1, 1, 2, "end")
    with pytest.raises(PeerVersionError, match=f"version {VERSION + 1}.* version {VERSION}: install the same"):
        decode(encode(stop), Stop)
    with pytest.raises(PeerVersionError):  # another version may have other fields
        decode(msgspec.msgpack.encode([VERSION + 1, "anything"]), Stop)
    with pytest.raises(DecodeError, match="bytes, at most"):
        decode(bytes(100_000), Stop)


@given(messages(Telemetry), messages(LeaderState))
def test_what_is_said_in_space_stands_in_a_table_of_its_own(telemetry: Telemetry, state: LeaderState) -> None:
    log = SessionLog.from_messages([state, telemetry])
    for message, rows, space in ((telemetry, log.follower, log.follower_space), (state, log.leader, log.leader_space)):
        names, told = message.__struct_fields__, [msgspec.structs.astuple(one)[1:] for one in in_space(message)]
        assert (rows.dtype.names, rows.tolist()) == (names[1:-1], [msgspec.structs.astuple(message)[1:-1]])
        assert (space.tolist(), len(told)) == (told, message.space is not None)  # type: ignore[attr-defined]
        for name in space.dtype.names if told else ():
            assert space[name][0] == getattr(message if name in names else message.space, name)  # type: ignore[attr-defined]
    assert log.messages() == sorted((telemetry, state), key=lambda message: message.time_ns)
    assert telemetry.space is None or fixture_of(telemetry.space) == log.follower_space[0].tolist()[15:21]


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


# --- sessions whose sides ended and began again: what belongs together, and what was said of it all -------------------


MS = 1_000_000


def led(tick: int, sequence: int, epoch: int, run: int) -> LeaderState:
    return LeaderState(
        VERSION, sequence, tick * MS, 1.0 * epoch, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0, False, 0, 0, epoch=epoch, run=run
    )


def followed(tick: int, sequence: int, command: int, epoch: int, run: int) -> Telemetry:
    figures = (0.0, 1.0 * epoch, 0.0, 0.0, 0.0, 0.0)
    return Telemetry(VERSION, sequence, tick * MS, command, *figures, False, False, 0, 0, 0, epoch=epoch, run=run)


def model(sequence: int, epoch: int, run: int) -> ModelUpdate:
    return ModelUpdate(VERSION, sequence, 0, 0, "", (), (), 0.0, False, "", "", b"", epoch, run)


def session() -> SessionLog:
    leader = [led(tick, tick, 5, 1 if tick > 10 else 0) for tick in range(1, 101)]
    leader += [led(tick, tick - 100, 7, 0 if tick <= 110 else 1 if tick < 290 else 2) for tick in range(101, 401)]
    follower = []
    for tick in (*range(1, 251), *range(280, 401)):
        run = 1 if tick <= 250 else 2
        late = tick - 10
        epoch = 0 if late < 1 or (run == 2 and tick < 285) else 5 if late <= 100 else 7
        command = 0 if epoch == 0 else late if epoch == 5 else late - 100
        follower.append(followed(tick, tick if run == 1 else tick - 279, command, epoch, run))
    models = [model(1, 0, 1), model(2, 5, 1), model(3, 7, 1), model(1, 0, 2), model(2, 7, 2)]
    return SessionLog.from_messages([*leader, *follower, *models], {"material": "foam"}, {"late": 1})


def test_each_segment_has_one_process_of_either_side_and_numbers_of_different_processes_are_not_paired() -> None:
    log = session()
    parts = log.segments()
    assert [(part.leader["epoch"][0], part.follower["run"][0]) for part in parts] == [(5, 1), (7, 1), (7, 2)]
    for part in parts:
        assert np.unique(part.leader["epoch"]).size == np.unique(part.follower["run"]).size == 1
    assert sum(part.leader.size for part in parts) == log.leader.size
    assert sum(part.follower.size for part in parts) == log.follower.size
    assert [[one.sequence for one in part.models] for part in parts] == [[1, 2], [3], [1, 2]]
    assert all(part.settings == log.settings and part.counts == log.counts for part in parts)
    first, second, third = session().segments()
    assert first.leader["run"][0] == 0 == first.follower["epoch"][0]
    assert second.leader["sequence"][0] == 1
    assert third.follower["sequence"][0] == 1
    assert third.follower["epoch"][0] == 0
    rows = log.rows()
    assert (rows.leader["epoch"] == rows.follower["epoch"]).all()
    assert (rows.leader["position"] == rows.follower["position"]).all()
    assert rows.leader.size > 300
    assert rows.never_applied == log.leader.size - rows.leader.size


def test_the_longest_is_where_both_were_there() -> None:
    log = session()
    longest = log.longest()
    assert (longest.leader["epoch"][0], longest.follower["run"][0]) == (7, 1)
    alone = np.concatenate([log.leader, np.zeros(5000, log.leader.dtype)])
    alone["epoch"][log.leader.size :] = 9  # a leader that nobody obeys, for longer than all others
    alone["sequence"][log.leader.size :] = np.arange(1, 5001)
    alone["time_ns"][log.leader.size :] = np.arange(5000) * MS
    alone["run"][log.leader.size :] = 1
    other = SessionLog(alone, log.follower, log.models)
    assert other.longest().leader["epoch"][0] == 7
    assert other.rows().leader.size == log.rows().leader.size


@pytest.mark.parametrize("epoch", [0, 3])
@pytest.mark.parametrize("run", [0, 4])
def test_a_session_without_a_restart_is_its_own_segment(epoch: int, run: int) -> None:
    leader = [led(tick, tick, epoch, run if tick > 5 else 0) for tick in range(1, 50)]
    follower = [followed(tick, tick, tick, epoch if tick > 5 else 0, run) for tick in range(1, 50)]
    log = SessionLog.from_messages([*leader, *follower, model(1, epoch, run)])
    assert log.segments() == (log,)
    assert log.longest() is log
    assert log.rows().leader.size == 49


def test_a_side_that_never_heard_the_other_is_where_it_was_heard() -> None:
    leader = [led(tick, tick, 3, 0) for tick in range(1, 50)]  # nothing comes back
    follower = [followed(tick, tick, tick, 3, 4) for tick in range(1, 50)]
    log = SessionLog.from_messages([*leader, *follower])
    assert log.segments() == (log,)
    strangers = [followed(tick, tick, 0, 0, 4) for tick in range(1, 50)]
    apart = SessionLog.from_messages([*leader, *strangers])
    assert apart.segments() == (apart,)
    empty = SessionLog.from_messages([])
    assert empty.longest() is empty
    assert empty.rows().leader.size == 0


def hello(role: str, process: str, **texts: str) -> Hello:
    texts = {PROCESS: process, **texts} if process else texts
    return Hello(VERSION, 1, 0, role, tuple(texts), tuple(texts.values()))


def test_counters_of_all_processes_are_summed_and_news_are_kept_once_each() -> None:
    hellos = Hellos()
    lost = COUNT_PREFIX + "commands_lost"
    for process, count in (("1", 3), ("1", 10), ("2", 0), ("2", 4)):
        hellos.take(hello("follower", process, **{lost: str(count)}))
    hellos.take(hello("leader", "9", **{COUNT_PREFIX + "models_lost": "2", "material": "foam"}))
    assert hellos.counts == {"commands_lost": 14, "models_lost": 2}
    assert hellos.settings == {"material": "foam"}
    hellos = Hellos()
    for holder in ("", "anna", "anna", "bert", "anna"):
        hellos.take(hello("follower", "1", control=holder, trouble="", stopped=""))
    assert hellos.news == {"control": ("anna", "bert")}
    assert hellos.settings == {}
    assert split_texts({**dict.fromkeys(NEWS, "said"), PROCESS: "1", "seed": "2"}) == ({"seed": "2"}, {})


@pytest.mark.parametrize("role", ["recorder", "leader", "supervisor"])
def test_who_says_hello_without_end_takes_nobody_the_place(role: str) -> None:
    hellos, received = Hellos(), COUNT_PREFIX + "commands_received"
    for number in range(1000):
        hellos.take(hello(role, str(number), **{"contest": f"invented {number}", COUNT_PREFIX + "sent": "1"}))
    hellos.take(hello("follower", "7", **{"contest": "CONTROL TAKEN: bert has it", received: "55"}))
    assert hellos.news == {"contest": ("CONTROL TAKEN: bert has it",)}
    assert hellos.counts["commands_received"] == 55
    assert hellos.counts["sent"] < 100


def test_who_says_hello_without_end_fills_nothing() -> None:
    hellos = Hellos()
    for number in range(1000):
        hellos.take(hello("follower", str(number), **{COUNT_PREFIX + "sent": "1", "control": f"name {number}"}))
    assert hellos.counts["sent"] < 100
    assert len(hellos.news["control"]) < 100
    for number in range(1000):
        texts = {f"name {number}": "x", COUNT_PREFIX + f"count {number}": "1"}
        hellos.take(hello("leader", "", **texts))
        hellos.take(hello(f"role {number}", "", **texts))
    assert len(hellos.settings) < 100
    assert len(hellos.counts) < 100

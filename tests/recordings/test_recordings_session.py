import random
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import msgspec
import pytest
import session_messages as made
from hypothesis import given
from hypothesis import strategies as st
from made_bags import copy_of
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from session_messages import bits

from foretouch.errors import MissingExtraError, RecordingError
from foretouch.messages import (
    CHANNELS,
    COUNT_PREFIX,
    PROCESS,
    VERSION,
    EmergencyStop,
    Handle,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    SessionLog,
    Telemetry,
)
from foretouch.messages.states import FollowerRow, LeaderRow
from foretouch.quantities import FRAMES
from foretouch.recordings import SessionWriter, read_recording, read_session
from foretouch.recordings.formats.cdr import HEADER, Layout
from foretouch.recordings.formats.topics import TOPICS


def decoded(path):
    """What another reader makes of the file: channel, record and decoded message, in the order of the file."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [got[1:] for got in reader.iter_decoded_messages(log_time_order=False)]


def expected_log(ticks):
    messages = [message for message, _ in made.session(ticks)]
    by_kind = defaultdict(list)
    for message in messages:
        by_kind[type(message)].append(message)
    return SessionLog.from_messages([*by_kind[LeaderState], *by_kind[Telemetry], *by_kind[ModelUpdate]])


def assert_same(log, expected):
    assert log.leader.dtype == expected.leader.dtype
    assert log.follower.dtype == expected.follower.dtype
    assert log.leader.tobytes() == expected.leader.tobytes()
    assert log.follower.tobytes() == expected.follower.tobytes()
    assert [bits(msgspec.structs.astuple(m)) for m in log.models] == [
        bits(msgspec.structs.astuple(m)) for m in expected.models
    ]


@pytest.mark.usefixtures("read_apart")
@pytest.mark.long
def test_a_session_reads_back_bit_by_bit(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 501, {"undecodable": 3, "late": 0})
    log = read_session(path)
    assert_same(log, expected_log(501))
    assert log.settings == {"operator": "scripted", "seed": "1", "material": "foam-measured", "note": ""}
    assert log.counts == {"undecodable": 3, "late": 0}


def test_processes_news_and_emergency_stops_read_back(tmp_path):
    path, ticks = tmp_path / "session.mcap", 60
    stop = EmergencyStop(VERSION, 1, 7, "somebody shouted")
    texts = {PROCESS: "8", "control": "anna", "stopped": stop.reason, COUNT_PREFIX + "commands_stale": "2"}
    with SessionWriter(path) as writer:
        for process, epoch in enumerate((8, 9)):
            begin = process * ticks
            told = texts | {PROCESS: str(epoch)}
            writer.write(Hello(VERSION, 1, 0, "follower", tuple(told), tuple(told.values())), begin)
            for tick in range(1, ticks + 1 + process):
                record = msgspec.structs.replace(made.leader_state(tick), epoch=epoch, run=epoch + 1)
                writer.write(record, begin + tick)
                output = msgspec.structs.replace(made.telemetry(tick), epoch=epoch, run=epoch + 1, validity=tick % 7)
                writer.write(output, begin + tick)
            writer.write(msgspec.structs.replace(made.model(1), epoch=epoch, run=epoch + 1), begin + ticks)
            writer.write(stop, begin + ticks)
    log = read_session(path)
    assert log.emergencies == (stop, stop)
    assert log.news == {"control": ("anna",), "stopped": (stop.reason,)}
    assert log.counts == {"commands_stale": 4}
    assert log.settings == {}
    first, second = log.segments()
    assert set(first.leader["epoch"]) == {8}
    assert set(second.follower["run"]) == {10}
    assert [model.run for model in log.models] == [9, 10]
    assert log.longest().leader.size == ticks + 1
    assert log.follower["validity"].tolist() == [*(t % 7 for t in range(1, 61)), *(t % 7 for t in range(1, 62))]


def test_an_independent_reader_gets_every_value(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 120, {"late": 1})
    sent = list(made.session(120))
    own = {topic.name: kind for kind, topic in TOPICS.items()}
    read = defaultdict(list)
    for channel, record, message in decoded(path):
        read[channel.topic].append((record, message))
    for topic, kind in own.items():
        pairs = zip(read[topic], [pair for pair in sent if type(pair[0]) is kind], strict=True)
        for (record, got), (message, log_time_ns) in pairs:
            for name in kind.__struct_fields__:
                assert name == "space" or bits(getattr(got, name)) == bits(getattr(message, name))
            assert (record.log_time, record.publish_time) == (log_time_ns, message.time_ns)
            assert record.sequence == message.sequence
    for topic, kind, force in (
        ("/follower/joint_states", Telemetry, "force"),
        ("/leader/joint_states", LeaderState, "rendered_force"),
    ):
        for (_, state), message in zip(read[topic], [m for m, _ in sent if type(m) is kind], strict=True):
            assert state.header.stamp.sec * 10**9 + state.header.stamp.nanosec == message.time_ns
            assert (state.header.frame_id, list(state.name)) == ("tip", ["probe"])
            assert bits([*state.position, *state.velocity, *state.effort]) == bits(
                [message.position, message.velocity, getattr(message, force)]
            )
    for (_, got), message in zip(read["/follower/wrench"], [m for m, _ in sent if type(m) is Telemetry], strict=True):
        force, torque = got.wrench.force, got.wrench.torque
        assert got.header.frame_id == "tip"
        assert bits([force.x, force.y, force.z, torque.x, torque.y, torque.z]) == bits(
            [0.0, 0.0, message.force, 0.0, 0.0, 0.0]
        )


def test_another_reader_gets_the_frame_of_every_topic(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 120)
    with path.open("rb") as file:
        channels = {channel.topic: channel.metadata for channel in make_reader(file).get_summary().channels.values()}
    said = {topic: metadata["frame_id"] for topic, metadata in channels.items() if "frame_id" in metadata}
    assert set(said.values()) <= set(FRAMES)
    packets = {"/leader/packet", "/follower/packet", "/camera/small"}
    assert {topic for topic in channels if topic not in said} - packets == {
        f"/session/{name}" for name in ("hello", "settings", "choice", "stop", "emergency")
    }
    assert (said["/follower/wrench"], said["/follower/space"], said["/follower/field"]) == ("tip", "world", "fixture")
    headers = defaultdict(set)
    for channel, _, message in decoded(path):
        if hasattr(message, "header"):
            headers[channel.topic].add(message.header.frame_id)
    assert len(headers) >= 5
    assert all(names == {said[topic]} for topic, names in headers.items())


def test_the_index_serves_tools_that_seek(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 300)
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        counted = Counter(
            channel.topic for _, channel, _ in reader.iter_messages(starting_at=100_000_000, ending_before=200_000_000)
        )
    assert summary.statistics.channel_message_counts
    assert all(schema.encoding == "ros2msg" for schema in summary.schemas.values())
    assert all(channel.message_encoding == "cdr" for channel in summary.channels.values())
    for topic in ("/follower/state", "/leader/state", "/follower/wrench", "/leader/joint_states"):
        assert counted[topic] == 100


def test_equal_sessions_give_equal_bytes(tmp_path):
    for name in ("a.mcap", "b.mcap"):
        made.write_session(tmp_path / name, 400, {"late": 2})
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


@pytest.mark.parametrize("flushed", [1, 2500, pytest.param(12_000, marks=pytest.mark.long)])
@pytest.mark.first
def test_a_killed_writer_leaves_what_was_flushed(tmp_path, flushed):
    path = tmp_path / "session.mcap"
    command = [sys.executable, made.__file__, str(path), str(flushed)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"flushed\n"
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    log = read_session(path)
    assert log.counts == {"truncated": 1}
    ticks = range(1, flushed + 1)
    whole = SessionLog.from_messages(one for tick in ticks for one in (made.leader_state(tick), made.telemetry(tick)))
    assert_same(log, whole)


@pytest.mark.long
def test_a_file_cut_anywhere_gives_a_beginning_of_the_session(tmp_path):
    path, cut = tmp_path / "session.mcap", tmp_path / "cut.mcap"
    made.write_session(path, 300, {"late": 1})
    content = path.read_bytes()
    expected = expected_log(300)
    lengths, refusals = set(), set()
    for length in [*range(0, 64, 3), *range(64, len(content), 823), *range(len(content) - 40, len(content), 3)]:
        cut.write_bytes(content[:length])
        try:
            log = read_session(cut)
        except RecordingError as error:
            refusals.add(str(error).removeprefix(f"{cut}: "))
            continue
        assert log.counts["truncated"] == 1
        lengths.add(log.follower.size)
        assert log.follower.tobytes() == expected.follower[: log.follower.size].tobytes()
        assert log.leader.tobytes() == expected.leader[: log.leader.size].tobytes()
    assert max(lengths) == 300
    assert len(lengths) > 2
    assert refusals == {"was cut off before anything was flushed"}


def test_a_tail_that_was_never_written_counts_as_cut(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 100)
    content = path.read_bytes()
    end = content.index(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")  # the end of the data section
    path.write_bytes(content[:end] + bytes(4096))
    log = read_session(path)
    assert log.counts == {"truncated": 1}
    assert log.follower.size == 100


@pytest.mark.usefixtures("read_apart")
def test_bytes_that_changed_give_one_line_or_a_session(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 60, {"late": 1})
    content, draw = path.read_bytes(), random.Random(1)
    refused = 0
    for _ in range(60):
        changed = bytearray(content)
        for _ in range(3):
            changed[draw.randrange(8, len(content))] = draw.randrange(256)
        path.write_bytes(changed)
        try:
            read_session(path)
        except RecordingError as error:
            refused += "\n" not in str(error)
    assert refused > 15


def foreign(path, topic, type_name, schema):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        number = writer.register_schema(type_name, "ros2msg", schema.encode())
        channel = writer.register_channel(topic, "cdr", number)
        writer.add_message(channel, 1, HEADER + bytes(8), 1)
        writer.finish()


def test_other_mcap_files_are_refused(tmp_path):
    path = tmp_path / "other.mcap"
    state, model = TOPICS[Telemetry], TOPICS[ModelUpdate]
    for topic, type_name, schema, output in (
        ("/chatter", "std_msgs/msg/Int64", "int64 data\n", "holds no foretouch session; its topics: /chatter"),
        (state.name, state.type_name, "int64 version\n", "/follower/state has other fields than this version"),
        (state.name, state.type_name, state.layout.schema, r"/follower/state: a message is not \d+ bytes long"),
        (model.name, model.type_name, model.layout.schema, "/follower/model: not a ModelUpdate"),
    ):
        foreign(path, topic, type_name, schema)
        with pytest.raises(RecordingError, match=output):
            read_session(path)
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        read_session(tmp_path / "absent.mcap")


def test_a_session_copied_without_blocks_reads_the_same(tmp_path):
    path, copy = tmp_path / "session.mcap", tmp_path / "copy.mcap"
    made.write_session(path, 60)
    assert_same(read_session(copy_of(path, copy, use_chunking=False)), expected_log(60))


def test_a_session_with_nothing_said(tmp_path):
    path = tmp_path / "session.mcap"
    with SessionWriter(path) as writer:
        writer.close({"late": 4})
    log = read_session(path)
    assert (log.leader.size, log.follower.size, log.models, log.settings) == (0, 0, (), {})
    assert log.counts == {"late": 4}
    with pytest.raises(RecordingError, match="0 samples of the follower: at least 2"):
        read_recording(path)


def pressing(tick):
    position = tick * 1e-5
    return Telemetry(VERSION, tick, 10**12 + tick * 10**6, tick, 0, position, 0, 5.5, 5, 4, True, False, 0, 0, 0)


def test_the_follower_of_a_session_is_a_recording(tmp_path):
    path = tmp_path / "session.mcap"
    with SessionWriter(path) as writer:
        for tick in range(1, 101):
            writer.write(pressing(tick), tick)
    recording = read_recording(path)
    assert recording.time.tolist() == [tick * 10**6 / 1e9 for tick in range(100)]
    assert recording.position.tolist() == [tick * 1e-5 for tick in range(1, 101)]
    assert set(recording.force.tolist()) == {5.5}
    assert recording.velocity is None
    assert recording.contact_floor == 0.05
    assert (read_recording(path, flip=True).position == -recording.position).all()


def test_a_telemetry_tick_that_comes_twice_is_named(tmp_path):
    path = tmp_path / "session.mcap"
    with SessionWriter(path) as writer:
        for tick in (1, 2, 2):
            writer.write(pressing(tick), tick)
    with pytest.raises(RecordingError, match=r"sample 2: time 0\.001 s does not come after"):
        read_recording(path)


def test_every_message_of_the_schema_can_be_recorded(tmp_path):
    assert set(TOPICS) == {channel.kind for channel in CHANNELS.values()} | {FollowerRow, LeaderRow}
    path = tmp_path / "session.mcap"
    with SessionWriter(path) as writer:
        writer.write(Handle(VERSION, 1, 2**63 - 1, 0.5, True), 3)
        writer.write(msgspec.structs.replace(made.telemetry(1), time_ns=2**63 - 1, sequence=2**40), 3)
    got = {channel.topic: message for channel, _, message in decoded(path)}
    assert (got["/console/handle"].position, got["/console/handle"].held) == (0.5, True)
    assert got["/follower/wrench"].header.stamp.sec == 2**31 - 1
    assert read_session(path).follower["sequence"].tolist() == [2**40]


def test_the_schema_follows_the_fields():
    class Extended(Telemetry, frozen=True, array_like=True, gc=False):
        temperature: float = 0.0
        note: str = ""

    layout = Layout(Extended)
    assert layout.dtype is None
    assert layout.schema.endswith("int64 epoch\nint64 run\nfloat64 temperature\nstring note\n")
    message = Extended(*msgspec.structs.astuple(made.telemetry(3)), 36.5, "warm")
    assert bits(msgspec.structs.astuple(layout.unpack(layout.pack(message)))) == bits(msgspec.structs.astuple(message))

    class Unknown(Message, frozen=True, array_like=True, gc=False):
        table: dict[str, int]

    with pytest.raises(TypeError, match=r"Unknown\.table has a type without a ROS 2 counterpart"):
        Layout(Unknown)


texts = st.text(max_size=12)
floats = st.lists(st.floats(width=64), max_size=5).map(tuple)
models = st.builds(
    ModelUpdate,
    version=st.just(VERSION),
    sequence=st.integers(0, 2**32 - 1),
    time_ns=st.integers(0, 2**63 - 1),
    command_sequence=st.integers(0, 2**63 - 1),
    law=texts,
    parameters=floats,
    state=floats,
    surface=st.floats(width=64),
    valid=st.booleans(),
    reason=texts,
    estimator=texts,
)


@given(models)
def test_text_and_sequences_pack_as_another_reader_expects(tmp_path_factory, message):
    layout = TOPICS[ModelUpdate].layout
    values = bits(msgspec.structs.astuple(message))
    assert bits(msgspec.structs.astuple(layout.unpack(layout.pack(message)))) == values
    path = tmp_path_factory.mktemp("model") / "m.mcap"
    with SessionWriter(path) as writer:
        writer.write(message, 1)
    got = {channel.topic: message for channel, _, message in decoded(path)}["/follower/model"]
    assert bits([getattr(got, name) for name in ModelUpdate.__struct_fields__]) == values


def test_a_file_that_cannot_be_written_gives_one_line(tmp_path):
    with pytest.raises(RecordingError, match="cannot be written: No such file or directory"):
        SessionWriter(tmp_path / "absent" / "session.mcap")
    if Path("/dev/full").exists():
        with pytest.raises(RecordingError, match="/dev/full: cannot be written: No space left on device"):
            SessionWriter("/dev/full")


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(MissingExtraError, match=r"mcap is not installed: pip install .*\[recordings\]'"):
        SessionWriter(tmp_path / "session.mcap")
    assert not Path(tmp_path / "session.mcap").exists()


@pytest.mark.long
def test_a_minute_reads_in_seconds(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 10_000)
    start = time.process_time()
    log = read_session(path)
    assert time.process_time() - start < 0.75  # a sixth of a minute; 0.08 s on an idle machine
    assert log.follower.size == 10_000

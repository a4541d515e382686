import json
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
import session_messages as made
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import RecordingError
from foretouch.messages import VERSION, LeaderState, Telemetry
from foretouch.recordings import SessionWriter, is_whole, read_session, repair_session
from foretouch.recordings.formats.cdr import Layout
from foretouch.recordings.formats.topics import TOPICS


def small_session(folder):
    path = folder / "session.mcap"
    with SessionWriter(path) as writer:
        for number, (message, log_time_ns) in enumerate(made.session(60)):
            writer.write(message, log_time_ns)
            if number % 25 == 0:
                writer.flush()
        writer.close({"late": 1})
    return path


class Content(bytes):
    """Bytes of a file that nobody wants to see in a message."""

    def __repr__(self):
        return f"<{len(self)} bytes>"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """The bytes of a small session of several blocks."""
    return Content(small_session(tmp_path_factory.mktemp("session")).read_bytes())


def by_topic(path):
    """What the library's own reader finds by the index, and that the index is the whole truth."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        counted = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        summary = reader.get_summary()
        assert summary.statistics.message_count == counted.total()
        assert summary.statistics.chunk_count == len(summary.chunk_indexes)
        per_channel = summary.statistics.channel_message_counts
        assert {summary.channels[number].topic: count for number, count in per_channel.items()} == counted
        within = [index for index in summary.chunk_indexes if index.message_start_time <= 30_000_000]
        seen = Counter(channel.topic for _, channel, _ in reader.iter_messages(ending_before=30_000_001))
        assert bool(seen) == bool(within)
    return dict(counted)


def check_a_cut(content, length, folder):
    """Cut, read, mend, read again."""
    path = folder / "cut.mcap"
    path.write_bytes(content[:length])
    if length < len(content):
        assert not is_whole(path)
    try:
        before = read_session(path)
    except RecordingError:
        with pytest.raises(RecordingError, match="was cut off before anything was flushed"):
            read_session(path)
        with pytest.raises(RecordingError, match="nothing to keep"):
            repair_session(path)
        assert path.read_bytes() == content[:length]
        return 0
    assert before.counts["truncated"] == 1
    result = repair_session(path)
    after = read_session(path)
    assert is_whole(path)
    assert not result.was_whole
    assert result.damaged_blocks == 0
    assert result.messages == by_topic(path)
    assert after.follower.tobytes() == before.follower.tobytes()
    assert after.leader.tobytes() == before.leader.tobytes()
    assert [model.sequence for model in after.models] == [model.sequence for model in before.models]
    assert result.bytes_kept + result.bytes_cut <= length
    assert repair_session(path).was_whole
    assert [entry.name for entry in folder.iterdir()] == [path.name]
    return after.follower.size


@pytest.mark.long
def test_a_file_cut_at_every_so_many_bytes_becomes_whole(session, tmp_path):
    sizes = [check_a_cut(session, length, tmp_path) for length in range(0, len(session), 149)]
    assert sorted(sizes) == sizes
    assert len(set(sizes)) >= 5
    assert sizes[-1] == 60


@settings(max_examples=15)
@given(st.integers(0, 10**6))
def test_a_file_cut_anywhere_becomes_whole(session, tmp_path_factory, place):
    check_a_cut(session, place % len(session), tmp_path_factory.mktemp("cut"))


def test_a_whole_file_stays_as_it_is_and_its_copy_is_the_same(session, tmp_path):
    path, copy = tmp_path / "session.mcap", tmp_path / "copy.mcap"
    path.write_bytes(session)
    before = path.stat()
    assert repair_session(path).was_whole
    assert path.stat() == before
    assert repair_session(path, copy).was_whole
    assert copy.read_bytes() == session


def test_a_file_of_which_only_the_index_is_missing_has_all_its_counters(session, tmp_path):
    path = tmp_path / "session.mcap"
    path.write_bytes(session[:-20])
    result = repair_session(path)
    assert (result.was_whole, result.bytes_cut) == (False, 0)
    assert path.read_bytes() == session
    assert read_session(path).counts == {"late": 1}


def test_a_damaged_block_is_left_out_and_the_others_stay(session, tmp_path):
    """The first block too: each says by itself what its messages are."""
    path, mended = tmp_path / "session.mcap", tmp_path / "mended.mcap"
    path.write_bytes(session)
    total = sum(by_topic(path).values())
    for share in (0.05, 0.3, 0.5, 0.7):
        changed = bytearray(session)
        inside = session.index(b"\x04\x22\x4d\x18", int(share * len(session)))  # where LZ4 begins
        changed[inside + 200] ^= 0xFF
        path.write_bytes(changed)
        with pytest.raises(RecordingError, match=r"is damaged: .*; `foretouch recordings repair` keeps the others"):
            read_session(path)
        result = repair_session(path, mended)
        log = read_session(mended)
        assert result.damaged_blocks == 1
        assert result.messages == by_topic(mended)
        assert 30 < log.follower.size <= 60
        assert sum(result.messages.values()) < total
        assert "truncated" not in log.counts
        assert path.read_bytes() == changed


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4))
@example([(0, 0)])
def test_bytes_that_changed_give_one_line_or_a_whole_file(session, tmp_path_factory, changes):
    path = tmp_path_factory.mktemp("changed") / "session.mcap"
    changed = bytearray(session)
    for place, value in changes:
        changed[place % len(changed)] = value
    path.write_bytes(changed)
    output, result = "", None
    try:
        result = repair_session(path)
    except RecordingError as error:
        output = str(error)
    assert "\n" not in output
    if result is None:
        return
    if not result.was_whole:
        by_topic(path)
        assert is_whole(path)
    read_session(path)


def test_refusals_say_what_and_leave_everything_as_it_was(session, tmp_path):
    empty, other, cut = tmp_path / "empty.mcap", tmp_path / "press.csv", tmp_path / "cut.mcap"
    empty.write_bytes(b"")
    other.write_text("time_s,position_m,force_N\n")
    cut.write_bytes(session[: len(session) // 2])
    for path in (empty, other):
        with pytest.raises(RecordingError, match="is not an MCAP file, or was cut before anything was flushed"):
            repair_session(path)
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        repair_session(tmp_path / "absent.mcap")
    with pytest.raises(RecordingError, match=r"absent/out\.mcap: cannot be written: No such file or directory"):
        repair_session(cut, tmp_path / "absent" / "out.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut.mcap", "empty.mcap", "press.csv"]
    assert cut.read_bytes() == session[: len(session) // 2]


def limited(limit, call, path):
    """What a call prints of its error under a real limit on the size of files, in a process of its own."""
    code = (
        "import resource, sys\n"
        f"sys.path.insert(0, {str(Path(made.__file__).parent)!r})\n"
        "from foretouch.recordings import repair_session\n"
        "from session_messages import write_session\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))\n"
        f"try:\n    {call}\n"
        "except Exception as error:\n    print(type(error).__name__, error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    return done.stdout


def test_no_room_for_the_mended_file_leaves_the_cut_one(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 2000)
    content = path.read_bytes()[:-3000]
    path.write_bytes(content)
    output = limited(100_000, "repair_session(sys.argv[1])", path)
    assert output == f"RecordingError {path}: cannot be written: File too large\n"
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


# --- the writer on a disk that fills up -------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [50_000, 100_001, pytest.param(200_000, marks=pytest.mark.long)])
@pytest.mark.first
def test_a_full_disk_leaves_a_whole_file(tmp_path, limit):
    path = tmp_path / "session.mcap"
    output = limited(limit, "write_session(sys.argv[1], 2000)", path)
    assert output == f"RecordingError {path}: cannot be written: File too large\n"
    log = read_session(path)
    assert log.counts == {"truncated": 1}
    expected = [made.telemetry(tick).time_ns for tick in range(1, 2001)]
    assert log.follower["time_ns"].tolist() == expected[: log.follower.size]
    assert log.follower.size > limit // 1000
    if is_whole(path):  # there was room for the index too
        by_topic(path)
    else:
        assert repair_session(path).bytes_cut == 0


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_command_says_what_was_cut_and_what_there_is(session, tmp_path):
    path, mended = tmp_path / "session.mcap", tmp_path / "mended.mcap"
    path.write_bytes(session[: len(session) // 2])
    result = CliRunner().invoke(app, ["recordings", "repair", str(path), "--output", str(mended), "--json"])
    assert result.exit_code == 0
    matches = json.loads(result.stdout)
    assert matches["path"] == str(mended)
    assert matches["bytes_cut"] > 0
    assert matches["messages"] == by_topic(mended)
    text = CliRunner().invoke(app, ["recordings", "repair", str(path)]).stdout
    assert f"{path}: {matches['bytes_cut']} bytes cut behind the last whole block; no block was damaged" in text
    assert f"{path}: holds {matches['duration']:.3f} s in " in text
    assert f"{path}: is whole\n" in CliRunner().invoke(app, ["recordings", "repair", str(path)]).stdout


@pytest.mark.long
def test_the_report_of_a_cut_session_names_the_command(tmp_path):
    path = tmp_path / "session.mcap"
    run = ["simulate", "--duration", "2", "--material", "hunt-crossley", "--recording", str(path), "--json"]
    assert CliRunner().invoke(app, run).exit_code == 0
    path.write_bytes(path.read_bytes()[:-20_000])
    line = f"{path}: was not ended by its recorder; read as far as it goes; `foretouch recordings repair {path}` makes"
    for command in ("report", "predict", "identify"):
        result = CliRunner().invoke(app, [command, str(path), "--json"])
        assert result.exit_code == 0
        assert result.stderr.count(line) == 1
        assert json.loads(result.stdout)
    assert CliRunner().invoke(app, ["recordings", "repair", str(path)]).exit_code == 0
    after = CliRunner().invoke(app, ["report", str(path), "--json"])
    assert f"{path}: ends before its session did" in after.stderr
    assert json.loads(after.stdout)["counts"]["truncated"] == 1


# --- fields that come and go ------------------------------------------------------------------------------------------


class WithMore(Telemetry, frozen=True, array_like=True, gc=False):
    """Telemetry of a later version."""

    tomorrow: float = 0.5


def write_as(path, layout, names, messages):
    """A recording by a version whose telemetry has these fields; its schema says so."""
    topic = TOPICS[Telemetry]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = "".join(line + "\n" for line in layout.schema.splitlines() if line.split()[1] in names)
        number = writer.register_schema(topic.type_name, "ros2msg", schema.encode())
        channel = writer.register_channel(topic.name, "cdr", number)
        older = msgspec.defstruct(
            "Older",
            [(field.name, field.type) for field in msgspec.structs.fields(layout.kind) if field.name in names],
        )
        pack = Layout(older).pack
        for message in messages:
            values = {name: getattr(message, name) for name in names}
            writer.add_message(channel, message.sequence, pack(older(**values)), message.time_ns)
        writer.finish()


def test_a_recording_without_a_newer_field_has_its_default(tmp_path):
    path = tmp_path / "older.mcap"
    names = [name for name in Telemetry.__struct_fields__ if name not in ("guarded", "space")]
    sent = [made.telemetry(tick) for tick in range(1, 31)]
    write_as(path, TOPICS[Telemetry].layout, names, sent)
    log = read_session(path)
    assert not log.follower["guarded"].any()
    for name in names[1:]:
        np.testing.assert_array_equal(log.follower[name], [getattr(message, name) for message in sent])


def test_a_field_that_is_not_known_here_is_passed_over(tmp_path):
    path = tmp_path / "later.mcap"
    sent = [WithMore(*msgspec.structs.astuple(made.telemetry(tick)), tomorrow=tick) for tick in range(1, 31)]
    write_as(path, Layout(WithMore), [name for name in WithMore.__struct_fields__ if name != "space"], sent)
    log = read_session(path)
    assert log.follower["sequence"].tolist() == list(range(1, 31))
    assert log.follower["model_sequence"].tolist() == [message.model_sequence for message in sent]


def test_every_field_of_both_sides_reads_back(tmp_path):
    """Whatever fields there are: each gets a value of its own that is not its default."""
    path = tmp_path / "session.mcap"
    with SessionWriter(path) as writer:
        for kind in (Telemetry, LeaderState):
            described = msgspec.inspect.type_info(kind).fields
            values = {
                field.name: True if isinstance(field.type, msgspec.inspect.BoolType) else number + 1
                for number, field in enumerate(described)
                if field.name != "space"
            }
            message = kind(**{**values, "version": VERSION})
            writer.write(message, 1)
    log = read_session(path)
    for table in (log.follower, log.leader):
        for number, name in enumerate(table.dtype.names, 2):
            assert table[name][0] == (1 if table.dtype[name].kind == "b" else number)


def test_a_version_that_lacks_what_is_needed_is_refused(tmp_path):
    path = tmp_path / "foreign.mcap"
    names = [name for name in Telemetry.__struct_fields__ if name not in ("sensor_force", "space")]
    write_as(path, TOPICS[Telemetry].layout, names, [made.telemetry(1)])
    with pytest.raises(RecordingError, match="/follower/state has other fields than this version"):
        read_session(path)


def test_repair_is_quick(tmp_path):
    path = tmp_path / "session.mcap"
    made.write_session(path, 5000)
    path.write_bytes(path.read_bytes()[:-5000])
    start = time.process_time()
    repair_session(path)
    assert time.process_time() - start < 1.0  # 5 s of session; 0.05 s on an idle machine

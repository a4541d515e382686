"""Bags of others: rosbag2 in both storages and foreign MCAP, by a map and by a guess."""

import re
import shutil

import numpy as np
import pytest
from made_bags import (
    BEGIN,
    JOINT,
    LEVER,
    MAP,
    POSE,
    TYPES,
    WRENCH,
    copy_of,
    joint,
    pose,
    press,
    press_messages,
    wrench,
    write_bag,
)  # fmt: skip
from mcap.writer import Writer as McapWriter
from refusals import refused
from rosbags.rosbag2 import StoragePlugin

from foretouch.errors import RecordingError
from foretouch.recordings import inspect_recording, open_source, read_recording, read_with_notes

STORAGES = pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])


@pytest.fixture
def by_map(tmp_path):
    def write(text=MAP):
        path = tmp_path / "map.toml"
        path.write_text(text)
        return path

    return write


@STORAGES
@pytest.mark.parametrize("single", [False, True], ids=["folder", "file"])
@pytest.mark.parametrize("order", ["little", "big"])
def test_every_number_of_a_bag_is_read(tmp_path, by_map, plugin, single, order):
    bag = write_bag(tmp_path / "bag", press_messages(), plugin=plugin, order=order)
    path = next(file for file in bag.iterdir() if file.suffix != ".yaml") if single else bag
    time, position, force = press()
    recording = read_recording(path, map_file=by_map())
    assert recording.time.tobytes() == time.tobytes()
    assert recording.position.tobytes() == (position / LEVER * LEVER).tobytes()
    assert recording.force.tobytes() == force.tobytes()


def test_interpolation_and_hold_against_their_definitions(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages(every=5))
    time, position, force = press()
    known, at = time[::5], time[: time.size - 4]
    positions = position[::5] / LEVER * LEVER
    read = read_with_notes(bag, map_file=by_map())
    np.testing.assert_allclose(read.recording.position, np.interp(at, known, positions), rtol=1e-12)
    assert read.recording.force.tobytes() == force[: at.size].tobytes()
    assert any("interpolated to the times of forces" in note for note in read.notes)
    assert any("4 forces before the first or after the last" in note for note in read.notes)
    held = read_with_notes(bag, map_file=by_map('join = "hold"\n' + MAP))
    assert held.recording.position.tobytes() == positions[np.arange(at.size) // 5].tobytes()
    assert any("causal" in note for note in held.notes)


def test_two_clocks_are_named_with_their_distance(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages(stamps_off=-3_200_000_000))
    time, _, force = press()
    read = read_with_notes(bag, map_file=by_map())
    assert "two clocks 3.2 s apart" in read.notes[0]
    assert "begin 3.2 s apart: two clocks?" in inspect_recording(bag).notes[0]
    assert "log time is taken for both" in read.notes[0]
    assert read.recording.force.tobytes() == force.tobytes()
    assert read.recording.time.tobytes() == time.tobytes()
    asked = refused(bag, map_file=by_map('[time]\nstamp = "header"\n' + MAP))
    assert "no time in common" in asked
    assert 'give [time] stamp = "aligned" or "log"' in asked


def test_one_clock_away_from_the_recorder_is_said_and_taken(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages(late=37 * 10**9))
    read = read_with_notes(bag, map_file=by_map())
    assert any("37 s apart; header stamps are taken" in note for note in read.notes)
    assert read.recording.position.size == press()[0].size


def test_messages_without_a_stamp_take_log_time(tmp_path, by_map):
    messages = [
        ("/x", "std_msgs/msg/Float64", BEGIN + tick * 10**6, TYPES["std_msgs/msg/Float64"](data=tick * 1e-5))
        for tick in range(100)
    ] + [("/ft", WRENCH, BEGIN + tick * 10**6, wrench(BEGIN, tick)) for tick in range(100)]
    bag = write_bag(tmp_path / "bag", messages)
    text = MAP.replace("/joint_states", "/x").replace("position[0]", "data").replace("scale = 0.075\n", "")
    read = read_with_notes(bag, map_file=by_map(text.replace('"rad"', '"m"')))
    assert "messages of /x carry no stamp: log time is taken for both" in read.notes[0]
    assert read.recording.position.tolist() == [tick * 1e-5 for tick in range(100)]
    asked = refused(bag, map_file=by_map('[time]\nstamp = "header"\n' + text.replace('"rad"', '"m"')))
    assert "messages of /x carry no stamp" in asked


def test_joints_are_found_by_name_whoever_publishes_and_in_which_order(tmp_path, by_map):
    def messages():
        for tick in range(60):
            ns = BEGIN + tick * 10**6
            names = [("hand", "elbow"), ("elbow", "hand", "wrist"), ("wrist",)][tick % 3]
            values = {"hand": 9.0, "wrist": 8.0, "elbow": tick * 1e-3}
            frame = "f" * (1 + tick % 7)
            yield "/joint_states", JOINT, ns, joint(ns, [values[name] for name in names], names, frame=frame)
            yield "/ft", WRENCH, ns, wrench(ns, tick, frame)

    bag = write_bag(tmp_path / "bag", messages())
    text = MAP.replace("position[0]", "position[elbow]").replace('"rad"\nscale = 0.075', '"m"')
    read = read_with_notes(bag, map_file=by_map(text))
    assert "20 messages of /joint_states without these fields were left out" in read.notes[0]
    ticks = np.arange(59)
    known = np.array([tick for tick in range(60) if tick % 3 != 2])
    expected = np.interp(ticks, known, known * 1e-3)
    np.testing.assert_allclose(read.recording.position, expected, rtol=0, atol=1e-12)


def test_many_lengths_of_texts_are_read(tmp_path, by_map):
    """More layouts than are gathered: the rest goes message by message, with the same numbers."""

    def messages():
        for tick in range(300):
            ns = BEGIN + tick * 10**6
            yield "/joint_states", JOINT, ns, joint(ns, [tick * 1e-3], frame="a" * (tick % 130))
            yield "/ft", WRENCH, ns, wrench(ns, tick)

    bag = write_bag(tmp_path / "bag", messages())
    recording = read_recording(bag, map_file=by_map(MAP.replace('"rad"\nscale = 0.075', '"m"')))
    assert recording.position.tolist() == [tick * 1e-3 for tick in range(300)]


def test_a_measured_velocity_is_read_in_the_position_s_unit(tmp_path, by_map):
    messages = []
    for tick in range(10):
        ns = BEGIN + tick * 10**6
        messages.append(("/joint_states", JOINT, ns, joint(ns, [tick * 1e-3], velocities=[1.0 + tick])))
        messages.append(("/ft", WRENCH, ns, wrench(ns, tick)))
    bag = write_bag(tmp_path / "bag", messages)
    recording = read_recording(bag, map_file=by_map(MAP + '\n[velocity]\nfield = "velocity[0]"\n'))
    assert recording.velocity.tolist() == [(1.0 + tick) * 0.075 for tick in range(10)]


def test_what_is_wrong_with_a_bag_is_said_in_one_line(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages(0.1), topics=[("/silent", WRENCH)])
    for old, new, output in (
        ('"/ft"', '"/fd"', "no topic /fd; there are /silent, /joint_states, /ft"),
        ("wrench.force.z", "force.z", r"/ft \(geometry_msgs/msg/WrenchStamped\) has no number force.z; it has header"),
        ("position[0]", "position[3]", r"has no number position\[3\]"),
        ('"/ft"', '"/silent"', "/silent has no messages"),
    ):
        assert re.search(output, refused(bag, map_file=by_map(MAP.replace(old, new))))
    assert "takes topic and field, not column" in refused(
        bag, map_file=by_map('[time]\ncolumn="t"\n[position]\ncolumn="x"\nunit="m"\n[force]\ncolumn="f"\nunit="N"\n')
    )
    assert "unit of the position /joint_states position[0] is not known" in refused(bag)
    nan = write_bag(tmp_path / "nan", [*press_messages(0.1), ("/ft", WRENCH, BEGIN + 10**9, wrench(BEGIN, np.nan))])
    assert "/ft: wrench.force.z of message 101 is nan: every value must be finite" in refused(nan, map_file=by_map())
    empty = write_bag(tmp_path / "empty", [], topics=[("/ft", WRENCH)])
    assert "holds no messages" in refused(empty)
    assert "/ft has no messages" in refused(empty, map_file=by_map(MAP.replace("/joint_states", "/ft")))
    (tmp_path / "plain").mkdir()
    assert "folder without metadata.yaml" in refused(tmp_path / "plain")


def test_a_guess_needs_no_map_where_types_tell(tmp_path):
    def messages():
        for tick in range(100):
            ns = BEGIN + tick * 10**6
            yield "/tool", POSE, ns, pose(ns, z=tick * 1e-4)
            yield "/ft", WRENCH, ns, wrench(ns, -float(tick > 80))

    read = read_with_notes(write_bag(tmp_path / "bag", messages()))
    assert 'topic = "/tool"; field = "pose.position.z"; unit = "m"' in read.notes[0]
    assert read.recording.position.tolist() == [tick * 1e-4 for tick in range(100)]
    assert any("[force] sign = -1" in note for note in read.notes)


def test_signs_that_look_wrong_are_said(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages())
    output = {}
    for position in (1, -1):
        for force in (1, -1):
            signs = f"\nsign = {position}\n[force]\nsign = {force}\n"
            notes = read_with_notes(bag, map_file=by_map(MAP.replace("\n[force]\n", signs))).notes
            output[position, force] = [note.split(":")[0] for note in notes]
    shrink, negative = "positions shrink as the force grows", "forces are mostly negative"
    assert output == {(1, 1): [], (-1, 1): [shrink], (1, -1): [negative], (-1, -1): [negative, shrink]}


def test_several_sensors_are_not_chosen_from(tmp_path):
    several = [(f"/ft{place}", WRENCH, BEGIN + tick, wrench(BEGIN, 1.0)) for place in (1, 2) for tick in (1, 2)]
    bag = write_bag(tmp_path / "bag", [*several, *press_messages(0.01)])
    output = refused(bag)
    assert re.search(
        r"could be force: /ft wrench.force.z \(1000 a second\), /ft1 \S+ \(111.1 a second\), /ft2 ", output
    )


def outcome(path, map_file):
    """What is said of a recording: its length, or why it is refused."""
    try:
        return f"{len(read_recording(path, map_file=map_file))} samples"
    except RecordingError as error:
        return str(error)


@STORAGES
def test_a_bag_cut_anywhere_gives_one_line_or_a_recording(tmp_path, by_map, plugin):
    bag = write_bag(tmp_path / "bag", press_messages(0.5), plugin=plugin)
    file = next(file for file in bag.iterdir() if file.suffix != ".yaml")
    content, map_file = file.read_bytes(), by_map()
    for length in (0, 5, 100, len(content) // 3, len(content) // 2, len(content) - 20):
        file.write_bytes(content[:length])
        assert "\n" not in outcome(bag, map_file)
    (bag / "metadata.yaml").write_text("{")
    assert "is no rosbag2 that can be read" in refused(bag, map_file=map_file)


@pytest.mark.parametrize("options", [{}, {"use_chunking": False}, {"chunk_size": 1000}], ids=str)
def test_a_foreign_mcap_is_read_with_and_without_its_index(tmp_path, by_map, options):
    bag = write_bag(tmp_path / "bag", press_messages(0.5), plugin=StoragePlugin.MCAP)
    path = copy_of(next(bag.glob("*.mcap")), tmp_path / "foreign.mcap", **options)
    map_file = by_map()
    whole = read_recording(path, map_file=map_file)
    assert whole.force.tobytes() == press(0.5)[2].tobytes()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 3 // 10])
    if not options:  # one block, and that is cut
        assert "no topic /joint_states" in refused(path, map_file=map_file)
        return
    cut = read_with_notes(path, map_file=map_file)
    assert "was not ended by its recorder; read as far as it goes" in cut.notes[0]
    assert 10 < len(cut.recording) < len(whole)
    assert cut.recording.force.tobytes() == whole.force[: len(cut.recording)].tobytes()


def test_a_damaged_block_is_named(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages(0.5), plugin=StoragePlugin.MCAP)
    path = copy_of(next(bag.glob("*.mcap")), tmp_path / "foreign.mcap", chunk_size=1000)
    content = bytearray(path.read_bytes())
    content[500:5000:50] = bytes(byte ^ 0xFF for byte in content[500:5000:50])
    path.write_bytes(content)
    assert re.search(r"the (block|record) at byte \d+ is damaged", refused(path, map_file=by_map()))


def test_other_encodings_and_unknown_types_are_refused(tmp_path, by_map):
    def foreign(encoding, schema_encoding, text):
        path = tmp_path / "foreign.mcap"
        with path.open("wb") as file:
            writer = McapWriter(file)
            writer.start()
            for topic in ("/joint_states", "/ft"):
                number = writer.register_schema("robot_msgs/msg/Thing", schema_encoding, text)
                channel = writer.register_channel(topic, encoding, number)
                writer.add_message(channel, 1, b"\0\1\0\0" + bytes(8), 1)
            writer.finish()
        return path

    assert "are json: only CDR of ROS 2 is read" in refused(foreign("json", "jsonschema", b"{}"), map_file=by_map())
    assert "holds no definition of robot_msgs/msg/Thing" in refused(foreign("cdr", "ros2msg", b""), map_file=by_map())
    assert "cannot be parsed" in refused(foreign("cdr", "ros2msg", b"what is this\n=="), map_file=by_map())
    path = foreign("cdr", "ros2msg", b"float64 q\n")
    assert "has no number position[0]; it has q" in refused(path, map_file=by_map())
    assert [column.name for column in open_source(path).fields("/ft")] == ["q"]


def test_a_bag_of_thousands_of_topics_is_looked_at_quickly(tmp_path):
    import time

    topics = [(f"/robot/part_{place}/state", JOINT) for place in range(3000)]
    path = tmp_path / "wide.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        text = b"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
        number = writer.register_schema(JOINT, "ros2msg", text)
        for topic, _ in topics:
            writer.add_message(writer.register_channel(topic, "cdr", number), 1, b"\0\1\0\0" + bytes(40), 1)
        writer.finish()
    begin = time.process_time()
    result = inspect_recording(path)
    assert time.process_time() - begin < 8.0
    assert len(result.topics) == 3000
    assert result.guess.open


def test_bags_in_a_folder_named_like_a_file(tmp_path, by_map):
    bag = write_bag(tmp_path / "bag", press_messages(0.1))
    shutil.move(bag, tmp_path / "press.mcap")
    assert len(read_recording(tmp_path / "press.mcap", map_file=by_map())) == 100

"""Which topic and axis of a bag is taken: by types and rates; and two clocks that are nearly one."""

import re

import numpy as np
import pytest
from made_bags import (
    BEGIN,
    JOINT,
    MAP,
    POSE,
    STORE,
    TYPES,
    WRENCH,
    header,
    joint,
    pose,
    press,
    press_messages,
    wrench,
    write_bag,
)  # fmt: skip
from refusals import refused
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import Reader, StoragePlugin, Writer, reader, storage_mcap, storage_sqlite3

from foretouch.recordings import inspect_recording, inspection, open_source, read_with_notes


def wrench_along(ns, x, y, z):
    vector = TYPES["geometry_msgs/msg/Vector3"]
    return TYPES[WRENCH](header(ns), TYPES["geometry_msgs/msg/Wrench"](vector(x, y, z), vector(0.0, 0.0, 0.0)))


def times(rate, seconds=2.0):
    return [BEGIN + round(tick * 1e9 / rate) for tick in range(round(seconds * rate))]


def pressed(seconds=2.0, *, position="/tool/pose", force="/ft/wrench"):
    _, depth, forces = press(seconds)
    for tick, at in enumerate(times(1000, seconds)):
        if tick % 10 == 0:
            yield position, POSE, at, pose(at, z=depth[tick])
        yield force, WRENCH, at, wrench(at, forces[tick])


@pytest.mark.parametrize("name", ["/stage/z", "/stage/position", "/a/d"])
def test_a_slow_topic_is_not_taken_for_its_name(tmp_path, name):
    slow = [(name, POSE, at, pose(at, z=0.4)) for at in times(1)]
    bag = write_bag(tmp_path / "bag", [*slow, *pressed()])
    read = read_with_notes(bag)
    assert 'topic = "/tool/pose"' in read.notes[0]
    output = (
        "position is /tool/pose pose.position.z (99.55 a second), for no other topic of such messages comes 20 times"
    )
    assert any(note.startswith(output) and note.endswith(f": not {name}") for note in read.notes)
    result = inspect_recording(bag)
    assert result.guess.position.topic == "/tool/pose"
    assert not result.guess.open
    assert f"# {output}" in result.guess.text()


@pytest.mark.parametrize("name", ["/object/pose", "/object/position", "/object/z"])
def test_a_word_in_a_name_does_not_decide_between_two_as_fast(tmp_path, name):
    other = [(name, POSE, at, pose(at, z=0.4)) for at in times(60)]
    output = refused(write_bag(tmp_path / "bag", [*other, *pressed()]))
    assert f"several topics could be position: /tool/pose pose.position.z (99.55 a second), {name} pose" in output
    assert "(59.53 a second)" in output


def test_a_letter_makes_no_number_a_position(tmp_path):
    kind = "std_msgs/msg/Float64"
    bare = [("/robot/x", kind, at, TYPES[kind](data=0.1)) for at in times(100)]
    forces = [("/ft", WRENCH, at, wrench(at, 1.0)) for at in times(100)]
    assert "no topic has messages of a type with a position" in refused(write_bag(tmp_path / "bag", [*bare, *forces]))
    named = [("/robot/depth", *rest) for _, *rest in bare]
    assert "unit of the position /robot/depth data is not known" in refused(
        write_bag(tmp_path / "named", [*named, *forces])
    )


def test_rare_positions_are_no_guess_and_a_warning_by_a_map(tmp_path):
    forces = [("/ft", WRENCH, at, wrench(at, 1.0 + tick % 7)) for tick, at in enumerate(times(1000))]
    bag = write_bag(
        tmp_path / "bag", [*forces, *(("/tool", POSE, at, pose(at, z=1e-12 * (at - BEGIN))) for at in times(5))]
    )
    output = refused(bag)
    assert "position /tool pose.position.z comes 4.5 times a second: one that comes less often than 20" in output
    assert "--map" in output
    mapped = tmp_path / "map.toml"
    mapped.write_text(
        MAP.replace("/joint_states", "/tool").replace(
            'position[0]"\nunit = "rad"\nscale = 0.075', 'pose.position.z"\nunit = "m"'
        )
    )
    notes = read_with_notes(bag, map_file=mapped).notes
    assert any(
        "positions of /tool come 5 times a second: a press that is felt needs 20 or more" in note for note in notes
    )


def test_a_topic_that_is_there_for_a_part_of_the_time_counts_by_its_own_rate(tmp_path):
    late = [("/battery", "std_msgs/msg/Float64", BEGIN + 60 * 10**9, TYPES["std_msgs/msg/Float64"](data=1.0))]
    bag = write_bag(tmp_path / "bag", [*pressed(1.0), *late])
    assert not inspect_recording(bag).guess.open
    assert len(read_with_notes(bag).recording) == 991


def test_many_candidates_are_named_by_count_and_counted(tmp_path):
    messages = [
        (f"/part{place}/pose", POSE, BEGIN + tick * 10**6, pose(BEGIN + tick * 10**6))
        for place in range(80)
        for tick in range(10 + place)
    ]
    result = inspect_recording(write_bag(tmp_path / "bag", messages))
    (output,) = [problem for problem in result.guess.open if "position" in problem]
    first = [f"/part{place}/pose pose.position.z" for place in (79, 78, 77, 76, 75)]
    assert re.findall(r"/part\S+ pose.position.z", output) == first
    assert output.endswith("and 75 more")
    text = result.guess.text()
    assert [line for line in text.splitlines() if "could be" in line][1:] == [
        f"# position could be {one}" for one in first
    ]
    assert "# and 75 more" in text


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_bag_is_opened_once_and_closed_with_its_source(tmp_path, plugin, monkeypatch):
    bag = write_bag(tmp_path / "bag", [*pressed(0.2), *press_messages(0.1)], plugin=plugin)
    done = []
    for name in ("open", "close"):
        real = getattr(Reader, name)
        monkeypatch.setattr(Reader, name, lambda self, name=name, real=real: (done.append(name), real(self))[1])
    result = inspect_recording(bag, "/tool/pose")
    assert [column.name for column in result.columns][-1] == "pose.orientation.w"
    assert done == ["open", "close"]


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_equal_profiles_of_topics_are_parsed_once(tmp_path, plugin, monkeypatch):
    """By `rosbags` it takes seconds for thousands of topics."""
    endless = QosTime(2**31 - 1, 2**32 - 1)
    spans = (endless, endless, QosLiveliness.AUTOMATIC, endless)
    profiles = [
        Qos(QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE, QosDurability.VOLATILE, *spans, False)
        for depth in (1, 5)
    ]
    with Writer(tmp_path / "bag", version=8, storage_plugin=plugin) as writer:
        for place in range(20):
            own = [profiles[place % 2]]
            topic = writer.add_connection(f"/robot/{place}", WRENCH, typestore=STORE, offered_qos_profiles=own)
            writer.write(topic, BEGIN + place, STORE.serialize_cdr(wrench(BEGIN, place), WRENCH))
    parsed = []
    for module in (reader, storage_sqlite3, storage_mcap):
        real = module.parse_qos
        monkeypatch.setattr(module, "parse_qos", lambda text, real=real: (parsed.append(text), real(text))[1])
    bag = open_source(tmp_path / "bag")
    assert len(bag.topics) == 20
    assert bag.read("/robot/7", ["wrench.force.z"]).values["wrench.force.z"].tolist() == [7.0]
    assert 2 <= len(parsed) <= 4  # of the metadata and of the storage


@pytest.mark.parametrize("axis", ["x", "y"])
def test_an_axis_that_moves_more_than_z_is_named(tmp_path, axis):
    _, depth, forces = press(1.0)
    messages = []
    for tick, at in enumerate(times(1000, 1.0)):
        still = dict.fromkeys("xyz", 1e-4 * (tick % 2))
        messages.append(("/tool", POSE, at, pose(at, **still | {axis: depth[tick]})))
        messages.append(("/ft", WRENCH, at, wrench_along(at, **still | {axis: -forces[tick]})))
    bag = write_bag(tmp_path / "bag", messages)
    largest = f"{np.ptp(forces):.3g} N against 0.0001 N"
    expected = f'force: z is assumed, but it moves most along {axis} ({largest}); [force] field = "wrench.force.{axis}"'
    notes = read_with_notes(bag).notes
    assert any(note.startswith(expected) for note in notes)
    moved = f"position: z is assumed, but it moves most along {axis} ({1e3 * np.ptp(depth):.3g} mm against 0.1 mm)"
    assert any(note.startswith(moved) for note in notes)
    assert f"# {expected}" in inspect_recording(bag).guess.text()


def test_an_axis_that_moves_less_is_not(tmp_path):
    assert not any("assumed" in note for note in read_with_notes(write_bag(tmp_path / "bag", pressed(0.5))).notes)


def on_two_clocks(apart_ns, *, jitter_ns=0, seed=3):
    """Positions at 250 a second, forces at 1000, whose stamps are ahead; both are logged 1 ms late, with a jitter."""
    random = np.random.default_rng(seed)
    time, position, force = press()
    for tick in range(time.size):
        ns = BEGIN + tick * 10**6
        late = 10**6 + (int(random.integers(0, jitter_ns)) if jitter_ns else 0)
        if tick % 4 == 0:
            yield "/joint_states", JOINT, ns + late, joint(ns, [position[tick] / 0.075])
        yield "/ft", WRENCH, ns + late, wrench(ns + apart_ns, force[tick])


@pytest.mark.parametrize(
    ("apart", "jitter", "said"),
    [
        (20_000_000, 0, "19.99? ms|20 ms"),
        (-20_000_000, 1_000_000, "(19|20)"),
        (3_000_000, 0, ""),
        (1_000_000, 0, ""),
        (20_000_000, 60_000_000, ""),
    ],
)
def test_a_small_distance_of_clocks_is_said_where_it_is_more_than_its_uncertainty(tmp_path, apart, jitter, said):
    """4 ms are one sample of positions; a jitter of 60 ms has a middle half of 30 ms."""
    (tmp_path / "map.toml").write_text(MAP)
    bag = write_bag(tmp_path / "bag", sorted(on_two_clocks(apart, jitter_ns=jitter), key=lambda one: one[2]))
    read = read_with_notes(bag, map_file=tmp_path / "map.toml")
    notes = [note for note in read.notes if "two clocks" in note]
    assert len(notes) == bool(said)
    for note in notes:
        assert re.search(f"two clocks ({said})", note)
        assert 'header stamps are taken as they are, [time] stamp = "aligned"' in note
        assert "two clocks?" in inspect_recording(bag).notes[0]


def test_aligned_stamps_are_those_of_one_clock(tmp_path):
    map_file = tmp_path / "map.toml"
    read = {}
    for name, apart, stamp in (("one", 0, "header"), ("near", 20_000_000, "aligned"), ("far", 37 * 10**9, "aligned")):
        map_file.write_text(f'[time]\nstamp = "{stamp}"\n{MAP}')
        read[name] = read_with_notes(write_bag(tmp_path / name, on_two_clocks(apart)), map_file=map_file)
    for name, shift in (("near", "20 ms"), ("far", "37 s")):
        assert re.match(
            rf"stamps of /joint_states are moved by {shift} \(spread 0 ms\), as the map says", read[name].notes[0]
        )
        recording = read[name].recording
        assert recording.position.tobytes() == read["one"].recording.position.tobytes()
        assert recording.time.tobytes() == read["one"].recording.time.tobytes()
        assert recording.force.tobytes() == read["one"].recording.force.tobytes()


def test_aligned_in_one_topic_and_without_stamps(tmp_path):
    map_file = tmp_path / "map.toml"
    both = MAP.replace("/ft", "/joint_states").replace("wrench.force.z", "effort[0]")
    map_file.write_text(f'[time]\nstamp = "aligned"\n{both.replace("effort[0]", "position[0]")}')
    bag = write_bag(tmp_path / "bag", press_messages(0.1))
    assert len(read_with_notes(bag, map_file=map_file).recording) == 100
    kind = "std_msgs/msg/Float64"
    bare = [("/x", kind, at, TYPES[kind](data=0.1)) for at in times(100)]
    map_file.write_text(
        '[time]\nstamp = "aligned"\n'
        + MAP.replace("/joint_states", "/x").replace('position[0]"\nunit = "rad"\nscale = 0.075', 'data"\nunit = "m"')
    )
    bag = write_bag(tmp_path / "bare", [*bare, *(("/ft", WRENCH, at, wrench(at, 1.0)) for at in times(100))])
    assert 'messages of /x carry no stamp: [time] stamp = "log"' in refused(bag, map_file=map_file)


@pytest.mark.usefixtures("read_here")
def test_the_fields_of_a_topic_have_their_range(tmp_path, monkeypatch):
    forces = press(0.5)[2]
    bag = write_bag(tmp_path / "bag", pressed(0.5))
    result = inspect_recording(bag, "/ft/wrench")
    by_name = {column.name: column for column in result.columns}
    along = by_name["wrench.force.z"]
    assert (along.example, along.smallest, along.largest) == (forces[0], forces.min(), forces.max())
    assert (by_name["wrench.torque.x"].smallest, by_name["wrench.torque.x"].largest) == (0.0, 0.0)
    assert by_name["header.stamp.nanosec"].largest == 499_000_000.0
    assert not any("first" in note for note in result.notes)
    monkeypatch.setattr(inspection, "LONG_LOOK", 10_000)
    short = inspect_recording(bag, "/ft/wrench")
    (output,) = [note for note in short.notes if "smallest and largest are those of the first" in note]
    looked_at = int(re.search(r"first (\d+) messages", output)[1])
    assert 50 < looked_at < 500
    largest = next(column.largest for column in short.columns if column.name == "wrench.force.z")
    assert largest == forces[:looked_at].max()


def test_a_field_that_is_not_finite_or_not_always_there(tmp_path):
    values = [np.nan, 1.0, np.inf, -2.0]
    messages = [("/ft", WRENCH, at, wrench(at, value)) for at, value in zip(times(4, 1.0), values, strict=True)]
    joints = [
        ("/joint_states", JOINT, at, joint(at, [0.5] * (1 + tick % 2), ["a", "b"][: 1 + tick % 2]))
        for tick, at in enumerate(times(4, 1.0))
    ]
    bag = write_bag(tmp_path / "bag", [*messages, *joints])
    by_name = {column.name: column for column in inspect_recording(bag, "/ft").columns}
    assert (by_name["wrench.force.z"].smallest, by_name["wrench.force.z"].largest) == (-2.0, 1.0)
    assert [column.smallest for column in inspect_recording(bag, "/joint_states").columns][-1] == 0.5


def test_a_stamp_may_be_a_field(tmp_path):
    series = open_source(write_bag(tmp_path / "bag", pressed(0.1))).read("/ft/wrench", ["header.stamp.sec"])
    assert series.values["header.stamp.sec"].tolist() == [BEGIN // 10**9] * 100
    assert series.stamp_ns is not None


def test_a_saved_map_says_what_becomes_of_its_remarks(tmp_path):
    bag = write_bag(tmp_path / "bag", press_messages(0.2))
    guess = inspect_recording(bag).guess
    remarks = (
        "# lines with # are remarks: fill in below what is open, and delete them\n# open: the unit of the position"
    )
    assert guess.text().startswith(remarks)
    whole = inspect_recording(write_bag(tmp_path / "whole", pressed(0.2))).guess
    assert "#" not in whole.text()

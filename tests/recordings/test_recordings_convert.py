"""What is written in another format reads back as the same recording, and teaches the same."""

import dataclasses
import json
import re
from itertools import pairwise

import numpy as np
import pytest
from made_bags import MAP, press, press_messages, write_bag
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import RecordingError
from foretouch.identification import Learner, identify, make_estimator
from foretouch.quantities import Recording
from foretouch.recordings import OUTPUTS, inspect_recording, read_recording, write_recording


def run(*arguments):
    return CliRunner().invoke(app, ["recordings", *map(str, arguments)])


def made(velocity=True, begin=0.0, floor=0.05, seconds=1.5):
    time, position, force = press(seconds)
    speed = np.gradient(position, time) if velocity else None
    return Recording(np.rint((time + begin) * 1e9) / 1e9, position, force, speed, contact_floor=floor)


def assert_same(recording, expected, *, floor=True):
    for name in ("time", "position", "force"):
        assert getattr(recording, name).tobytes() == getattr(expected, name).tobytes(), name
    assert (recording.velocity is None) == (expected.velocity is None)
    if expected.velocity is not None:
        assert recording.velocity.tobytes() == expected.velocity.tobytes()
    assert not floor or recording.contact_floor == expected.contact_floor


@pytest.mark.usefixtures("read_apart")
@pytest.mark.parametrize("suffix", OUTPUTS)
@pytest.mark.parametrize(("velocity", "begin"), [(False, 12.5), (True, 0.0)])
@pytest.mark.first
def test_a_recording_reads_back_bit_by_bit(tmp_path, suffix, velocity, begin):
    expected = made(velocity, begin, floor=0.05 if suffix == ".csv" else 0.3)
    path = tmp_path / f"press{suffix}"
    assert write_recording(path, expected) == []
    assert_same(read_recording(path), expected)
    assert_same(read_recording(path, flip=True), dataclasses.replace(expected, position=-expected.position,
        velocity=None if expected.velocity is None else -expected.velocity))  # fmt: skip


def test_a_csv_says_that_it_keeps_no_contact_floor(tmp_path):
    (output,) = write_recording(tmp_path / "press.csv", made(floor=0.3))
    assert "contact_floor = 0.3" in output


def learnt(recording):
    result = identify(
        recording, Learner(make_estimator("hunt-crossley", "exact"), contact_floor=recording.contact_floor)
    )
    return result.parameters, result.residual.tobytes(), result.surface, result.force_offset


def test_there_and_back_teaches_the_same(tmp_path):
    """A bag to MCAP, on to Parquet and CSV and back: one model, bit by bit."""
    bag = write_bag(tmp_path / "bag", press_messages(2.0, every=2))
    map_file = tmp_path / "map.toml"
    map_file.write_text(MAP)
    expected = learnt(read_recording(bag, map_file=map_file))
    assert run("convert", bag, tmp_path / "a.mcap", "--map", map_file).exit_code == 0
    way = ["a.mcap", "b.parquet", "c.mcap", "d.csv", "e.mcap"]
    for source, target in pairwise(way):
        done = run("convert", tmp_path / source, tmp_path / target)
        assert done.exit_code == 0, done.output
    for name in way:
        assert learnt(read_recording(tmp_path / name)) == expected, name


def test_two_other_readers_find_the_numbers(tmp_path):
    path, expected = tmp_path / "press.mcap", made()
    write_recording(path, expected)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        got = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
        said = {channel.topic: channel.metadata["frame_id"] for channel in reader.get_summary().channels.values()}
    assert said == {"/probe/joint_states": "tip", "/probe/wrench": "tip", "/probe/pose": "world"}
    with AnyReader([path]) as reader:
        also = [(one.topic, reader.deserialize(raw, one.msgtype)) for one, _, raw in reader.messages()]
    for messages in (got, also):
        joints = [message for topic, message in messages if topic == "/probe/joint_states"]
        assert [one.position[0] for one in joints] == expected.position.tolist()
        assert [one.velocity[0] for one in joints] == expected.velocity.tolist()
        assert [one.effort[0] for one in joints] == expected.force.tolist()
        wrenches = [message for topic, message in messages if topic == "/probe/wrench"]
        assert [one.wrench.force.z for one in wrenches] == expected.force.tolist()
        poses = [message for topic, message in messages if topic == "/probe/pose"]
        # z of the world points out of the material, as that of the tip, and as in a session's recording
        assert [one.pose.position.z for one in poses] == (-expected.position).tolist()
        assert all(message.header.frame_id == said[topic] for topic, message in messages)
        stamps = [one.header.stamp.sec * 10**9 + one.header.stamp.nanosec for one in poses]
        assert stamps == np.rint(expected.time * 1e9).astype(int).tolist()


def test_times_before_zero_are_moved_and_said(tmp_path):
    path, expected = tmp_path / "press.mcap", made(begin=-2.0)
    (output,) = write_recording(path, expected)
    assert "times begin at 0 instead of -2 s" in output
    np.testing.assert_allclose(read_recording(path).time, expected.time + 2.0, atol=1e-9)
    close = Recording([0.0, 1e-10], [0.0, 0.1], [0.0, 1.0])
    with pytest.raises(RecordingError, match="less than a nanosecond apart"):
        write_recording(path, close)
    np.testing.assert_allclose(read_recording(path).time, expected.time + 2.0, atol=1e-9)  # as it was


def test_nothing_half_written_is_left(tmp_path):
    source = tmp_path / "press.csv"
    source.write_text("time_s,position_m,force_N\n0,0,0\n1,0,nan\n")
    for target, output in (
        ("out.mcap", "row 3: force is nan"),
        ("out.txt", "must end with one of .csv, .parquet, .mcap"),
    ):
        done = run("convert", source, tmp_path / target)
        assert done.exit_code == 1
        assert re.search(output, str(done.exception))
    done = run("convert", source, source)
    assert "is the recording itself" in str(done.exception)
    write_recording(source, made())
    done = run("convert", source, tmp_path / "absent" / "out.mcap")
    assert "cannot be written: No such file" in str(done.exception)
    assert [file.name for file in tmp_path.iterdir()] == ["press.csv"]


def test_inspect_prints_what_is_there_and_saves_the_map(tmp_path):
    bag = write_bag(
        tmp_path / "bag", press_messages(0.5), topics=[(f"/other{n}", "std_msgs/msg/Bool") for n in range(50)]
    )
    done = run("inspect", bag, "--save", tmp_path / "map.toml")
    assert done.exit_code == 0, done.output
    assert "rosbag2 (sqlite3), 52 topics, 0.499 s, from 2023-11-14T22:13:20.000+00:00" in done.output
    lines = done.output.splitlines()
    assert lines[3].split() == ["/ft", "geometry_msgs/msg/WrenchStamped", "500", "1000", "/s"]
    assert "... and 12 topics more" in done.output
    assert "# open: the unit of the position /joint_states position[0] is not known" in done.output
    assert "/other49" in run("inspect", bag, "--all").output
    text = (tmp_path / "map.toml").read_text()
    (tmp_path / "map.toml").write_text(text.replace('"?"', '"rad"\nscale = 0.075'))
    assert len(read_recording(bag, map_file=tmp_path / "map.toml")) == 500
    fields = run("inspect", bag, "--topic", "/ft").output
    assert re.search(r"wrench\.force\.z +float64 +500 +0\.5", fields)
    assert "no topic /fz" in str(run("inspect", bag, "--topic", "/fz").exception)


def test_inspect_prints_one_object(tmp_path):
    path = tmp_path / "press.csv"
    path.write_text("Zeit [s];Weg [mm];Kraft [N]\n0,0;1,0;0\n0,5;2,0;1\n")
    result = json.loads(run("inspect", path, "--json").output)
    assert (result["format"], result["duration_s"], result["rate_per_s"]) == ("CSV", 0.5, 2.0)
    assert [(one["column"], one["count"], one["unit"]) for one in result["columns"]] == [
        ("Zeit [s]", 2, "s"), ("Weg [mm]", 2, "mm"), ("Kraft [N]", 2, "N"),
    ]  # fmt: skip
    assert result["open"] == []
    (tmp_path / "map.toml").write_text(result["map"])
    assert read_recording(path, map_file=tmp_path / "map.toml").position.tolist() == [0.001, 0.002]
    assert inspect_recording(path).as_json() == result


@pytest.mark.long
def test_every_command_that_takes_a_recording_takes_a_map(tmp_path):
    bag = write_bag(tmp_path / "bag", press_messages(2.0, stamps_off=-2_000_000_000))
    map_file, alone = tmp_path / "map.toml", tmp_path / "alone.csv"
    map_file.write_text(MAP)
    assert run("convert", bag, alone, "--map", map_file, "--json").exit_code == 0
    law = ["--model", "hunt-crossley", "--estimator", "exact", "--json"]
    many = ["--models", "hunt-crossley", "--estimators", "exact", "--jobs", "1", "--json"]
    for name, options in (("identify", law), ("predict", law), ("compare", many)):
        by_map = CliRunner().invoke(app, [name, str(bag), "--map", str(map_file), *options])
        plain = CliRunner().invoke(app, [name, str(alone), *options])
        assert by_map.exit_code == plain.exit_code == 0, by_map.output
        assert "two clocks 2 s apart" in by_map.stderr
        result, expected = (json.loads(done.stdout) for done in (by_map, plain))
        if name == "compare":
            result, expected = ({**one["results"][0], "recording": ""} for one in (result, expected))
            result, expected = ({key: one[key] for key in one if key != "us_per_sample"} for one in (result, expected))
        assert result == expected

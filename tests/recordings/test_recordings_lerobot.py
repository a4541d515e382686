"""A LeRobot dataset holds the recording's own numbers, frame by frame, as pyarrow and PyAV read them."""

from __future__ import annotations

import dataclasses
import json
import math
import sys

import cv2
import msgspec
import numpy as np
import pyarrow.parquet as parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.cli import main
from foretouch.errors import MissingExtraError, RecordingError, SettingError
from foretouch.messages import VERSION, CameraImage, FollowerSpace, LeaderState, ModelUpdate, Telemetry
from foretouch.quantities import Recording
from foretouch.recordings import (
    RecordingOptions,
    SessionWriter,
    read_episode,
    read_session,
    write_lerobot,
    write_recording,
)
from foretouch.recordings.lerobot import dataset as writing

TICKS, LATE, NAN = 500, 20, math.nan
CAMERA = "observation.images.camera"
VALUES = (5000.0, 40.0, 0.4, 0.9)


def force(tick):
    return 0.01 * tick


def telemetry(tick, space=None):
    command = max(tick - LATE, 0)
    bad = tick % 50 == 7
    told = 1e-5 * tick + 1e-6, 1e-5 * tick, 0.01, NAN if bad else 7.0, force(tick), NAN, True, False
    return Telemetry(
        VERSION, tick, tick * 1_000_000, command, *told, tick // 20, 1_000_000, 0, validity=2 * bad, epoch=5, run=9,
        space=space,
    )  # fmt: skip


def leader(tick):
    told = 1e-5 * tick, 0.0, 2.0 * force(tick), 0.0, 0.5 * force(tick), tick, tick, 0.0, False, 1_000_000, 0
    return LeaderState(VERSION, tick, tick * 1_000_000, *told, NAN if tick < 100 else 0.1, epoch=5, run=9)


def model(number):
    known = number > 2
    told = "hunt-crossley" if known else "", VALUES[:3] if known else (), (), 0.01 + number * 1e-5, known, "", "x", b""
    errors = (NAN, 3.0, 0.01) if known else ()
    return ModelUpdate(
        VERSION, number, number * 20_000_000, number, *told, epoch=5, run=9, standard_errors=errors
    )  # fmt: skip


def in_space(tick):
    where = [1e-4 * tick + axis for axis in range(3)]
    desired = [one + 1e-5 for one in where]
    rest = [0.1, 0.2, 0.3, 0.0, 0.0, 1.0, -0.01, *(0.5 + 0.01 * axis for axis in range(6))]
    return FollowerSpace(*where, *desired, *rest, joint_1=0.3, joint_2=-1e-3 * tick)


def picture(tick, size=(32, 24)):
    """An image whose brightness says when it was taken."""
    pixels = np.full((size[1], size[0], 3), 40 + tick % 160, np.uint8)
    return cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


def image(tick, size=(32, 24), jpeg=None):
    data = picture(tick, size) if jpeg is None else jpeg
    return CameraImage(VERSION, tick, tick * 1_000_000, tick, data, (), (), 0, "no board", (1.0,) * 15, run=9)


def write(path, ticks=TICKS, *, space=False, images=()):
    """A session at 1 kHz, in which every fiftieth sample is not to be trusted."""
    with SessionWriter(path) as writer:
        for tick in range(1, ticks + 1):
            messages = [leader(tick), telemetry(tick, in_space(tick) if space else None)]
            messages += [model(tick // 20)] if tick % 20 == 0 else []
            messages += [one for one in images if one.tick == tick]
            for message in messages:
                writer.write(message, tick * 1_000_000)
    return path


@pytest.fixture(scope="module")
def line(tmp_path_factory):
    return write(tmp_path_factory.mktemp("line") / "line.mcap")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    pytest.importorskip("av")
    images = [image(tick) for tick in range(11, TICKS, 31)] + [image(50, jpeg=b"")]
    return write(tmp_path_factory.mktemp("scene") / "scene.mcap", space=True, images=images)


def table(folder, file=0):
    read = parquet.read_table(folder / f"data/chunk-000/file-{file:03d}.parquet")
    return {name: np.array(read[name].to_pylist()) for name in read.column_names}


def described(folder):
    return json.loads((folder / "meta/info.json").read_text())


def episodes(folder):
    return parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def written(folder, *paths, fps=30, **more):
    write_lerobot(folder, (read_episode(path, fps=fps) for path in paths), **more)
    return folder


def trusted(path):
    return [row for row in read_session(path).follower if row["validity"] == 0]


def newest(rows, fps):
    """The newest trusted row at each frame, found one by one."""
    begin = rows[0]["time_ns"]
    frames = (rows[-1]["time_ns"] - begin) * fps // 10**9 + 1
    return [[row for row in rows if (row["time_ns"] - begin) * fps <= k * 10**9][-1] for k in range(frames)]


@pytest.mark.parametrize("fps", [7, 30, 1000])
def test_a_frame_has_the_newest_sample_that_can_be_trusted(tmp_path, line, fps):
    read = table(written(tmp_path / "out", line, fps=fps))
    rows = newest(trusted(line), fps)
    assert len(rows) == len(read["index"])
    for name, column in (
        ("observation.state", "position"),
        ("observation.wrench", "force"),
        ("action", "desired_position"),
    ):
        assert (read[name] == np.float32([row[column] for row in rows])).all(), name
    assert (read["timestamp"] == np.float32(np.arange(len(rows)) / fps)).all()


def test_between_two_frames_every_trusted_sample_is_there_once(tmp_path, line):
    read, rows = table(written(tmp_path / "out", line)), trusted(line)
    counts, most = read["samples.count"], read["samples.count"].max()
    assert counts[0] == 1
    assert read["samples.time"].shape == (len(counts), most)
    assert read["samples.wrench"].shape == read["samples.position"].shape == (len(counts), most, 1)
    times = [t + frame / 30 for frame, count in enumerate(counts) for t in read["samples.time"][frame, :count]]
    begin, every = rows[0]["time_ns"], rows[: counts.sum()]
    assert np.allclose(times, [(row["time_ns"] - begin) / 1e9 for row in every], atol=1e-8)
    assert (read["samples.time"][np.arange(most) < counts[:, None]] <= 0.0).all()
    for name, column in (("samples.wrench", "force"), ("samples.position", "position")):
        kept = [value for frame, count in enumerate(counts) for value in read[name][frame, :count, 0]]
        assert (kept == np.float32([row[column] for row in every])).all()
        assert all(np.isnan(read[name][frame, count:]).all() for frame, count in enumerate(counts))


def test_forces_of_the_leader_are_those_at_the_command_that_the_robot_had(tmp_path, line):
    read = table(written(tmp_path / "out", line))
    commands = [row["command_sequence"] for row in newest(trusted(line), 30)]
    for frame, command in enumerate(commands):
        predicted, deviation = read["leader.predicted_force"][frame]
        if command == 0:
            assert np.isnan(predicted)
            assert np.isnan(read["leader.delayed_force"][frame])
        else:
            assert predicted == np.float32(2.0 * force(command))
            assert read["leader.delayed_force"][frame] == np.float32(0.5 * force(command))
            assert np.isnan(deviation) == (command < 100)


def test_the_model_is_the_newest_that_had_been_sent(tmp_path, line):
    folder = written(tmp_path / "out", line)
    features, read = described(folder)["features"], table(folder)
    assert features["model.parameters"]["names"] == ["stiffness [N/m^n]", "damping [N s/m^(n+1)]", "exponent"]
    assert features["model.standard_errors"]["names"] == ["damping [N s/m^(n+1)]", "exponent"]  # one is never known
    for frame, row in enumerate(newest(trusted(line), 30)):
        number = row["model_sequence"]
        expected = VALUES[:3] if number > 2 else (NAN,) * 3
        assert np.array_equal(read["model.parameters"][frame], np.float32(expected), equal_nan=True)
        assert np.isnan(read["model.standard_errors"][frame]).all() == (number <= 2)
        assert number == 0 or read["model.surface"][frame] == np.float32(0.01 + number * 1e-5)
        assert number == 0 or read["model.valid"][frame] == (number > 2)


def test_a_scene_has_vectors_joints_and_the_pose_of_its_fixture(tmp_path, scene):
    folder = written(tmp_path / "out", scene)
    features, read = described(folder)["features"], table(folder)
    names = {name: feature["names"] for name, feature in features.items()}
    assert names["observation.state"] == ["x_m", "y_m", "z_m", "joint_1_rad", "joint_2_rad"]
    assert names["observation.wrench"] == ["force_x_N", "force_y_N", "force_z_N"]
    assert names["action"] == ["x_m", "y_m", "z_m"]
    rows = newest([row for row in trusted(scene) if row["sequence"] >= 11], 30)
    for frame, row in enumerate(rows):
        said = in_space(int(row["sequence"]))
        place = said.place_x, said.place_y, said.place_z, *said.joints
        assert (read["observation.state"][frame] == np.float32(place)).all()
        assert (read["action"][frame] == np.float32((said.desired_x, said.desired_y, said.desired_z))).all()
        assert (read["observation.wrench"][frame] == np.float32((0.1, 0.2, 0.3))).all()
        assert (read["model.fixture"][frame] == np.float32([0.5, 0.51, 0.52, 0.53, 0.54, 0.55])).all()
    assert read["samples.position"].shape[2] == read["samples.wrench"].shape[2] == 3


def test_the_video_shows_the_newest_image_at_each_frame(tmp_path, scene):
    av = pytest.importorskip("av")
    folder = written(tmp_path / "out", scene, scene)
    feature = described(folder)["features"][CAMERA]
    assert (feature["dtype"], feature["shape"]) == ("video", [24, 32, 3])
    rows = newest([row for row in trusted(scene) if row["sequence"] >= 11], 30)
    taken = [max(tick for tick in range(11, TICKS, 31) if tick <= row["sequence"]) for row in rows] * 2
    with av.open(str(folder / f"videos/{CAMERA}/chunk-000/file-000.mp4")) as video:
        frames = list(video.decode(video=0))
        assert feature["info"]["video.codec"] == video.streams.video[0].codec.canonical_name == "h264"
    assert len(frames) == len(taken)
    for number, (frame, tick) in enumerate(zip(frames, taken, strict=True)):
        assert frame.time == pytest.approx(number / 30, abs=1e-4)
        assert frame.to_ndarray(format="rgb24").mean() == pytest.approx(40 + tick % 160, abs=2.0)
    first, second = episodes(folder)
    assert first[f"videos/{CAMERA}/from_timestamp"] == 0.0
    assert second[f"videos/{CAMERA}/from_timestamp"] == first[f"videos/{CAMERA}/to_timestamp"] == len(rows) / 30
    looked = [(40 + tick % 160) / 255 for tick in taken[: len(rows) : 10]]
    statistics = json.loads((folder / "meta/stats.json").read_text())[CAMERA]
    assert statistics["count"] == [2 * len(looked)]
    assert np.shape(statistics["mean"]) == (3, 1, 1)
    assert np.ravel(statistics["mean"]) == pytest.approx([np.mean(looked)] * 3, abs=0.01)
    assert np.ravel(statistics["std"]) == pytest.approx([np.std(looked)] * 3, abs=0.01)
    assert np.ravel(statistics["max"]) == pytest.approx([max(looked)] * 3, abs=0.01)


def test_statistics_are_of_what_is_there(tmp_path, line):
    folder = written(tmp_path / "out", line)
    read, features = table(folder), described(folder)["features"]
    text = (folder / "meta/stats.json").read_text()
    statistics = json.loads(text)
    assert "NaN" not in text
    assert statistics.keys() == features.keys() == read.keys()
    (row,) = episodes(folder)
    for name, values in read.items():
        flat = values.reshape(-1, values.shape[-1] if values.ndim > 1 else 1).astype(np.float64)
        for kind, of in (("min", np.nanmin), ("max", np.nanmax), ("mean", np.nanmean), ("std", np.nanstd)):
            assert statistics[name][kind] == pytest.approx(of(flat, axis=0), abs=1e-12), name
            assert statistics[name][kind] == row[f"stats/{name}/{kind}"]
        assert statistics[name]["q50"] == pytest.approx(np.nanmedian(flat, axis=0))
        assert statistics[name]["count"] == [len(values)]
        assert values.shape[1:] == (() if features[name]["shape"] == [1] else tuple(features[name]["shape"]))


def test_several_recordings_are_episodes_in_their_order(tmp_path, line):
    short = write(tmp_path / "short.mcap", 101)
    folder = written(tmp_path / "out", short, line, task="press foam")
    info, read, rows = described(folder), table(folder), episodes(folder)
    lengths = [row["length"] for row in rows]
    assert lengths == [4, 15]
    assert (info["total_episodes"], info["total_frames"], info["splits"]) == (2, 19, {"train": "0:2"})
    assert [(row["dataset_from_index"], row["dataset_to_index"]) for row in rows] == [(0, 4), (4, 19)]
    assert read["index"].tolist() == list(range(19))
    assert read["episode_index"].tolist() == [0] * 4 + [1] * 15
    assert read["frame_index"].tolist() == [*range(4), *range(15)]
    assert rows[1]["tasks"] == ["press foam"]
    pandas = pytest.importorskip("pandas")
    tasks = pandas.read_parquet(folder / "meta/tasks.parquet")
    assert tasks.index.tolist() == ["press foam"]
    assert tasks.loc["press foam"].task_index == 0


def test_large_files_are_followed_by_a_next_one(tmp_path, line, scene, monkeypatch):
    monkeypatch.setattr(writing, "DATA_MB", 0)
    monkeypatch.setattr(writing, "VIDEO_MB", 0)
    folder = written(tmp_path / "out", scene, scene)
    assert [row["data/file_index"] for row in episodes(folder)] == [0, 1]
    assert [row[f"videos/{CAMERA}/file_index"] for row in episodes(folder)] == [0, 1]
    assert [row[f"videos/{CAMERA}/from_timestamp"] for row in episodes(folder)] == [0.0, 0.0]
    assert table(folder, 1)["episode_index"].tolist() == [1] * episodes(folder)[1]["length"]
    assert (folder / f"videos/{CAMERA}/chunk-000/file-001.mp4").stat().st_size > 500


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.sampled_from([1, 2, 3, 50, 333, 4000]), min_size=1, max_size=40),
    fps=st.sampled_from([1, 3, 30, 200, 1000]),
)
@pytest.mark.long
def test_of_uneven_times_each_frame_knows_what_was_before_it_and_no_more(tmp_path_factory, steps, fps):
    folder = tmp_path_factory.mktemp("uneven")
    ticks = np.cumsum([0, *steps])  # ms
    position = np.arange(ticks.size) * 1e-3
    write_recording(folder / "press.csv", Recording(5.0 + ticks / 1e3, position, 2.0 * position))
    read = table(written(folder / "out", folder / "press.csv", fps=fps))
    frames = int(ticks[-1] * fps // 1000) + 1
    last = [int(np.flatnonzero(ticks * fps <= frame * 1000)[-1]) for frame in range(frames)]
    assert read["observation.state"].tolist() == np.float32(position[last]).tolist()
    assert read["samples.count"].tolist() == np.diff(last, prepend=-1).tolist()
    assert "action" not in read


def test_what_is_beyond_single_precision_is_no_sample(tmp_path):
    time = np.arange(100) / 100
    strong = np.where(time < 0.5, 1.0, 1e300)
    write_recording(tmp_path / "press.csv", Recording(time, 0.0 * time, strong))
    assert table(written(tmp_path / "out", tmp_path / "press.csv"))["samples.count"].sum() == 47
    write_recording(tmp_path / "none.csv", Recording(time, 0.0 * time, 0.0 * time + 1e300))
    with pytest.raises(RecordingError, match="no sample with sensors that could be believed"):
        read_episode(tmp_path / "none.csv")


def test_a_follower_that_only_watched_has_no_action(tmp_path):
    with SessionWriter(tmp_path / "shadow.mcap") as writer:
        for tick in range(1, 101):
            watched = msgspec.structs.replace(telemetry(tick), desired_position=NAN, command_sequence=0, epoch=0)
            writer.write(watched, tick * 1_000_000)
    read = table(written(tmp_path / "out", tmp_path / "shadow.mcap"))
    assert read["samples.count"].tolist() == [1, 32, 32]
    assert not {"action", "leader.predicted_force", "leader.delayed_force", "model.parameters"} & read.keys()


def test_a_session_is_read_as_it_is(line):
    with pytest.raises(RecordingError, match="is a session, which states units and signs"):
        read_episode(line, RecordingOptions(flip=True))


def odd(path, size, jpeg=None):
    return write(path, 100, space=True, images=[image(11), image(40, size, jpeg)])


def test_what_cannot_be_one_dataset_is_refused_and_nothing_is_left(tmp_path, line, scene):
    blind = write(tmp_path / "blind.mcap", 100, space=True)
    other = odd(tmp_path / "other.mcap", (64, 24))
    narrow = odd(tmp_path / "narrow.mcap", (31, 24))
    torn = odd(tmp_path / "torn.mcap", (32, 24), b"no picture")
    before = sorted(tmp_path.iterdir())
    for paths, problem in (
        ((), "no recording is given"),
        ((line, scene), "observation.state is x_m, y_m, z_m, joint_1_rad, joint_2_rad, and in .*: .* must be alike"),
        ((scene, blind), "has no images of a camera, unlike the first"),
        ((blind, scene), "has images of a camera, unlike the first"),
        ((scene, other), "has an image of 64 x 24 pixels, and others of 32 x 24"),
        ((narrow,), "width and height of a video must be even"),
        ((torn,), "an image of its camera is no JPEG that can be read"),
        ((line, tmp_path / "gone.mcap"), "no such file"),
    ):
        with pytest.raises(RecordingError, match=problem) as caught:
            written(tmp_path / "out", *paths)
        assert "\n" not in str(caught.value)
        assert sorted(tmp_path.iterdir()) == before
    episode = read_episode(line)
    with pytest.raises(RecordingError, match="has 20 frames a second"):
        write_lerobot(tmp_path / "out", [episode, dataclasses.replace(episode, fps=20)])
    with pytest.raises(SettingError, match="must say in words"):
        write_lerobot(tmp_path / "out", [episode], task=" ")
    (tmp_path / "here").mkdir()
    with pytest.raises(RecordingError, match="it is there already"):
        written(tmp_path / "here", line)


def test_too_much_for_a_table_is_refused_before_it_takes_the_memory(tmp_path):
    time = np.concatenate([np.arange(2000) * 1e-6, [400_000.0]])
    recording = Recording(time, 0.0 * time, 0.0 * time)
    write_recording(tmp_path / "press.csv", recording)
    with pytest.raises(RecordingError, match=r"12,000,000 frames|12,000,001 frames"):
        read_episode(tmp_path / "press.csv")
    episode = read_episode(tmp_path / "press.csv", fps=1)
    with pytest.raises(RecordingError, match="samples lie between two: too many for a table"):
        write_lerobot(tmp_path / "out", [episode])
    for fps in (0, 1001, 2.5, True):
        with pytest.raises(SettingError, match="whole number of frames a second from 1 to 1000"):
            read_episode(tmp_path / "press.csv", fps=fps)


def test_without_the_library_of_videos_it_says_what_to_install(tmp_path, scene, line, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"av is not installed: pip install .*\[lerobot\]"):
        written(tmp_path / "out", scene)
    assert not list(tmp_path.iterdir())
    written(tmp_path / "out", line)  # which has no images


def run(monkeypatch, capsys, *words):
    """The command as it is typed, with its exit code and what it prints."""
    monkeypatch.setattr(sys, "argv", ["foretouch", "recordings", "convert", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0, *capsys.readouterr()


def test_the_command_writes_it_and_refuses_what_contradicts(tmp_path, line, monkeypatch, capsys):
    words = [line, line, "--to", "lerobot", "--output", tmp_path / "out", "--fps", 10, "--task", "x", "--json"]
    code, printed, _ = run(monkeypatch, capsys, *words)
    assert code == 0
    content = json.loads(printed)
    assert (content["episodes"], content["frames"], content["fps"]) == (2, 10, 10)
    assert content["features"] == list(described(tmp_path / "out")["features"])
    assert described(tmp_path / "out")["codebase_version"] == "v3.0"
    for words, problem in (
        ([line, "--to", "lerobot", "--output", tmp_path / "out"], "it is there already"),
        ([line, "--to", "lerobot", "--output", tmp_path / "no" / "out"], "is not there: mkdir"),
        ([line, "--to", "lerobot"], "name the folder of the dataset"),
        ([line, "--to", "rlds", "--output", tmp_path / "b"], "choose one of lerobot"),
        ([line, tmp_path / "b.csv", "--fps", 10], "is for --to lerobot alone"),
        ([line], "give one recording, and behind it one file to write"),
        ([line, line, tmp_path / "b.csv"], "give one recording, and behind it one file to write"),
    ):
        code, printed, said = run(monkeypatch, capsys, *words)
        assert (code, printed, len(said.splitlines())) == (2, "", 1), words
        assert problem in said
    assert [path.name for path in tmp_path.iterdir()] == ["out"]

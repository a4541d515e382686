"""The follower's samples: the same from the whole log, from a narrow reading, and from the file beside the mcap."""

import os
from dataclasses import astuple
from pathlib import Path

import msgspec
import numpy as np
import pytest
from session_messages import leader_state, telemetry

from foretouch.errors import RecordingError
from foretouch.recordings import SessionWriter, follower_samples, read_follower_samples, read_recording, read_session
from foretouch.recordings.session import reader as samples_file
from foretouch.recordings.session.reader import read_samples


def write(path: Path, ticks: int = 900, force: float = 1.0) -> None:
    """Two processes of each side, blocks of several lengths, some samples that no sensor meant."""
    with SessionWriter(path) as writer:
        for tick in range(1, ticks + 1):
            run, epoch = (11, 7) if tick < 300 else (12, 8)
            output = {"run": run, "epoch": epoch, "time_ns": tick * 1_000_000}
            writer.write(msgspec.structs.replace(leader_state(tick), **output), tick)
            fault = {350: 3, 351: 3, 352: 1}.get(tick, 0)
            measured = {"position": 1e-5 * tick, "sensor_force": force * tick, "validity": fault}
            writer.write(msgspec.structs.replace(telemetry(tick), **output, **measured), tick)
            if tick % 130 == 0:
                writer.flush()


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read_here: None) -> Path:
    """A recording that counts as long."""
    monkeypatch.setattr(samples_file, "LARGE", 1)
    made = tmp_path / "session.mcap"
    write(made)
    return made


def same(one: object, other: object) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(astuple(one), astuple(other), strict=True))  # type: ignore[call-overload]


def test_a_narrow_reading_finds_the_samples_of_the_whole_log(path: Path) -> None:
    whole, narrow = follower_samples(read_session(path)), follower_samples(read_samples(path))
    assert same(whole, narrow)
    assert (whole.segments, whole.leader_starts, whole.follower_starts) == (2, 2, 2)
    assert whole.faults.tolist() == [1, 3]
    assert whole.fault_counts.tolist() == [1, 2]
    assert whole.time.size == 601 - 3
    assert whole.force[0] == 300.0
    assert whole.seconds == pytest.approx(0.6)


def test_the_second_time_they_come_from_the_file_beside_it(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = read_follower_samples(path)
    monkeypatch.setattr(samples_file, "read_samples", None)  # who reads the recording fails
    assert same(read_follower_samples(path), first)
    assert {file.name for file in path.parent.iterdir()} == {path.name, f"{path.name}.samples"}
    np.testing.assert_array_equal(read_recording(path).force, first.force)


def test_a_recording_that_has_changed_is_read_again(path: Path) -> None:
    read_follower_samples(path)
    about = path.stat()
    write(path, force=2.0)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns + 1))
    assert read_follower_samples(path).force[0] == 600.0
    assert read_follower_samples(path).force[0] == 600.0


@pytest.mark.parametrize("content", [b"", b"no zip", b"PK\x03\x04 but cut"])
def test_a_file_beside_it_that_is_none_is_replaced(path: Path, content: bytes) -> None:
    first = read_follower_samples(path)
    beside = Path(f"{path}.samples")
    whole = beside.read_bytes()
    beside.write_bytes(content)
    assert same(read_follower_samples(path), first)
    assert beside.read_bytes()[:4] == whole[:4]


@pytest.mark.long
def test_damage_to_the_file_beside_it_is_noticed_wherever_it_is(path: Path) -> None:
    first = read_follower_samples(path)
    beside = Path(f"{path}.samples")
    whole = bytearray(beside.read_bytes())
    rng = np.random.default_rng(0)
    headers = [index for index in range(len(whole) - 30) if whole[index : index + 2] == b"PK"]
    for _ in range(150):  # in the headers of the archive, where another exception waits behind each field
        damaged = bytearray(whole)
        damaged[int(rng.choice(headers)) + int(rng.integers(2, 30))] ^= int(rng.integers(1, 256))
        beside.write_bytes(damaged)
        assert same(read_follower_samples(path), first)


def test_where_no_file_can_be_kept_it_is_read_each_time(path: Path) -> None:
    Path(f"{path}.samples").mkdir()
    assert same(read_follower_samples(path), read_follower_samples(path))


def test_a_short_recording_keeps_nothing(tmp_path: Path) -> None:
    write(tmp_path / "short.mcap", 40)
    read_follower_samples(tmp_path / "short.mcap")
    assert [file.name for file in tmp_path.iterdir()] == ["short.mcap"]


def test_a_missing_recording_is_refused_although_its_samples_were_kept(path: Path) -> None:
    read_follower_samples(path)
    path.unlink()
    with pytest.raises(RecordingError, match="no such file"):
        read_recording(path)

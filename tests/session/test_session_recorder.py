"""The recorder: what it keeps when it is killed, when its disk is full, and when its folder goes."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from recorder_memory import follower, hello, leader
from running import Running, until

from foretouch.errors import RecordingError
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import VERSION, Stop
from foretouch.recordings import is_whole, read_session, repair_session
from foretouch.session import RECORDER_CHANNELS, RECORDING_INCOMPLETE, Recorder, StopFlag, run_recorder


def ticks(recorder: Recorder, begin: int, end: int) -> None:
    for name, made in (("leader", leader), ("telemetry", follower)):
        recorder.take(name, [(n * 10**6, made(n)) for n in range(begin, end)])


def test_a_gap_in_the_sequence_is_counted_and_what_was_before_the_first_is_not(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "session.mcap")
    ticks(recorder, 500, 600)
    ticks(recorder, 610, 700)
    assert recorder.missed == 20
    recorder.close({"recorder_missed": recorder.missed})
    assert recorder.problem == ""
    assert read_session(tmp_path / "session.mcap").counts == {"recorder_missed": 20}


def test_a_file_whose_folder_is_removed_is_kept_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "out" / "today" / "session.mcap"
    path.parent.mkdir(parents=True)
    recorder = Recorder(path)
    ticks(recorder, 1, 500)
    recorder.flush()
    shutil.rmtree(tmp_path / "out")
    ticks(recorder, 500, 800)
    recorder.flush()
    assert recorder.path == tmp_path / "session-kept.mcap"
    assert recorder.problem == f"{path}: was removed while it was written; it goes on as {recorder.path}"
    ticks(recorder, 800, 1000)
    recorder.close({})
    assert read_session(recorder.path).follower["sequence"].tolist() == list(range(1, 1000))
    assert is_whole(recorder.path)


def test_a_second_recorder_does_not_replace_what_is_being_written(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    recorder = Recorder(path)
    ticks(recorder, 1, 500)
    recorder.flush()
    with pytest.raises(RecordingError, match="cannot be written: another process is writing it"):
        Recorder(path)
    with pytest.raises(RecordingError, match="is still being written: end its recorder first"):
        repair_session(path)
    recorder.close({})
    assert read_session(path).follower.size == 499


def memory(path: Path, hours: float) -> np.ndarray:
    script = Path(__file__).with_name("recorder_memory.py")
    done = subprocess.run([sys.executable, script, path, str(hours)], capture_output=True, text=True, check=True)
    sys.stdout.write(done.stdout)
    return np.array([float(line.split()[2]) for line in done.stdout.splitlines()])


@pytest.mark.parametrize(
    ("hours", "most"),
    [pytest.param(1 / 60, 512.0, marks=pytest.mark.long), pytest.param(10.0, 1024.0, marks=pytest.mark.soak)],
)
def test_a_minute_and_ten_hours_take_no_memory(hours: float, most: float, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    try:
        curve = memory(path, hours)
    finally:
        path.unlink(missing_ok=True)  # 9 GB in ten hours
    assert curve.size == 11
    assert curve.max() - curve[0] < most


# --- processes --------------------------------------------------------------------------------------------------------


class Sides:
    """Both sides of a session, said by one thread a thousand times a second, and what recorders say to them."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.failures: set[str] = set()
        self.longest_send = 0.0
        self.sent = 0
        self._ended = threading.Event()
        self._link = ZenohLink(listen=[self.endpoint], subscribe=["hello"])
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        begin = time.monotonic()
        while not self._ended.is_set():
            self.sent = n = self.sent + 1
            start = time.monotonic()
            for message in (leader(n), follower(n)):
                self._link.publish(msgspec.structs.replace(message, time_ns=time.monotonic_ns()))
            self.longest_send = max(self.longest_send, time.monotonic() - start)
            if n % 250 == 0:
                self._link.publish(hello("leader", n))
                self._link.publish(hello("follower", n))
                for _, message in self._link.take("hello"):
                    self.failures |= {
                        text
                        for name, text in zip(message.names, message.values, strict=True)
                        if name == "recorder_failed"
                    }
            time.sleep(max(0.0, begin + n * 1e-3 - time.monotonic()))

    def end(self) -> None:
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join()
            self._link.publish(Stop(VERSION, 1, time.monotonic_ns(), "the test is over"))
            time.sleep(0.3)
            self._link.close()


@pytest.fixture
def sides() -> Iterator[Sides]:
    made = Sides()
    yield made
    made.end()


def size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


@pytest.fixture
def record(sides: Sides) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []

    def start(path: Path, largest_file: int | None = None) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "foretouch", "record", str(path), "--connect", sides.endpoint]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        limit_files(process, largest_file)
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def limit_files(process: subprocess.Popen[str], largest: int | None) -> None:
    if largest is not None:
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (largest, largest))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no disk may be mounted here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.live
def test_a_killed_recorder_leaves_all_but_the_last_second(
    sides: Sides, record: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    paths = [tmp_path / f"{number}.mcap" for number in range(3)]
    recorders = [record(path) for path in paths]
    for number, (path, recorder) in enumerate(zip(paths, recorders, strict=True)):
        until(lambda path=path: size(path) > 150_000, 90.0)
        time.sleep(0.137 * number)
        killed_ns = time.monotonic_ns()
        recorder.kill()
        recorder.wait()
        log = read_session(path)
        assert log.counts.get("truncated") == 1
        for table in (log.leader, log.follower):
            assert killed_ns - table["time_ns"][-1] < 1_000_000_000
            assert (np.diff(table["sequence"]) >= 1).all()
        result = repair_session(path)
        whole = read_session(path)
        assert is_whole(path)
        assert not result.was_whole
        assert whole.leader.tobytes() == log.leader.tobytes()
        assert whole.follower.tobytes() == log.follower.tobytes()


@pytest.mark.live
def test_a_full_disk_and_a_removed_folder_are_said_at_once_and_the_recorder_stays(
    sides: Sides, record: Callable[..., subprocess.Popen[str]], tmp_path: Path, small_disk: Path
) -> None:
    limited, full, gone = tmp_path / "limited.mcap", small_disk / "full.mcap", tmp_path / "out" / "gone.mcap"
    gone.parent.mkdir()
    recorders = {limited: record(limited, 300_000), full: record(full), gone: record(gone)}
    until(lambda: size(gone) > 100_000, 90.0)
    shutil.rmtree(gone.parent)
    kept = tmp_path / "gone-kept.mcap"
    output = {
        limited: f"{limited}: cannot be written: File too large",
        full: f"{full}: cannot be written: No space left on device",
        gone: f"{gone}: was removed while it was written; it goes on as {kept}",
    }
    until(lambda: set(output.values()) <= sides.failures, 90.0)
    assert all(recorder.poll() is None for recorder in recorders.values())
    sides.end()
    for path, recorder in recorders.items():
        _, err = recorder.communicate(timeout=90)
        assert recorder.returncode == RECORDING_INCOMPLETE
        lines = [line for line in err.splitlines() if output[path] in line]
        assert len(lines) == 1
        assert "s are kept in" in lines[0]
        assert lines[0].endswith("the session goes on")
        assert "Traceback" not in err
    for path in (limited, full):
        log = read_session(path)
        assert is_whole(path)
        assert log.counts == {"truncated": 1, **{name: log.counts[name] for name in log.counts if name != "truncated"}}
        assert log.follower.size > 500
    log = read_session(kept)
    assert is_whole(kept)
    assert log.follower["sequence"][-1] == sides.sent
    assert "truncated" not in log.counts


@pytest.mark.live
@pytest.mark.long
def test_a_recorder_that_stands_still_blocks_nobody_and_counts_what_it_missed(
    sides: Sides, record: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    path = tmp_path / "session.mcap"
    recorder = record(path)
    until(lambda: size(path) > 100_000, 90.0)
    recorder.send_signal(signal.SIGSTOP)
    before, sides.longest_send = sides.sent, 0.0
    time.sleep(3.0)
    recorder.send_signal(signal.SIGCONT)
    assert sides.sent - before > 1000
    assert sides.longest_send < 1.0
    time.sleep(1.0)
    sides.end()
    assert recorder.wait(60) == 0
    log = read_session(path)
    gaps = sum(int((np.diff(table["sequence"]) - 1).sum()) for table in (log.leader, log.follower))
    assert log.counts["recorder_missed"] == gaps
    assert log.follower["sequence"][-1] == sides.sent


@pytest.mark.live
def test_what_a_full_inbox_pushes_out_is_counted(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    stop, output, path = StopFlag(), [], tmp_path / "session.mcap"
    with ZenohLink(listen=[endpoint], subscribe=RECORDER_CHANNELS) as link, ZenohLink(connect=[endpoint]) as far:
        until(lambda: far.publish(follower(1)) or link.inboxes["telemetry"], 90.0)
        for n in range(1, 23_001):
            far.publish(follower(n))
            if n % 100 == 0:
                time.sleep(0.002)
        until(lambda: link.inboxes["telemetry"][-1][1].sequence == 23_000, 90.0)
        dropped = link.dropped
        threading.Timer(1.0, stop.set, ["the test is over"]).start()
        assert run_recorder(link, path, stop=stop, say=output.append) == ""
    log = read_session(path)
    assert log.follower.size == 20_000
    assert dropped > 2500
    assert log.counts["recorder_dropped"] == dropped
    assert f"recorder: {dropped:,} messages came too fast to be written" in output


@pytest.mark.live
@pytest.mark.long
@pytest.mark.parametrize("largest_file", [400_000, None], ids=["full disk", "recorder killed"])
def test_a_session_outlives_a_full_disk_and_its_recorder(tmp_path: Path, largest_file: int | None) -> None:
    path = tmp_path / "session.mcap"
    options = ("--headless", "--material", "hunt-crossley", "--operator", "scripted", "--duration", 5, "--json")
    with Running("teleop", *options, "--recording", path) as session:
        pid = session.process.pid
        limit_files(session.process, largest_file)
        if largest_file is None:
            until(lambda: size(path) > 300_000, 90.0)
            for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
                if b"record" in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0"):
                    os.kill(int(child), signal.SIGKILL)
        code, out, err = session.wait(90)
    assert code == RECORDING_INCOMPLETE, err
    if largest_file is None:
        assert "the recorder ended with exit code -9; the session goes on without it" in err
        assert f"`foretouch recordings repair {path}` makes it whole" in err
    else:
        assert f"recorder: {path}: cannot be written: File too large; " in err
        assert "the recording is not all there: " in err
        # Whole, where there was room for its index behind the last of its messages.
        assert f"{path}: ends before its session did" in err or f"recordings repair {path}` makes it whole" in err
        assert 200_000 < path.stat().st_size <= largest_file
    assert json.loads(out)["counts"]["truncated"] == 1
    assert "Traceback" not in err

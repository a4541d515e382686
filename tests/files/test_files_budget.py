"""Whatever a reader does, the process that asks gets its result or one line."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import hungry
import numpy as np
import pytest

from foretouch.errors import InputError, RecordingError, SettingError, UnknownNameError
from foretouch.files import Budget, budget_for, read_toml, within, within_budget
from foretouch.recordings import Mapping, read_recording, read_session, repair_session
from foretouch.rendering.surfaces import read_mesh


@pytest.fixture(autouse=True, scope="module")
def _from_here() -> Iterator[None]:
    """The process that reads finds the readers of these tests, and ends with them."""
    within.close()
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent))
        yield
    within.close()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.csv"
    path.write_text("time_s,position_m,force_N\n0,0,0\n0.001,0.0001,0.1\n")
    return path


def test_the_budget_follows_the_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORETOUCH_FILE_BUDGET", raising=False)
    path = tmp_path / "a.mcap"
    assert budget_for(path) == Budget(900_000_000, 15, 1.0, 0)
    with path.open("wb") as opened:
        os.posix_fallocate(opened.fileno(), 0, 400_000_000)
    assert budget_for(path) == Budget(1_200_000_000, 160, 1.0, 400_000_000)
    assert budget_for(tmp_path) == budget_for(path)
    assert budget_for(path, 2.0) == Budget(2_400_000_000, 320, 2.0, 400_000_000)
    monkeypatch.setenv("FORETOUCH_FILE_BUDGET", "4")
    assert budget_for(tmp_path / "none") == Budget(3_600_000_000, 60, 4.0, 0)
    assert budget_for(path, math.inf) is None


def test_a_hole_buys_no_budget(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n")
    os.truncate(path, 100_000_000_000)
    assert budget_for(path, 1.0)[:3] == (900_000_000, 15, 1.0)
    assert budget_for(tmp_path, 1.0)[:3] == (900_000_000, 15, 1.0)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    """A pipe that nobody writes to, and a device that never ends, whoever reads them."""
    for name in ("a.mcap", "a.stl", "a.toml", "a.csv"):
        os.mkfifo(tmp_path / name)
    readers = [
        lambda: within_budget(tmp_path / "a.csv", None, hungry.given_back),
        lambda: within_budget("/dev/zero", math.inf, hungry.given_back),
        lambda: read_session(tmp_path / "a.mcap"),
        lambda: repair_session(tmp_path / "a.mcap"),
        lambda: read_toml(tmp_path / "a.toml", Mapping, "map"),
        lambda: read_mesh(tmp_path / "a.stl"),
    ]
    begun = time.monotonic()
    for read in readers:
        with pytest.raises(InputError, match="is no file"):
            read()
    assert time.monotonic() - begun < 10.0


def test_a_reader_that_waits_is_not_given_the_time_to_start(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(within, "PATIENCE", 0.5)
    assert within_budget(file, None, hungry.given_back) == ((), {})
    begun = time.monotonic()
    with pytest.raises(RecordingError, match="takes more than 1 s"):
        within_budget(file, 0.05, time.sleep, 60.0)
    assert time.monotonic() - begun < 10.0


@pytest.mark.parametrize("said", ["0", "-1", "nan", "much"])
def test_a_factor_that_is_none_is_refused(said: str, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORETOUCH_FILE_BUDGET", said)
    with pytest.raises(SettingError, match=r"FORETOUCH_FILE_BUDGET = .*must be a number above 0"):
        read_recording(file)


def test_a_result_comes_back_as_it_was(file: Path) -> None:
    assert within_budget(file, None, hungry.given_back, 1, "ü", path=file) == ((1, "ü"), {"path": file})
    result = within_budget(file, None, hungry.arrays, 100_000)
    wanted = hungry.arrays(100_000)
    assert all(np.array_equal(result[name], wanted[name]) for name in wanted)
    assert not result["fixed"].flags.writeable
    result["free"][0, 0] = 7.0  # nobody else sees it
    assert result["free"].flags.aligned


def test_it_was_another_process_but_for_no_limit(file: Path) -> None:
    first, second = within_budget(file, None, hungry.process), within_budget(file, None, hungry.process)
    assert len({first, second, os.getpid()}) == 3
    assert within_budget(file, math.inf, hungry.process) == os.getpid()


REFUSED = {
    "hungry": ((2 * 10**9,), r"takes more than 900 MB of memory, the most for a file of 0.\d+ kB: .*FILE_BUDGET=4 "),
    "busy": ((), r"takes more than 1 s, .*FORETOUCH_FILE_BUDGET=0.2"),
    "busy_in_the_library": ((), r"takes more than 1 s"),
    "deep": ((), r"is nested too deep"),
    "crashed": ((), r"its reader crashed on it \(SIGSEGV\)"),
    "killed": ((), r"takes more than 900 MB of memory"),
    "odd": ((), r"cannot be read: KeyError 'a key\\nof two lines'"),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [name if name != "busy_in_the_library" else pytest.param(name, marks=pytest.mark.long) for name in REFUSED]
)
def test_what_goes_wrong_is_one_line(name: str, file: Path) -> None:
    given, output = REFUSED[name]
    factor = 0.05 if "1 s" in output else None
    with pytest.raises(RecordingError, match=output) as caught:
        within_budget(file, factor, getattr(hungry, name), *given)
    assert len(str(caught.value).splitlines()) == 1
    assert str(caught.value).startswith(f"{file}: ")
    assert within_budget(file, None, hungry.given_back) == ((), {})  # and the next file is read


def test_memory_is_told_also_where_a_reader_takes_it_for_damage(file: Path) -> None:
    with pytest.raises(RecordingError, match="takes more than 900 MB of memory"):
        within_budget(file, None, hungry.hungry_with_a_line_of_its_own, str(file), 10**10)
    with pytest.raises(RecordingError, match="takes more than 200 MB"):
        within_budget(file, 200 / 900, hungry.hungry, 3 * 10**8)
    assert within_budget(file, 800 / 900, hungry.hungry, 3 * 10**8) == 0


def test_errors_come_back_as_they_were(file: Path) -> None:
    with pytest.raises(RecordingError, match="row 7: one line") as caught:
        within_budget(file, None, hungry.refused, str(file))
    assert (caught.value.row, caught.value.source) == (7, str(file))
    with pytest.raises(UnknownNameError) as unknown:
        within_budget(file, None, hungry.unknown)
    assert unknown.value.choices == ["b", "c"]


def test_relative_names_are_those_of_who_asks(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in (file.parent, file.parent.parent):
        monkeypatch.chdir(folder)
        assert len(read_recording(os.path.relpath(file))) == 2


def test_threads_read_at_once(file: Path) -> None:
    counts: list[int] = []
    threads = [threading.Thread(target=lambda: counts.append(len(read_recording(file)))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counts == [2] * 8


@pytest.mark.long
def test_a_script_without_a_guard_reads_and_so_does_a_copy_of_its_process(file: Path) -> None:
    """As worker processes that are forked do; what lies in the working folder is not imported by who reads."""
    (file.parent / "numpy.py").write_text("raise SystemExit('taken for numpy')")
    code = (
        "import os\nfrom foretouch import read_recording\n"
        f"print(len(read_recording({str(file)!r})), flush=True)\n"
        "copy = os.fork()\n"
        f"assert len(read_recording({str(file)!r})) == 2\n"
        "if copy: assert os.waitpid(copy, 0)[1] == 0\n"
    )
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, cwd=file.parent, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "2\n", "")


def gone(process: int) -> bool:
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        if not Path(f"/proc/{process}").exists():
            return True
        time.sleep(0.02)
    return False


def reading(note: Path) -> int:
    """The process that reads, once it does."""
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        if note.is_file() and note.read_text():
            return int(note.read_text())
        time.sleep(0.02)
    raise AssertionError("it has not begun")


def asking(file: Path, note: Path) -> subprocess.Popen[str]:
    """A process that asks for a reading that never ends and, should it be interrupted, for another.

    It heeds Ctrl+C also where the tests run in the background of a shell, which has its processes ignore it.
    """
    asked = f"{str(file)!r}, None, hungry.begun, {str(note)!r}"
    again = f"within_budget({str(file)!r}, None, hungry.given_back)"
    code = (
        "import signal, hungry\nfrom foretouch.files import within_budget\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"try: within_budget({asked})\nexcept KeyboardInterrupt: print({again})\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)


def test_ctrl_c_ends_whoever_reads(file: Path) -> None:
    note = file.parent / "note"
    with asking(file, note) as process:
        reader = reading(note)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60)[0].strip() == "((), {})"
    assert gone(reader)


def test_who_is_killed_leaves_nobody_behind(file: Path) -> None:
    note = file.parent / "note"
    with asking(file, note) as process:
        reader = reading(note)
        process.kill()
    assert gone(reader)


@pytest.mark.long
def test_a_server_that_has_gone_is_started_again(file: Path) -> None:
    assert within_budget(file, None, hungry.given_back) == ((), {})
    assert within._server is not None
    within._server._socket.shutdown(2)  # as when it has waited for long enough
    assert within_budget(file, None, hungry.given_back) == ((), {})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = " + "[" * 8_000 + "]" * 8_000, "is no map: it is nested too deep"),
        ("x = 1\n" * 20_000, "is no map: it is longer than 16384 bytes"),
        ("x = ", "is no map: .*; it takes columns"),
    ],
)
def test_toml_is_small_and_not_deep(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_toml(tmp_path / "a.toml", Mapping, "map", "columns")
    assert len(str(caught.value).splitlines()) == 1

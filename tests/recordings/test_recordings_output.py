import os
import stat
import subprocess
import sys

import numpy as np
import pytest

from foretouch.errors import MissingExtraError, RecordingError
from foretouch.recordings import atomic_path, read_recording, write_columns

TIME = np.arange(5) / 7
COLUMNS = {"time_s": TIME, "position_m": np.sin(TIME), "force_N": np.array([1e-300, -0.0, 1 / 3, 5e-324, 1.7e308])}


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_written_reads_back_bit_by_bit(tmp_path, suffix):
    path = tmp_path / f"out{suffix}"
    write_columns(path, COLUMNS)
    recording = read_recording(path)
    for values, name in zip(COLUMNS.values(), ("time", "position", "force"), strict=True):
        assert getattr(recording, name).tobytes() == values.tobytes()
    assert os.listdir(tmp_path) == [path.name]


def test_csv_is_plain(tmp_path):
    path = tmp_path / "out.csv"
    write_columns(path, {"time_s": [0.0, 0.001], "in_contact": np.array([True, False]), "n": [1, 2]})
    assert path.read_bytes() == b"time_s,in_contact,n\n0,1,1\n0.001,0,2\n"
    write_columns(path, {"x": [float("nan"), float("-inf")]})
    assert np.isnan(np.loadtxt(path, skiprows=1)[0])


def test_bad_outputs_are_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"must end with \.csv or \.parquet"):
        write_columns(tmp_path / "out.txt", COLUMNS)
    with pytest.raises(RecordingError, match="unequal length"):
        write_columns(tmp_path / "out.csv", {"a": [1.0], "b": [1.0, 2.0]})
    with pytest.raises(RecordingError, match="cannot be written: No such file or directory"):
        write_columns(tmp_path / "absent" / "out.csv", COLUMNS)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(RecordingError, match="no regular file"):
        write_columns(tmp_path / "folder.csv", COLUMNS)
    assert sorted(os.listdir(tmp_path)) == ["folder.csv"]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "out.json"
    path.write_text("old")

    def fail_halfway():
        with atomic_path(path) as part:
            part.write_text("half")
            raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError, match="interrupted"):
        fail_halfway()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.json"]
    with atomic_path(path) as part:
        part.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) & 0o400


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target.csv", tmp_path / "link.csv"
    target.write_text("old")
    link.symlink_to(target)
    write_columns(link, {"a": [1.5]})
    assert link.is_symlink()
    assert target.read_text() == "a\n1.5\n"


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"pyarrow is not installed: pip install .*\[recordings\]'"):
        write_columns(tmp_path / "out.csv", COLUMNS)


def test_importing_the_room_imports_no_optional_package():
    code = (
        "import sys, foretouch.recordings as r; "
        "print(sorted({'pyarrow', 'mcap', 'pooch', 'scipy.io', 'requests'} & set(sys.modules)), "
        "all(hasattr(r, name) for name in r.__all__))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[] True"

"""Tables of others: CSV in other languages, HDF5 by h5py, MATLAB by SciPy, Parquet by pandas."""

import sys

import h5py
import numpy as np
import pandas
import pytest
from made_bags import press
from refusals import refused
from scipy.io import savemat

from foretouch.errors import MissingExtraError
from foretouch.recordings import inspect_recording, read_recording, read_with_notes

TIME, POSITION, FORCE = press(0.2)


def assert_press(recording, rtol=1e-15):
    assert recording.time.tobytes() == TIME.tobytes()
    np.testing.assert_allclose(recording.position, POSITION, rtol=rtol)
    assert recording.force.tobytes() == FORCE.tobytes()


@pytest.fixture
def map_file(tmp_path):
    def write(position, force, time='column = "t"', unit="m"):
        path = tmp_path / "map.toml"
        path.write_text(
            f"[time]\n{time}\n[position]\ncolumn = {position!r}\nunit = {unit!r}\n"
            f"[force]\ncolumn = {force!r}\nunit = 'N'\n"
        )
        return path

    return write


@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize("decimal", [",", "."])
def test_a_spreadsheet_in_another_language(tmp_path, separator, decimal):
    if separator == decimal:
        return
    path = tmp_path / "messung.csv"
    frame = pandas.DataFrame({"Zeit [s]": TIME, "Weg [mm]": 1e3 * POSITION, "Kraft [N]": FORCE, "Bemerkung": "gut"})
    frame.to_csv(path, sep=separator, decimal=decimal, index=False)
    read = read_with_notes(path)
    assert_press(read.recording)
    assert 'column = "Weg [mm]"; unit = "mm"' in read.notes[0]


def test_a_decimal_comma_is_read_the_same_without_pyarrow(tmp_path, monkeypatch):
    path = tmp_path / "messung.csv"
    frame = pandas.DataFrame({"Zeit [s]": TIME, "Weg [mm]": 1e3 * POSITION, "Kraft [N]": FORCE})
    frame.to_csv(path, sep=";", decimal=",", index=False)
    fast = read_recording(path)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    slow = read_recording(path)
    assert fast.position.tobytes() == slow.position.tobytes()


def test_what_the_names_leave_open_is_asked_for(tmp_path):
    path = tmp_path / "press.csv"
    pandas.DataFrame({"t": TIME, "x": 1e3 * POSITION, "force": FORCE}).to_csv(path, index=False)
    assert "the unit of the position x is not known" in refused(path)
    assert "the unit of force is not known" in refused(path, position_unit="mm")
    path.write_text(path.read_text().replace("force", "force_N", 1))
    assert_press(read_recording(path, position_unit="mm"))
    np.testing.assert_array_equal(
        read_recording(path, position_unit="mm", flip=True).position, -read_recording(path, position_unit="mm").position
    )
    path.write_text(path.read_text().replace(",x,", ",x [mm],", 1))
    assert "is in mm: leave --position-unit out" in refused(path, position_unit="um")


def test_columns_of_a_map_that_are_not_there(tmp_path, map_file):
    path = tmp_path / "press.csv"
    pandas.DataFrame({"t": TIME, "x": POSITION, "f": FORCE}).to_csv(path, index=False)
    assert "row 1: column y missing; the columns are t, x, f" in refused(path, map_file=map_file("y", "f"))
    assert "a map states units" in refused(path, map_file=map_file("x", "f"), flip=True)
    assert_press(read_recording(path, map_file=map_file("x", "f")))
    assert "column s missing" in refused(path, map_file=map_file("x", "f", 'column = "s"'))
    assert "takes [time] column, or rate" in refused(path, map_file=map_file("x", "f", ""))
    by_rate = read_recording(path, map_file=map_file("x", "f", "rate = 1000.0"))
    assert_press(by_rate)
    lines = path.read_text().splitlines()
    lines[7] = "nan,1,1"
    path.write_text("\n".join(lines))
    assert "row 8: time is nan: every value must be finite" in refused(path, map_file=map_file("x", "f"))


def write_hdf5(path, **options):
    with h5py.File(path, "w", **options) as file:
        file["run/time"] = TIME
        file["run/time"].attrs["units"] = "s"
        file["run/position"] = 1e3 * POSITION
        file["run/position"].attrs["unit"] = "mm"
        file["run/force"] = FORCE
        file["run/force"].attrs["unit"] = "N"
        file["run/wrench"] = np.column_stack([0 * FORCE, 0 * FORCE, FORCE])
        file["run/title"] = "a press"
        table = np.zeros(TIME.size, dtype=[("stamp", "f8"), ("z", "f8"), ("note", "S3")])
        table["z"] = POSITION
        file["table"] = table
    return path


@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
def test_hdf5_with_units_needs_no_map(tmp_path, suffix):
    path = write_hdf5(tmp_path / f"press{suffix}")
    result = {column.name: (column.count, column.unit) for column in inspect_recording(path).columns}
    assert result["run/position"] == (TIME.size, "mm")
    assert result["run/wrench[2]"] == (TIME.size, "")
    assert "table.z" in result
    assert "run/title" not in result
    assert_press(read_recording(path))


def test_hdf5_by_a_map(tmp_path, map_file):
    path = write_hdf5(tmp_path / "press.h5")
    recording = read_recording(path, map_file=map_file("table.z", "run/wrench[2]", 'column = "run/time"'))
    assert_press(recording)
    assert "column t, run/forces missing; the columns are" in refused(path, map_file=map_file("table.z", "run/forces"))
    with h5py.File(path, "a") as file:
        file["run/short"] = FORCE[:-1]
    output = refused(path, map_file=map_file("table.z", "run/short", 'column = "run/time"'))
    assert "columns of unequal length: run/time 200, table.z 200, run/short 199" in output
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert "is no HDF5 file that can be read" in refused(path)
    path.write_bytes(b"not HDF5")
    assert "is no HDF5 file that can be read" in refused(path)


def test_matlab_variables_and_structures(tmp_path, map_file):
    path = tmp_path / "press.mat"
    savemat(path, {"time_s": TIME, "Weg_mm": 1e3 * POSITION[:, None], "force_N": FORCE[None, :], "note": "hello"})
    assert_press(read_recording(path))
    signals = np.zeros(2, dtype=object)
    signals[:] = [{"values": np.column_stack([POSITION, FORCE])}, {"values": np.arange(3.0)}]
    savemat(path, {"log": {"t": TIME, "signals": signals, "big": np.zeros((100, 200, 3))}})
    recording = read_recording(
        path, map_file=map_file("log.signals[0].values[0]", "log.signals[0].values[1]", 'column = "log.t"')
    )
    assert_press(recording)


def test_a_matlab_file_with_several_candidates_names_them(tmp_path):
    path = tmp_path / "press.mat"
    savemat(path, {"time_s": TIME, "position_mm": 1e3 * POSITION, "force_left_N": FORCE, "force_right_N": FORCE})
    assert "several columns could be force: force_left_N, force_right_N; `foretouch recordings inspect`" in refused(
        path
    )
    guess = inspect_recording(path).guess
    assert "# force could be force_left_N\n# force could be force_right_N\n" in guess.text()
    assert 'column = "position_mm"\nunit = "mm"' in guess.text()


def test_matlab_7_3_is_read_as_hdf5(tmp_path):
    """As MATLAB writes them: HDF5 behind a block of 512 bytes, columns as rows, text as numbers with their class."""
    path = tmp_path / "press.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time_s", TIME), ("position_mm", 1e3 * POSITION), ("force_N", FORCE)):
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["note"] = np.array([[104], [105]], dtype=np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"] = np.arange(5.0)
    content = bytearray(path.read_bytes())
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64"
    content[:128] = head.ljust(116) + bytes(8) + b"\x00\x02IM"
    path.write_bytes(content)
    result = inspect_recording(path)
    assert result.format == "MATLAB 7.3 (HDF5)"
    assert [column.name for column in result.columns] == ["force_N", "position_mm", "time_s"]
    assert_press(read_recording(path))


def test_parquet_of_pandas(tmp_path):
    path = tmp_path / "press.parquet"
    pandas.DataFrame({"Zeit [s]": TIME, "Weg [mm]": 1e3 * POSITION, "Kraft [N]": FORCE}).to_parquet(path)
    assert_press(read_recording(path))


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize(
    ("module", "name"), [("h5py", "press.h5"), ("pyarrow.parquet", "press.parquet"), ("rosbags.rosbag2", "bag.db3")]
)
def test_a_missing_package_names_the_extra(tmp_path, monkeypatch, module, name):
    (tmp_path / name).write_bytes(b"")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"is not installed: pip install .*\[recordings\]'"):
        read_recording(tmp_path / name)

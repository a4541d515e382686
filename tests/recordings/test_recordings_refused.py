"""Files that would be read wrong, and outputs that would destroy what is read: refused in one line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import InputError, RecordingError, SettingError
from foretouch.identification import Learner, identify, make_estimator
from foretouch.recordings import inspect_recording, read_recording, read_with_notes

TIME = np.arange(2000) * 1e-3
POSITION = 5e-3 * (1.0 - np.cos(2.0 * np.pi * TIME))
FORCE = 500.0 * np.maximum(POSITION - 1e-3, 0.0)


def written(path: Path, header: str, *columns: np.ndarray, mark: str = ",", encoding: str = "utf-8") -> Path:
    rows = [mark.join(f"{value:.6f}" for value in row) for row in zip(*columns, strict=True)]
    path.write_bytes("\n".join([header, *rows, ""]).encode(encoding))
    return path


def test_a_point_of_thousands_beside_decimal_commas_is_refused_with_its_row(tmp_path: Path) -> None:
    path = tmp_path / "german.csv"
    rows = [f"{t:.3f};{1e6 * x:.0f};{f:.4f}".replace(".", ",") for t, x, f in zip(TIME, POSITION, FORCE, strict=True)]
    path.write_text("\n".join(["Zeit [s];Weg [µm];Kraft [N]", *rows]))
    np.testing.assert_allclose(read_recording(path).position, POSITION, atol=1e-6)
    rows[1700] = "1,700;5.000;0,0013"
    path.write_text("\n".join(["Zeit [s];Weg [µm];Kraft [N]", *rows]))
    with pytest.raises(RecordingError, match=r"row 1702: Weg \[µm\] is '5.000'.*without a point"):
        read_recording(path)


def test_times_whose_unit_nobody_states_are_not_taken_for_seconds_where_that_is_unlikely(tmp_path: Path) -> None:
    path = written(tmp_path / "ms.csv", "time,position_mm,force_N", 1e3 * TIME, 1e3 * POSITION, FORCE)
    with pytest.raises(RecordingError, match=r"time time states no unit, and in seconds its steps are 1 s"):
        read_recording(path)
    path = written(tmp_path / "s.csv", "time,position_mm,force_N", TIME, 1e3 * POSITION, FORCE)
    assert read_recording(path).time[-1] == pytest.approx(1.999)


@pytest.mark.parametrize(("unit", "seconds"), [("min", 60.0), ("h", 3600.0), ("ms", 1e-3)])
def test_times_in_units_that_are_stated_are_read(tmp_path: Path, unit: str, seconds: float) -> None:
    path = tmp_path / "t.csv"
    rows = [f"{t / seconds:.12g},{1e3 * x:.6f},{f:.6f}" for t, x, f in zip(TIME, POSITION, FORCE, strict=True)]
    path.write_text("\n".join([f"Time ({unit}),Displacement (mm),Load (N)", *rows]))
    np.testing.assert_allclose(read_recording(path).time, TIME, atol=1e-9)


def test_a_unit_of_time_that_is_not_known_stays_open(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", "Time (fortnight),Displacement (mm),Load (N)", TIME, 1e3 * POSITION, FORCE)
    with pytest.raises(RecordingError, match=r"the unit of time Time \(fortnight\) is not known \(s, ms"):
        read_recording(path)


def test_what_a_western_spreadsheet_writes_is_read(tmp_path: Path) -> None:
    header = "Zeit [s];Weg [µm];Kraft [N]"
    path = written(tmp_path / "excel.csv", header, TIME, 1e6 * POSITION, FORCE, mark=";", encoding="cp1252")
    np.testing.assert_allclose(read_recording(path).position, POSITION, atol=1e-9)


def test_a_remark_that_names_no_columns_is_no_header(tmp_path: Path) -> None:
    path = written(tmp_path / "remark.csv", "# made by a machine", TIME, POSITION, FORCE)
    with pytest.raises(RecordingError, match="columns have no names but numbers"):
        read_recording(path)


def test_what_was_asked_for_is_not_taken_for_what_was_measured(tmp_path: Path) -> None:
    header = "time_s,position_command_mm,position_actual_mm,force_setpoint_N,force_N"
    path = written(tmp_path / "two.csv", header, TIME, 0.0 * POSITION, 1e3 * POSITION, 0.0 * FORCE, FORCE)
    read = read_with_notes(path).recording
    np.testing.assert_allclose(read.position, POSITION, atol=1e-8)
    np.testing.assert_allclose(read.force, FORCE, atol=1e-5)
    with pytest.raises(RecordingError, match=r"force_N missing; the columns are .* force_setpoint_N"):
        read_with_notes(written(tmp_path / "set.csv", "time_s,position_mm,force_setpoint_N", TIME, POSITION, FORCE))


def test_several_candidates_are_named_although_one_column_has_its_agreed_name(tmp_path: Path) -> None:
    header = "time_s,position_left_mm,position_right_mm,force_N"
    path = written(tmp_path / "two.csv", header, TIME, 1e3 * POSITION, 1e3 * POSITION, FORCE)
    with pytest.raises(RecordingError, match=r"several columns could be position: position_left_mm.*--map"):
        read_recording(path)


@pytest.mark.parametrize("save", ["press.csv", "map.txt", "there.toml"])
def test_a_saved_map_replaces_nothing(tmp_path: Path, save: str) -> None:
    path = written(tmp_path / "press.csv", "time_s,position_m,force_N", TIME, POSITION, FORCE)
    (tmp_path / "there.toml").write_text("# completed by hand\n")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    done = CliRunner().invoke(app, ["recordings", "inspect", str(path), "--save", str(tmp_path / save)])
    assert isinstance(done.exception, SettingError)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_saved_map_is_replaced_if_that_is_asked_for_and_the_same_one_is_no_mistake(tmp_path: Path) -> None:
    path = written(tmp_path / "press.csv", "time_s,position_m,force_N", TIME, POSITION, FORCE)
    save = tmp_path / "map.toml"
    save.write_text("# completed by hand\n")
    words = ["recordings", "inspect", str(path), "--save", str(save)]
    assert "--overwrite" in str(CliRunner().invoke(app, words).exception)
    for again in ([*words, "--overwrite"], words):
        assert CliRunner().invoke(app, again).exit_code == 0
        assert "position_m" in save.read_text()
    (tmp_path / "folder.toml").mkdir()
    assert "no regular file" in str(CliRunner().invoke(app, [*words[:-1], str(tmp_path / "folder.toml")]).exception)


def test_nothing_is_written_into_a_bag_that_is_read(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "bag.mcap").write_bytes(b"storage")
    for words in (["convert", str(bag), str(bag / "bag.mcap")], ["inspect", str(bag), "--save", str(bag / "m.toml")]):
        done = CliRunner().invoke(app, ["recordings", *words])
        assert isinstance(done.exception, SettingError), words
        assert re.search("is the recording itself, or within it", str(done.exception))
    assert (bag / "bag.mcap").read_bytes() == b"storage"


def test_a_learner_that_has_learnt_is_not_taken_for_another_recording(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path / "a.csv", "time_s,position_m,force_N", TIME, POSITION, FORCE))
    learner = Learner(make_estimator("kelvin-voigt", "rls"))
    identify(recording, learner)
    with pytest.raises(InputError, match="make a fresh one"):
        identify(recording, learner)


def test_inspect_says_what_is_missing_and_where_time_goes_back(tmp_path: Path) -> None:
    time, force = TIME.copy(), FORCE.copy()
    force[[3, 7]] = np.nan
    time[5] = time[4]
    time[9] = time[2]
    path = written(tmp_path / "bad.csv", "time_s,position_m,force_N", time, POSITION, force)
    notes = inspect_recording(path).notes
    assert f"{path}, row 5: force_N is nan; 2 of 2,000 values are no finite number" in notes
    again = "the first of 2 rows in which it does not increase"
    assert f"{path}, row 7: time_s stands still at 0.004, {again}" in notes
    path.write_text("time_s,position_m,force_N\n0,0,0\n1,,0\n0.5,0,nan\n")
    notes = inspect_recording(path).notes
    assert f"{path}, row 3: position_m is '', which is no number (nothing there)" in notes
    assert f"{path}, row 4: force_N is nan; 1 of 3 values is no finite number" in notes
    assert f"{path}, row 4: time_s goes back from 1 to 0.5" in notes
    assert CliRunner().invoke(app, ["recordings", "inspect", str(path)]).stdout.count("row 4") == 2

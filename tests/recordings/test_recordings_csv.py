import re
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal, refused

from foretouch.errors import RecordingWarning, UnknownNameError
from foretouch.recordings import RecordingOptions, read_recording, read_with_notes
from foretouch.recordings.formats import tables as csv_table
from foretouch.recordings.meaning.names import REQUIRED

GOOD = "time_s,position_m,force_N\n0,0.001,0.5\n0.001,0.002,0.75\n0.002,0.003,1\n"


@pytest.fixture
def table(tmp_path):
    def write(content, name="press.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def assert_good(recording):
    assert recording.time.tolist() == [0.0, 0.001, 0.002]
    assert recording.position.tolist() == [0.001, 0.002, 0.003]
    assert recording.force.tolist() == [0.5, 0.75, 1.0]


def test_reads_the_columns_and_nothing_else(table):
    path = table(GOOD)
    recording = read_recording(path)
    assert_good(recording)
    assert recording.velocity is None
    assert recording.name == str(path)
    assert recording.contact_floor == 0.05


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf" + GOOD.encode(),
        GOOD.replace("\n", "\r\n"),
        GOOD + "\n\n  \n",
        GOOD.rstrip("\n"),
        GOOD.replace(",", " , "),
        "note,force_N,time_s,,position_m,\nhé;,0.5,0,,0.001,\n,0.75,0.001,x,0.002,\n,1,0.002,,0.003,\n",
        '"time_s","position_m","force_N"\n"0","0.001","0.5"\n0.001,0.002,0.75\n0.002,0.003,1e0\n',
        GOOD.replace("\n0.002", "\n\n0.002"),
    ],
    ids=["bom", "crlf", "blank-end", "no-newline", "spaces", "order-and-extras", "quotes", "blank-inside"],
)
def test_tolerates(table, content):
    assert_good(read_recording(table(content)))


def test_extra_text_in_another_encoding_is_ignored(table):
    content = b"time_s,position_m,force_N,who\n0,0.001,0.5,Andr\xe9\n0.001,0.002,0.75,\n0.002,0.003,1,\n"
    assert_good(read_recording(table(content)))


def test_velocity_is_read_where_it_is_there(table):
    recording = read_recording(table("time_s,position_m,force_N,velocity_m_s\n0,0,0,1\n1,0.5,0,-2\n"))
    assert recording.velocity.tolist() == [1.0, -2.0]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0), ("um", 1e6)])
@pytest.mark.parametrize(("force_unit", "force_factor"), [("N", 1.0), ("mN", 1000.0), ("cN", 100.0), ("kN", 1e-3)])
@pytest.mark.parametrize("flip", [False, True])
def test_units_and_flip(table, unit, factor, force_unit, force_factor, flip):
    content = "time_s,position_m,force_N,velocity_m_s\n0,0.5,0.25,3\n1,0.75,0.3,4\n"
    recording = read_recording(table(content), position_unit=unit, force_unit=force_unit, flip=flip)
    sign = -1.0 if flip else 1.0
    assert recording.position.tolist() == [sign * 0.5 / factor, sign * 0.75 / factor]
    assert recording.velocity.tolist() == [sign * 3 / factor, sign * 4 / factor]
    assert recording.force.tolist() == [0.25 / force_factor, 0.3 / force_factor]
    assert recording.time.tolist() == [0.0, 1.0]


def test_options_are_one_object_or_are_named_and_not_both(table):
    path, given = table(GOOD), RecordingOptions(position_unit="mm", flip=True)
    result, named = read_recording(path, given), read_recording(path, position_unit="mm", flip=True)
    assert result.position.tobytes() == named.position.tobytes() != read_recording(path).position.tobytes()
    with pytest.raises(TypeError, match="options are given, and flip beside them"):
        read_recording(path, given, flip=True)
    with pytest.raises(TypeError, match="flop"):
        read_recording(path, flop=True)


@pytest.mark.parametrize("option", [{"position_unit": "inch"}, {"force_unit": "kg"}, {"force_channel": "other"}])
def test_unknown_units_are_refused_with_those_there_are(table, option):
    with pytest.raises(UnknownNameError, match="choose one of"):
        read_recording(table(GOOD), **option)


@pytest.mark.parametrize(
    ("content", "row", "problem"),
    [
        (
            "time,depth,force\n0,0,0\n",
            None,
            r"the unit of depth is not known \(m, .*\); the unit of force is not known \(N, .*\): "
            "give --position-unit mm and --force-unit N, say; or .*--map",
        ),
        ("time_s,position_m,force\n0,0,0\n", None, "the unit of force is not known.*: give --force-unit N, say; or "),
        ("time_s,position,force_N\n0,0,0\n1,0,0\n", None, "unit of position is not known.*--position-unit mm, say"),
        ("time_s;position_m;force_N\n0;0;0\n", None, "1 sample: at least 2"),
        ("time_s;position_m;force_N\n0;0;0\n1;0\n", 3, "2 values, the header names 3 columns"),
        ("0,0.001,0.5\n0.001,0.002,0.75\n", None, r"columns have no names but numbers \(0, 0.001, 0.5\): write"),
        ("time_s,force_N,position_m,force_N\n0,0,0,0\n1,0,0,0\n", 1, "column force_N is there 2 times"),
        (GOOD + "0.003,0.004,abc\n", 5, "force_N is 'abc', which is no number"),
        (GOOD + "0.003,,1\n", 5, "position_m is '', which is no number"),
        (GOOD + "0.003,NaN,1\n", 5, "position is nan: every value must be finite"),
        (GOOD + "0.003,0.001,inf\n0.004,0,0\n", 5, "force is inf: every value must be finite"),
        (GOOD + "0.003,0.001,1_0\n", 5, "'1_0', which is no number"),
        (GOOD + "0.003,0.001\n", 5, "2 values, the header names 3 columns"),
        (GOOD + "0.003,0.001,1,2\n", 5, "4 values, the header names 3 columns"),
        (GOOD + "0.002,0.004,1\n", 5, "time 0.002 s does not come after the row before"),
        (GOOD + "0.001,0.004,1\n", 5, "time 0.001 s does not come after the row before"),
        (GOOD + "\n\n0.001,0.004,1\n", 7, "time 0.001 s does not come after the row before"),
        (GOOD + "0.003,12.5,1\n", 5, "position 12.5 m is beyond 1 m.*--position-unit"),
        (GOOD + '0.003,"0.0\n1",1\n', 6, "which is no number"),
        ("time_s,position_m,force_N\n", None, "0 samples: at least 2"),
        ("time_s,position_m,force_N\n0,0,0\n\n", None, "1 sample: at least 2"),
        ("", 1, "has no header"),
        ("\n\n", 1, "has no header"),
        (GOOD.encode("utf-16"), 1, "is no UTF-8 text"),
        (b"\x89PNG\r\n\x1a\n\0\0", 1, "is no UTF-8 text"),
    ],
)
def test_bad_tables_are_refused_with_row_and_rule(table, content, row, problem):
    path = table(content)
    error = refusal(path)
    assert error.row == row
    assert re.search(problem, str(error)), str(error)
    assert row is None or f"row {row}: " in str(error)


def test_a_row_of_units_below_the_header(table):
    numbers = "0,1,0.5\n0.001,2,0.75\n0.002,3,1\n"
    for units in ("s,mm,N", "(s),(mm),(N)", " [s] , [mm] , [N] "):
        read = read_with_notes(table(f"Time,Travel,Load\n{units}\n{numbers}"))
        assert_good(read.recording)
        assert read.recording.first_row == 3
        assert "columns guessed" in read.notes[0]
    assert refusal(table(f"Time,Travel,Load\ns,mm,N\n{numbers}0.002,3,1\n")).row == 6
    assert "the unit of Load is not known" in refused(table(f"Time,Travel,Load\ns,mm,\n{numbers}"))


def test_a_row_of_units_that_are_not_those_of_the_names(table):
    error = refused(table(GOOD.replace("N\n", "N\ns,mm,N\n", 1)))
    assert "column position_m is in m by its name, and in mm as the file states it elsewhere" in error


@pytest.mark.parametrize(
    "above", ["# made by a machine\n", "% a\n\n# b, with, commas, and more\n", "# \u00b5 and \u00b0\n"]
)
def test_remarks_above_the_header(table, above):
    for heading in (GOOD, "# " + GOOD):
        content = above + heading
        assert_good(read_recording(table(content)))
        assert refusal(table(content + "x,0,0\n")).row == content.count("\n") + 1


ROWS = "0.000,1,0.5\n0.001,2,0.75\n0.002,3,1\n"
HEADER = "Time (s),Extension (mm),Load (N)\n"


@pytest.mark.parametrize(
    ("above", "header", "lines"),
    [
        ("Sample: A12\nDate: 2024-02-01\n\n", HEADER, 2),
        ("Sample: A12\n", HEADER, 1),
        ('"Sample","A12"\n"Speed","5"\nOperator\n', HEADER, 3),
        ("Sample,A12,\nSpeed,5,\n,,\n", HEADER, 3),  # as wide as the widest, as spreadsheets write
        ("# remark\n\nSample: A12\n", HEADER, 1),
        ("Sample: A12\nby one, two, and three\n", HEADER, 2),
        ("Sample: A12\n\n", "Time,Extension,Load\n(s),(mm),(N)\n", 1),
        ("Sample: A12\n" + 48 * "x\n", HEADER, 49),
    ],
)
def test_lines_on_the_sample_above_the_header_are_passed_over(table, above, header, lines):
    content = above + header + ROWS
    read = read_with_notes(table(content))
    assert_good(read.recording)
    row = above.count("\n") + 1
    passed_over = "1 line above is passed over" if lines == 1 else f"{lines} lines above are passed over"
    assert f"the columns are named in line {row}; {passed_over}" in read.notes
    assert read.recording.first_row == row + header.count("\n")
    error = refusal(table(content + "x,0,0\n"))
    assert error.row == content.count("\n") + 1


@pytest.mark.parametrize("separator", [";", "\t"])
def test_lines_on_the_sample_beside_decimal_commas(table, separator):
    rows = "Prüfzeit;Standardweg;Standardkraft\ns;mm;kN\n0,000;1,0;0,0005\n0,001;2,0;0,00075\n0,002;3,0;0,001\n"
    content = "Probe: A12, die zweite\n\n" + rows.replace(";", separator)
    assert_good(read_recording(table(content.encode("cp1252"))))


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("Sample: A12\n" + 60 * "x\n" + HEADER + ROWS, "no column is named like time; the columns are Sample: A12"),
        ("Sample: A12\n" + ROWS, "no column is named like time; the columns are Sample: A12"),
        ("depth,force\n1,2\n2,3\n", "no column is named like time; the columns are depth, force"),
        (HEADER + "Sample,A12,\n" + ROWS, "row 2: Time .s. is 'Sample', which is no number"),
    ],
)
def test_a_header_is_not_sought_where_none_is_likely(table, content, problem):
    assert re.search(problem, refused(table(content)))


def test_what_numpy_writes(tmp_path):
    path = tmp_path / "press.csv"
    rows = [[0.0, 0.001, 0.5], [0.001, 0.002, 0.75], [0.002, 0.003, 1.0]]
    np.savetxt(path, rows, delimiter=",", header="made by NumPy\ntime_s,position_m,force_N")
    assert_good(read_recording(path))


def test_a_guess_is_a_warning_and_a_stated_recording_is_none(table):
    with pytest.warns(RecordingWarning, match=r"press.csv: columns guessed: .*unit = .mm") as caught:
        assert_good(read_recording(table("Zeit [s],Weg [mm],Kraft [N]\n0,1,0.5\n0.001,2,0.75\n0.002,3,1\n")))
    assert [warning.filename for warning in caught] == [__file__]
    assert_good(read_recording(table(GOOD)))  # warnings are errors here


def test_units_count_before_the_limit_of_one_metre(table):
    content = "time_s,position_m,force_N\n0,12.5,0\n1,1200,0\n"
    assert "row 3: position 1.2 m" in refused(table(content), position_unit="mm")
    assert read_recording(table(content), position_unit="um").position.tolist() == [12.5e-6, 1.2e-3]


def test_files_that_are_no_recording(table, tmp_path):
    assert "no such file" in refused(tmp_path / "absent.csv")
    assert "must end with one of .csv, .parquet, .mat, .ddf, .npz, .mcap, .h5, .hdf5, .db3, or be a rosbag2" in str(
        refusal(table(GOOD, "press.txt"))
    )
    folder = tmp_path / "folder.csv"
    folder.mkdir()
    assert "is no file" in refused(folder)
    assert_good(read_recording(table(GOOD, "PRESS.CSV")))


def test_options_of_other_formats_are_refused(table):
    assert "--force-channel" in refused(table(GOOD), force_channel="logged")
    for suffix in (".ddf", ".mcap"):
        assert "states its own units" in refused(table(b"", "press" + suffix), position_unit="mm")


numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)


@given(forces=st.lists(numbers, min_size=2, max_size=30))
def test_both_ways_read_the_same_bits(tmp_path_factory, forces):
    path = tmp_path_factory.mktemp("bits") / "t.csv"
    rows = "".join(f"{index / 7!r},0.{index},{force!r}\n" for index, force in enumerate(forces))
    path.write_text("time_s,position_m,force_N\n" + rows)
    read = csv_table.CsvTable(path)
    fast, careful = read.read_fast(REQUIRED), read.read_carefully(REQUIRED)
    assert fast is not None
    for name in REQUIRED:
        assert fast[name].tobytes() == careful[name].tobytes()
    assert fast["force_N"].tobytes() == np.array(forces).tobytes()


def test_csv_needs_no_optional_package(table, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert_good(read_recording(table(GOOD)))


def test_a_long_table_takes_the_fast_way(tmp_path):
    path = tmp_path / "long.csv"
    count = 100_000
    with path.open("w") as file:
        file.write("time_s,position_m,force_N\n")
        file.writelines(f"{index / 1000},0.{index % 1000},{index % 17}\n" for index in range(count))
    assert csv_table.CsvTable(path).read_fast(REQUIRED)["force_N"].size == count
    with path.open("a") as file:
        file.write("1000,0.1,oops\n")
    assert refusal(path).row == count + 2

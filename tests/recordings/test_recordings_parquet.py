import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from foretouch.errors import RecordingError
from foretouch.recordings import read_recording

GOOD = {"force_N": [0.5, 1.0], "time_s": [0.0, 0.001], "note": ["a", "b"], "position_m": [0.25, 0.5]}


@pytest.fixture
def table(tmp_path):
    def write(**columns):
        path = tmp_path / "press.parquet"
        pyarrow.parquet.write_table(pyarrow.table(GOOD | columns), path)
        return path

    return write


def test_reads_the_columns_of_the_csv(table):
    recording = read_recording(table(velocity_m_s=[1, 2]), position_unit="mm", force_unit="mN", flip=True)
    assert recording.time.tolist() == [0.0, 0.001]
    assert recording.position.tolist() == [-0.25e-3, -0.5e-3]
    assert recording.force.tolist() == [0.5e-3, 1e-3]
    assert recording.velocity.tolist() == [-1e-3, -2e-3]
    assert recording.contact_floor == 0.05


def test_single_precision_is_widened(table):
    force = pyarrow.array(np.array([0.1, 0.2], np.float32))
    assert read_recording(table(force_N=force)).force.tolist() == [float(np.float32(0.1)), float(np.float32(0.2))]


@pytest.mark.parametrize(
    ("columns", "problem"),
    [
        ({"force_N": ["1", "2"]}, "force_N holds string, not numbers"),
        ({"force_N": [1.0, None]}, "row 2: force_N has no value"),
        ({"force_N": [float("nan"), 1.0]}, "row 1: force is nan: every value must be finite"),
        ({"time_s": [0.0, 0.0]}, "row 2: time 0 s does not come after the row before"),
        ({"position_m": [0.0, -3.0]}, "row 2: position -3 m is beyond 1 m.*--position-unit"),
    ],
)
def test_bad_tables_are_refused(table, columns, problem):
    with pytest.raises(RecordingError, match=problem):
        read_recording(table(**columns))


def test_missing_columns_and_foreign_files_are_refused(tmp_path):
    path = tmp_path / "press.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"t": [1.0], "force_N": [1.0]}), path)
    with pytest.raises(RecordingError, match="column time_s, position_m missing; the columns are t, force_N"):
        read_recording(path)
    for content in (b"", b"PAR1", b"no parquet at all, but longer than a footer"):
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="is no Parquet file") as caught:
            read_recording(path)
        assert "\n" not in str(caught.value)


@pytest.mark.long
@pytest.mark.usefixtures("read_apart")
def test_damaged_files_give_one_line(table):
    path = table()
    content = path.read_bytes()
    for place in range(4, len(content) - 8, 23):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0x80]) + content[place + 1 :])
        try:
            read_recording(path)
        except RecordingError as error:
            shown = str(error)
            if "\n" in shown:
                pytest.fail(shown)
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(RecordingError, match="is no Parquet file"):
        read_recording(path)

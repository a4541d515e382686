"""The formats that the measured recordings were published in, and files that only look like them."""

import numpy as np
import pytest
from measured_formats import LEVER, signals, write_aurora, write_tue
from scipy.io import savemat

from foretouch.errors import RecordingError
from foretouch.recordings import read_leader_motion, read_recording


@pytest.fixture
def tue(tmp_path):
    return write_tue(tmp_path / "press.mat", signals())


@pytest.fixture
def aurora(tmp_path):
    return write_aurora(tmp_path / "press.ddf", VOLTS)


VOLTS = np.round(np.stack((np.linspace(-0.4, 5.9, 900), np.linspace(-0.1, 2.0, 900)), 1), 6)


def test_tue_press_is_the_follower_in_si_units(tue):
    held, recording = signals(), read_recording(tue)
    np.testing.assert_array_equal(recording.time, held.time)
    np.testing.assert_allclose(recording.position, 0.075 * held.angles[:, 1], rtol=1e-15)
    np.testing.assert_allclose(recording.force, held.bridge * 0.2361 / 0.075, rtol=1e-15)
    assert recording.contact_floor == 0.3
    assert recording.velocity is None


def test_the_logged_force_is_the_environment_s_torque(tue):
    raw, logged = (read_recording(tue, force_channel=channel) for channel in ("raw", "logged"))
    assert raw.position.tobytes() == logged.position.tobytes()
    np.testing.assert_allclose(logged.force, signals().torques[:, 1] / LEVER, rtol=1e-15)


def test_flip_turns_the_positions(tue, aurora):
    for path in (tue, aurora):
        straight, flipped = read_recording(path), read_recording(path, flip=True)
        assert (straight.position == -flipped.position).all()
        assert (straight.force == flipped.force).all()
        turned = read_recording(path, flip_force=True)
        assert (straight.force == -turned.force).all()
        assert (straight.position == turned.position).all()


def test_leader_motion_counts_from_its_first_sample(tue):
    time, position = read_leader_motion(tue)
    assert time[0] == 0.0
    np.testing.assert_allclose(time, signals().time - 12.5, atol=1e-12)
    np.testing.assert_allclose(position, LEVER * signals().angles[:, 0], rtol=1e-15)


def test_aurora_file_is_read_whole(aurora):
    recording = read_recording(aurora)
    np.testing.assert_allclose(recording.time, np.arange(len(VOLTS)) / 2000)
    np.testing.assert_allclose(recording.position, VOLTS[:, 0] / 1000, rtol=1e-15)
    np.testing.assert_allclose(recording.force, VOLTS[:, 1] / 2, rtol=1e-15)
    assert recording.contact_floor == 0.005


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("489\tabc\t0.1", "row 501: does not hold sample number, AI0 and AI1 as numbers"),
        ("10\t0\t0\t0", r"row 501: time 0\.005 s does not come after"),
    ],
)
def test_aurora_rows_are_those_of_the_file(aurora, row, problem):
    lines = aurora.read_text(encoding="latin-1").splitlines()
    lines[500] = row
    aurora.write_text("\n".join(lines), encoding="latin-1")
    with pytest.raises(RecordingError, match=problem):
        read_recording(aurora)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00binary", b"time_s,position_m,force_N\n0,0,0\n"])
@pytest.mark.parametrize("suffix", [".mat", ".ddf", ".npz", ".mcap"])
def test_foreign_files_give_one_line(tmp_path, content, suffix):
    path = tmp_path / f"foreign{suffix}"
    path.write_bytes(content)
    # An empty recording of a session may be one whose writer was killed at once.
    what = "was cut off before anything" if suffix == ".mcap" and not content else "is no"
    with pytest.raises(RecordingError, match=rf"foreign\.\w+: {what}") as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


def test_a_damaged_mat_file_gives_one_line(tue, tmp_path):
    content = tue.read_bytes()
    path = tmp_path / "cut.mat"
    for length in (100, 200, 5000, len(content) // 2):
        path.write_bytes(content[:length])
        with pytest.raises(RecordingError, match=r"cut\.mat: (is no |cannot be read)") as caught:
            read_recording(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"x": [1.0, 2.0]}, "no column is named like time; the columns are x"),
        ({"scope": [1.0]}, "no column is named like time; the columns are none"),
        ({"scope": {"time": [0.0, 1.0]}}, "no column is named like position; the columns are scope.time"),
        ({"scope": {"time": [0.0, 1.0]}, "env_est3": [1.0]}, "no TU/e teleoperation recording"),
    ],
)
def test_a_mat_file_of_something_else_is_refused(tmp_path, content, problem):
    path = tmp_path / "other.mat"
    savemat(path, content)
    for read, output in ((read_recording, problem), (read_leader_motion, "no TU/e teleoperation recording")):
        with pytest.raises(RecordingError, match=output):
            read(path)


def test_reading_a_leader_motion_that_is_not_there(tmp_path):
    with pytest.raises(RecordingError, match="cannot be read: "):
        read_leader_motion(tmp_path / "absent.mat")

"""The measured files as they are, and files that only look like them."""

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from foretouch.errors import RecordingError, UnknownNameError
from foretouch.recordings import DATASETS, list_datasets, read_leader_motion, read_recording

TUE = [name for name in DATASETS if name.startswith("tue/")]
AURORA = [name for name in DATASETS if name.startswith("aurora/")]


@pytest.mark.parametrize("name", TUE)
def test_tue_press_is_the_follower_in_si_units(measured, name):
    path = measured(name)
    recording = read_recording(path)
    content = loadmat(path, variable_names=["scope", "env_est3"])  # another way to reach the same numbers
    signals = content["scope"]["signals"][0, 0]
    bridge = content["env_est3"]["signals"][0, 0][0, 2]["values"].ravel()
    np.testing.assert_allclose(recording.position, 0.075 * signals[0, 0]["values"][:, 1], rtol=1e-15)
    np.testing.assert_allclose(recording.force, bridge * 0.2361 / 0.075, rtol=1e-15)
    assert len(recording) > 8000
    np.testing.assert_allclose(np.diff(recording.time), 5e-4, rtol=1e-6)
    assert recording.contact_floor == 0.3
    assert recording.velocity is None


@pytest.mark.parametrize("dataset", [d for d in list_datasets() if d.kind in ("foam", "spring", "rigid")])
@pytest.mark.parametrize("channel", ["raw", "logged"])
def test_pressing_gives_more_force_at_more_depth(measured, dataset, channel):
    recording = read_recording(measured(dataset.name), force_channel=channel)
    order = np.argsort(recording.position)
    tenth = len(recording) // 10
    shallow, deep = (recording.force[part].mean() for part in (order[:tenth], order[-tenth:]))
    assert deep > shallow + 1.0


def test_raw_and_logged_force_differ_by_offset_and_lag(measured):
    raw, logged = (read_recording(measured("tue/a-foam"), force_channel=channel) for channel in ("raw", "logged"))
    assert raw.position.tobytes() == logged.position.tobytes()
    offset = raw.force - logged.force
    assert 7.0 < np.median(offset) < 8.5
    assert np.corrcoef(raw.force, logged.force)[0, 1] > 0.99


def test_flip_turns_the_positions(measured):
    for name in ("tue/a-foam", "aurora/100-mN"):
        straight, flipped = read_recording(measured(name)), read_recording(measured(name), flip=True)
        assert (straight.position == -flipped.position).all()
        assert (straight.force == flipped.force).all()


@pytest.mark.parametrize("name", TUE)
def test_leader_motion_is_a_hand_near_its_follower(measured, name):
    time, position = read_leader_motion(measured(name))
    follower = read_recording(measured(name))
    assert time[0] == 0.0
    assert time.shape == position.shape == follower.position.shape
    assert np.corrcoef(position, follower.position)[0, 1] > 0.98
    assert np.ptp(position) > 0.003


@pytest.mark.parametrize("name", AURORA)
def test_aurora_file_is_read_whole(measured, name):
    path = measured(name)
    recording = read_recording(path)
    lines = path.read_text(encoding="latin-1").splitlines()
    volts = np.array([line.split("\t")[:3] for line in lines[lines.index("Test Data in Volts:") + 3 :]], float)
    np.testing.assert_allclose(recording.time, np.arange(len(volts)) / 2000)
    np.testing.assert_allclose(recording.position, volts[:, 1] / 1000, rtol=1e-15)
    np.testing.assert_allclose(recording.force, volts[:, 2] / 2, rtol=1e-15)
    assert recording.contact_floor == 0.005
    target = float(name.removeprefix("aurora/").removesuffix("-mN")) / 1000
    held = (recording.time > 1.05) & (recording.time < 1.15)
    assert abs(recording.force[held].mean() - target) < 0.1 * target + 0.01
    assert recording.position[held].mean() > recording.position[1000:1100].mean() + 1e-4  # deeper while it presses


def test_aurora_rows_are_those_of_the_file(measured, tmp_path):
    lines = measured("aurora/100-mN").read_text(encoding="latin-1").splitlines()
    path = tmp_path / "press.ddf"
    broken = [*lines]
    broken[2000] = "1974\tabc\t0.1"
    path.write_text("\n".join(broken), encoding="latin-1")
    with pytest.raises(RecordingError, match="row 2001: does not hold sample number, AI0 and AI1 as numbers"):
        read_recording(path)
    broken = [*lines]
    broken[2000] = "10\t0\t0\t0"
    path.write_text("\n".join(broken), encoding="latin-1")
    with pytest.raises(RecordingError, match=r"row 2001: time 0\.005 s does not come after"):
        read_recording(path)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00binary", b"time_s,position_m,force_N\n0,0,0\n"])
@pytest.mark.parametrize("suffix", [".mat", ".ddf", ".mcap"])
def test_foreign_files_give_one_line(tmp_path, content, suffix):
    path = tmp_path / f"foreign{suffix}"
    path.write_bytes(content)
    # An empty recording of a session may be one whose writer was killed at once.
    what = "was cut off before anything" if suffix == ".mcap" and not content else "is no "
    with pytest.raises(RecordingError, match=rf"foreign\.\w+: {what}") as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


def test_a_damaged_mat_file_gives_one_line(measured, tmp_path):
    content = measured("tue/a-foam").read_bytes()
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
    for read, said in ((read_recording, problem), (read_leader_motion, "no TU/e teleoperation recording")):
        with pytest.raises(RecordingError, match=said):
            read(path)


def test_reading_a_leader_motion_that_is_not_there(tmp_path):
    with pytest.raises(RecordingError, match="cannot be read: "):
        read_leader_motion(tmp_path / "absent.mat")


def test_unknown_kind_of_dataset():
    with pytest.raises(UnknownNameError, match="choose one of foam, free, rigid, skin, spring"):
        list_datasets("wood")

"""Tables of static poses and the TOML file of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foretouch.errors import RecordingError
from foretouch.quantities import SensorCalibration
from foretouch.recordings import read_calibration, read_poses, write_calibration

WHOLE = SensorCalibration(
    force_bias=(1.0, -2.0, 0.1 + 0.2),
    force_bias_error=(1e-3, 2e-3, 3e-3),
    torque_bias=(0.01, 0.02, 0.03),
    torque_bias_error=(1e-4, 1e-4, 1e-4),
    tool_mass=0.35,
    tool_mass_error=1e-9,
    centre_of_mass=(0.0, -1e-3, 0.05),
    centre_of_mass_error=(1e-5, 1e-5, 1e-5),
    approach_axis=(0.0, -1.0, 0.0),
    approach_gravity=0.0,
    sensor_lag=2e-3,
    sensor_lag_error=1e-4,
    series_stiffness=4e4,
    series_stiffness_error=60.0,
    lost_motion=-1e-6,
)


def test_a_calibration_reads_back_bit_by_bit(tmp_path: Path) -> None:
    for calibration in (WHOLE, SensorCalibration(), SensorCalibration(series_stiffness=1e22)):
        write_calibration(tmp_path / "sensor.toml", calibration)
        assert read_calibration(tmp_path / "sensor.toml") == calibration
    assert [path.name for path in tmp_path.iterdir()] == ["sensor.toml"]


def test_its_free_air_force_is_that_of_bias_and_weight_along_the_approach() -> None:
    assert WHOLE.force_offset == pytest.approx(-2.0)
    down = SensorCalibration(force_bias=(1.0, 2.0, 3.0), tool_mass=0.5, approach_gravity=10.0)
    assert down.force_offset == pytest.approx(-3.0 - 5.0)
    assert SensorCalibration().force_offset is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("series_stifness = 4e4\n", "unknown field `series_stifness`"),
        ("series_stiffness = 0.0\n", "series_stiffness = 0.0: must be above 0"),
        ("sensor_lag = -1e-3\n", "sensor_lag = -0.001: must be at least 0"),
        ("sensor_lag = nan\n", "must be finite"),
        ("force_bias = [1.0, 2.0]\n", "force_bias"),
        ("force_bias = [1.0, 2.0, 3.0]\n", "tool_mass = None: must be given with force_bias"),
        ("approach_axis = [1.0, 1.0, 0.0]\n", "must have length 1"),
        ("tool_mass = 'heavy'\n", "Expected `float"),
        ("tool_mass =\n", "sensor.toml: is no sensor calibration"),
        (b"\xff\xfe", "is no sensor calibration"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    path = tmp_path / "sensor.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(RecordingError) as refused:
        read_calibration(path)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        read_calibration(tmp_path / "sensor.toml")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_calibration(tmp_path / "missing" / "sensor.toml", WHOLE)


# --- poses ------------------------------------------------------------------------------------------------------------


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_columns_stand_in_any_order_and_gravity_has_any_length(tmp_path: Path) -> None:
    path = write(
        tmp_path / "p.csv", "gz,gx,gy,other,fz_N,fy_N,fx_N", "-9.81,0,0,x,3,2,1", "", ",,,,,,", "0,0,2,y,6,5,4"
    )
    poses = read_poses(path)
    np.testing.assert_array_equal(poses.gravity, [[0, 0, -1], [0, 1, 0]])
    np.testing.assert_array_equal(poses.force, [[1, 2, 3], [4, 5, 6]])
    assert poses.torque is None


def test_a_quaternion_gives_the_direction_of_gravity(tmp_path: Path) -> None:
    """Upright; turned by 90 degrees about x, so that the sensor's y points up; upside down; about y."""
    half = 0.5**0.5
    turns = [(1, 0, 0, 0), (half, half, 0, 0), (0, 1, 0, 0), (half, 0, half, 0)]
    rows = [f"0,0,0,{w},{x},{y},{z}" for w, x, y, z in turns]
    poses = read_poses(write(tmp_path / "p.csv", "fx_N,fy_N,fz_N,qw,qx,qy,qz", *rows))
    np.testing.assert_allclose(poses.gravity, [[0, 0, -1], [0, -1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)


def test_a_rotation_vector_gives_the_direction_of_gravity(tmp_path: Path) -> None:
    quarter = 0.5 * np.pi
    rows = [f"0,0,0,{x},{y},{z}" for x, y, z in ((0, 0, 0), (quarter, 0, 0), (0, quarter, 0), (0, 0, quarter))]
    poses = read_poses(write(tmp_path / "p.csv", "fx_N,fy_N,fz_N,rx_rad,ry_rad,rz_rad", *rows))
    np.testing.assert_allclose(poses.gravity, [[0, 0, -1], [0, -1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-12)
    assert poses.names == ("1", "2", "3", "4")


def test_poses_keep_their_names_and_their_order(tmp_path: Path) -> None:
    """As texts 10 comes before 2."""
    rows = [f"{name},{name},0,0,0,0,1" for name in (2, 10, 1, 10)]
    poses = read_poses(write(tmp_path / "p.csv", "pose," + HEAD, *rows))
    assert poses.names == ("2", "10", "1")
    np.testing.assert_array_equal(poses.force[:, 0], [2, 10, 1])


def test_rows_of_one_pose_are_averaged(tmp_path: Path) -> None:
    head = "pose,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm,gx,gy,gz"
    path = write(tmp_path / "p.csv", head, "a,1,0,0,0.1,0,0,0,0,1", "b,5,5,5,0,0,0,1,0,0", "a,3,0,0,0.3,0,0,0,0,1")
    poses = read_poses(path)
    np.testing.assert_allclose(poses.force, [[2, 0, 0], [5, 5, 5]])
    np.testing.assert_allclose(poses.gravity, [[0, 0, 1], [1, 0, 0]])
    assert poses.torque is not None
    np.testing.assert_allclose(poses.torque[:, 0], [0.2, 0.0])
    assert poses.force_noise == pytest.approx((2.0 / 3.0) ** 0.5)  # 1 and 3 N about 2; three axes, one row too many
    one_each = read_poses(write(tmp_path / "q.csv", "pose," + HEAD, "a,1,2,3,0,0,-1", "b,1,2,3,0,1,0"))
    assert one_each.force_noise is None


HEAD = "fx_N,fy_N,fz_N,gx,gy,gz"


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("fx_N,fy_N,gx,gy,gz", "0,0,0,0,1"), "row 1: column fz_N missing; the columns are fx_N, fy_N, gx, gy, gz"),
        (("fx_N,fy_N,fz_N", "0,0,0"), "row 1: column gx, gy, gz missing; .*; give gx,gy,gz or qw,qx,qy,qz"),
        ((HEAD + ",tx_Nm", "0,0,0,0,0,1,0"), "row 1: column ty_Nm, tz_Nm missing"),
        ((HEAD, "0,0,0,0,0,1", "0,0,a,0,0,1"), "row 3: fz_N is 'a', which is no number"),
        ((HEAD, "0,0,nan,0,0,1"), "row 2: fz_N is nan: every value must be finite"),
        ((HEAD, "0,0,0,0,0,0"), "row 2: the gravity direction has length 0: it must not be 0"),
        ((HEAD, "0,0,0,0,0"), "row 2: 5 values, the header names 6"),
        ((HEAD + ",gx", "0,0,0,0,0,1,0"), "row 1: column gx is there 2 times"),
        (("fx_N,fy_N,fz_N,qw,qx,qy,qz", "0,0,0,2,0,0,0"), "row 2: the quaternion has length 2: it must be 1"),
        ((HEAD,), "has no rows"),
    ],
)
def test_bad_tables_are_refused_by_row_and_rule(tmp_path: Path, lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        read_poses(write(tmp_path / "p.csv", *lines))

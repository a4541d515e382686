"""What a tool makes a wrist's sensor show, against MuJoCo's sensors on a body that flies about, and closed forms."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from foretouch.errors import RecordingError, SettingError
from foretouch.quantities import STANDARD_GRAVITY, SensorCalibration, ToolLoad
from foretouch.recordings import read_calibration, write_calibration

BIAS = (1.0, -2.0, 0.5, 0.03, 0.01, -0.02)
INERTIA = (3e-4, 4e-4, 2e-4, 2e-5, -1e-5, 3e-5)

SCENE = """
<mujoco>
  <option gravity="0 0 -9.80665" timestep="0.0005"/>
  <worldbody>
    <body name="flange"><freejoint/><inertial pos="0.01 0 -0.02" mass="2" diaginertia="0.01 0.02 0.015"/>
      <body name="tool"><inertial pos="{centre}" mass="{mass}" fullinertia="{inertia}"/>
        <site name="sensor" quat="{quat}"/></body></body>
  </worldbody>
  <sensor><force site="sensor"/><torque site="sensor"/></sensor>
</mujoco>
"""

numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers)


def text(values: object) -> str:
    return " ".join(map(repr, map(float, values)))


def moved(load: ToolLoad, turn: np.ndarray, spin: np.ndarray, push: np.ndarray) -> tuple[np.ndarray, ...]:
    """Wrench that MuJoCo's sensors feel of a tool on a flange that is pushed, and how the flange moves."""
    mujoco = pytest.importorskip("mujoco")
    sensor = Rotation.from_rotvec(load.sensor_turn).inv()  # the site as the flange sees it
    xx, yy, zz, xy, xz, yz = load.inertia
    axes = sensor.as_matrix()
    inertia = axes @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes.T
    there = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    model = mujoco.MjModel.from_xml_string(
        SCENE.format(
            centre=text(sensor.apply(load.centre_of_mass)),
            mass=load.mass,
            inertia=text(there),
            quat=text(sensor.as_quat(scalar_first=True)),
        )
    )
    data = mujoco.MjData(model)
    attitude = Rotation.from_rotvec(turn)
    data.qpos[3:7], data.qvel[3:6] = attitude.as_quat(scalar_first=True), spin  # of a free joint in the body's frame
    data.qfrc_applied[:] = push
    mujoco.mj_forward(model, data)
    rotation = attitude.as_matrix()
    return data.sensordata.copy(), rotation, data.qacc[:3].copy(), rotation @ spin, rotation @ data.qacc[3:6]


@given(vectors, vectors, vectors, vectors, vectors)
def test_a_body_that_flies_about_shows_what_newton_and_euler_say(turn, sensor, centre, spin, push) -> None:
    """The angular acceleration of the whole is that of the tool; nothing touches, so that nothing but bias is left."""
    # MuJoCo takes a site that is turned by less than some 1e-5 rad for one that is not turned.
    assume(np.linalg.norm(sensor) == 0.0 or np.linalg.norm(sensor) > 1e-4)
    load = ToolLoad(BIAS, 0.3, tuple(0.1 * np.array(centre)), tuple(2.0 * np.array(sensor)), INERTIA)
    pushed = np.concatenate((20.0 * np.array(push), 2.0 * np.array(push)[::-1]))
    felt, *motion = moved(load, 3.0 * np.array(turn), 8.0 * np.array(spin), pushed)
    shown = np.array(BIAS) - felt  # the load on the sensor is the negative of what it does to the tool
    rotation, acceleration, rate, change = motion
    np.testing.assert_allclose(load.wrench(rotation, acceleration, rate, change), shown, atol=1e-9)
    np.testing.assert_allclose(load.contact(shown, rotation, acceleration, rate, change), 0.0, atol=1e-9)


def test_at_rest_it_is_the_weight() -> None:
    load = ToolLoad(BIAS, 0.3, (0.0, 0.0, 0.05))
    down, aside = load.wrench(np.eye(3)), load.wrench(Rotation.from_euler("x", 90.0, degrees=True).as_matrix())
    np.testing.assert_allclose(down - BIAS, (0.0, 0.0, -0.3 * STANDARD_GRAVITY, 0.0, 0.0, 0.0), atol=1e-12)
    pull = 0.3 * STANDARD_GRAVITY  # turned about x, the flange's y points up
    np.testing.assert_allclose(aside - BIAS, (0.0, -pull, 0.0, 0.05 * pull, 0.0, 0.0), atol=1e-12)
    touched = load.contact(down + np.array((0.0, 0.0, 4.0, 0.0, 0.0, 0.0)), np.eye(3))
    np.testing.assert_allclose(touched, (0.0, 0.0, 4.0, 0.0, 0.0, 0.0), atol=1e-12)


def test_in_free_fall_nothing_but_bias_is_left() -> None:
    load = ToolLoad(BIAS, 0.3, (0.01, 0.02, 0.05), (0.3, 0.2, 0.1), INERTIA)
    np.testing.assert_allclose(load.wrench(np.eye(3), (0.0, 0.0, -STANDARD_GRAVITY)), BIAS, atol=1e-12)


def test_it_is_quick_enough_for_a_loop() -> None:
    load, rotation = ToolLoad(BIAS, 0.3, (0.0, 0.0, 0.05)), np.eye(3)
    begin = time.perf_counter()
    for _ in range(1000):
        load.wrench(rotation, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    assert (time.perf_counter() - begin) / 1000 < 1e-4  # ten times what it takes


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"bias": (0.0, 1.0)}, "bias"),
        ({"mass": -0.1}, "mass"),
        ({"centre_of_mass": (0.0, float("nan"), 0.0)}, "centre_of_mass"),
        ({"inertia": (1.0, 1.0, 3.0, 0.0, 0.0, 0.0)}, "inertia"),
        ({"sensor_turn": (9.0, 9.0, 9.0)}, "sensor_turn .* at most pi long"),
    ],
)
def test_what_no_tool_is_is_refused(changes: dict, name: str) -> None:
    with pytest.raises(SettingError, match=name):
        ToolLoad(**{"bias": BIAS, "mass": 0.3, "centre_of_mass": (0.0, 0.0, 0.05)} | changes)


def test_a_calibration_file_holds_it(tmp_path) -> None:
    full = SensorCalibration(
        force_bias=BIAS[:3],
        torque_bias=BIAS[3:],
        tool_mass=0.3,
        centre_of_mass=(0.0, 0.0, 0.05),
        tool_inertia=INERTIA,
        sensor_turn=(0.0, 0.0, 1.5),
    )
    write_calibration(tmp_path / "sensor.toml", full)
    load = read_calibration(tmp_path / "sensor.toml").tool_load
    assert load == ToolLoad(BIAS, 0.3, (0.0, 0.0, 0.05), (0.0, 0.0, 1.5), INERTIA)
    assert msgspec.structs.replace(full, torque_bias=None).tool_load is None
    assert msgspec.structs.replace(full, sensor_turn=None, tool_inertia=None).tool_load.inertia == (0.0,) * 6
    (tmp_path / "wrong.toml").write_text("tool_mas = 0.3\n")
    with pytest.raises(RecordingError, match="tool_mas"):
        read_calibration(tmp_path / "wrong.toml")
    (tmp_path / "turned.toml").write_text("sensor_turn = [9.0, 9.0, 9.0]\n")
    with pytest.raises(
        RecordingError, match=r"turned\.toml.*sensor_turn = \(9.0, 9.0, 9.0\): must be a rotation vector"
    ):
        read_calibration(tmp_path / "turned.toml")
    half = (0.0, 0.6 * np.pi, 0.8 * np.pi)
    assert SensorCalibration(sensor_turn=half).sensor_turn == half
    with pytest.raises(SettingError, match="inertia"):
        SensorCalibration(tool_inertia=(1.0, 1.0, 3.0, 0.0, 0.0, 0.0))

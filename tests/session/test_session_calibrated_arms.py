"""A calibration of the sensor at an arm's wrist, from poses of that arm to a session with the file."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foretouch.cli.app import app
from foretouch.errors import SettingError
from foretouch.identification import fit_tool_load
from foretouch.quantities import SensorCalibration
from foretouch.recordings import read_calibration, write_calibration
from foretouch.robot import ArticulatedArm, read_arm
from foretouch.robot.arms.sensing.wrist_sensor import WristSensor
from foretouch.session import SessionSettings, make_session_robot, session_calibration, simulate
from foretouch.session.runners.driven import drive_follower
from foretouch.session.steps.sensing import calibrated, calibrated_arm

pytest.importorskip("mujoco")
pytest.importorskip("mink")

DOCS = Path(__file__).resolve().parents[2] / "docs"
ARMS = ("fr3", "ur5e")


@pytest.fixture(scope="module")
def measuring() -> Any:
    """`docs/measure_arms.py`, by which the page's figures are made."""
    sys.path.insert(0, str(DOCS))
    try:
        spec = importlib.util.spec_from_file_location("measure_arms", DOCS / "measure_arms.py")
        assert spec is not None
        assert spec.loader is not None
        module: ModuleType = importlib.util.module_from_spec(spec)
        sys.modules["measure_arms"] = module
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(DOCS))
    yield module
    del sys.modules["measure_arms"]


def foretouch(*arguments: object) -> Any:
    from typer.testing import CliRunner

    return CliRunner().invoke(app, [str(one) for one in arguments])


@pytest.fixture(scope="module")
def files(measuring: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Of each arm the file that the command line makes of twelve of its poses, three rows each."""
    folder, made = tmp_path_factory.mktemp("calibrated"), {}
    for name in ARMS:
        rows, standing = ["pose,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm,rx_rad,ry_rad,rz_rad"], measuring.Standing(name, 7)
        for number in range(12):
            matrix, shown = standing.pose()
            turn = Rotation.from_matrix(matrix).as_rotvec()
            rows += [",".join(map(str, (number, *row, *turn))) for row in shown]
        table, made[name] = folder / f"{name}.csv", folder / f"{name}.toml"
        table.write_text("\n".join(rows) + "\n")
        result = foretouch("calibrate", "sensor", table, "--output", made[name])
        assert result.exit_code == 0, result.output
    return made


def free_air(arm: ArticulatedArm) -> np.ndarray:
    """Mean of the force in free air over each 0.1 s of a way of 5 cm to and fro, and at its ends [N]."""
    shown = []
    for tick in range(2000):
        height = 0.05 + 0.025 * (1.0 - np.cos(2.0 * np.pi * min(tick / 1500.0, 1.0)))
        shown.append(arm.exchange((0.0, 0.0, float(height))).force)
    return np.linalg.norm(np.reshape(shown, (20, 100, 3)).mean(axis=1), axis=1)


def still(*_: object) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


@pytest.mark.parametrize("name", ARMS)
def test_what_was_calibrated_leaves_no_force_in_free_air(files: dict[str, Path], name: str) -> None:
    settings = SessionSettings(robot=name, calibration=str(files[name]))
    known = read_calibration(files[name])
    assert known.tool_mass == pytest.approx(0.1, abs=0.003)
    assert known.centre_of_mass == pytest.approx((0.0, 0.0, 0.08), abs=2e-3)
    assert free_air(ArticulatedArm(calibrated_arm(settings), still, seed=3)).max() < 0.1


@pytest.mark.long
def test_a_file_that_is_wrong_is_used_as_it_is(files: dict[str, Path]) -> None:
    """Bias, mass and frame come from the file: with each of them wrong, the force in free air is wrong by as much."""
    settings = SessionSettings(robot="fr3", calibration=str(files["fr3"]))
    right = calibrated_arm(settings)
    load = right.tool
    assert load is not None
    for change, expected in (
        ({"mass": load.mass + 0.1}, 0.981),
        ({"bias": (load.bias[0] + 0.5, *load.bias[1:])}, 0.5),
        ({"sensor_turn": (np.pi / 2.0, 0.0, 0.0)}, 0.981 * np.sqrt(2.0)),  # a weight that is taken off sideways
    ):
        wrong = dataclasses.replace(right, tool=dataclasses.replace(load, **change))
        assert free_air(ArticulatedArm(wrong, still, seed=3)).max() == pytest.approx(expected, abs=0.1), change


def test_a_turned_sensor_feels_the_same_contact(files: dict[str, Path]) -> None:
    """What it shows is turned here as if it were mounted so: force and contact come out as without a turn."""
    load = calibrated_arm(SessionSettings(robot="fr3", calibration=str(files["fr3"]))).tool
    assert load is not None
    turn = Rotation.from_rotvec((0.3, -0.8, 1.5))
    own = Rotation.from_rotvec(load.sensor_turn)
    both = np.kron(np.eye(2), turn.as_matrix())
    turned = dataclasses.replace(
        load,
        bias=tuple((both @ load.bias).tolist()),
        centre_of_mass=tuple(turn.apply(load.centre_of_mass).tolist()),
        sensor_turn=tuple((turn * own).as_rotvec().tolist()),
    )
    found = []
    for tool, matrix in ((load, np.eye(6)), (turned, both)):
        arm = ArticulatedArm(dataclasses.replace(read_arm("fr3"), tool=tool), push, seed=3)
        sensor: Any = arm._sensing
        read = sensor._sensor.read
        sensor._sensor.read = lambda read=read, matrix=matrix: np.ascontiguousarray(matrix @ read())
        force = np.mean([arm.exchange((0.0, 0.0, 0.05)).force for _ in range(600)][300:], axis=0)
        found.append((force, sensor.contact.touching, sensor.beside_tip))
    np.testing.assert_allclose(found[1][0], found[0][0], atol=1e-6)
    np.testing.assert_allclose(found[0][0], push(), atol=0.1)
    assert found[0][1:] == found[1][1:]
    assert found[0][1].name == "TIP"


def push(*_: object) -> tuple[float, float, float]:
    return 1.0, -0.5, 4.0


@pytest.mark.parametrize("scene", ["", "hill"])
@pytest.mark.long
def test_a_session_with_the_file_has_no_force_in_free_air(files: dict[str, Path], scene: str) -> None:
    settings = SessionSettings(
        robot="fr3", scene=scene, calibration=str(files["fr3"]), material="hunt-crossley", model="hunt-crossley"
    )
    log = simulate(settings, duration=8.0 if scene else 4.0, say=lambda _: None).log
    follower = log.follower
    air = follower["exact_force"] == 0.0
    assert air[:400].all()
    assert abs(follower["sensor_force"][50:400].mean()) < 0.1
    assert abs(follower["force"][50:400].mean()) < 0.1
    touched = follower["exact_force"] > 1.0
    assert touched.any()
    assert np.median(np.abs(follower["force"] - follower["exact_force"])[touched]) < 0.2


@pytest.mark.parametrize("name", ARMS)
def test_the_weight_that_is_left_is_within_what_is_promised(measuring: Any, name: str) -> None:
    """In any of 50 poses, with the arm's own sensor and with others of its kind."""
    for piece in (0, *range(600, 605)):
        left = measuring.left(name, piece)
        assert 0.0 < left.force <= 0.1
        assert 0.0 < left.torque <= 0.01


def test_its_weight_is_not_taken_off_twice(files: dict[str, Path]) -> None:
    settings = SessionSettings(robot="fr3", calibration=str(files["fr3"]))
    robot, _ = make_session_robot(settings)
    known = calibrated(robot.specification, settings)
    assert (known.zero, known.specification) == (None, robot.specification)


REFUSED = {
    "so101": ({}, "so101 has no sensor at its wrist"),
    "fr3": ({"torque_bias": None, "centre_of_mass": None}, "holds no torques"),
    "ur5e": ({"tool_mass": 7.0}, "a tool of 7 kg, and ur5e carries 5 kg"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_does_not_fit_the_arm_is_one_line(tmp_path: Path, name: str) -> None:
    changes, said = REFUSED[name]
    known: dict[str, Any] = {"force_bias": (0.1, 0.2, 0.3), "torque_bias": (0.0, 0.0, 0.0), "tool_mass": 0.1}
    path = tmp_path / "wrist.toml"
    write_calibration(path, SensorCalibration(**known | {"centre_of_mass": (0.0, 0.0, 0.08)} | changes))
    with pytest.raises(SettingError, match=said):
        session_calibration(SessionSettings(robot=name, calibration=str(path)))


@pytest.mark.parametrize("robot", ["simulated", "fr3"])
def test_what_only_six_axes_show_is_left_out_in_one_line(files: dict[str, Path], tmp_path: Path, robot: str) -> None:
    path = tmp_path / "wrist.toml"
    known: dict[str, Any] = {"force_bias": (0.0, 0.0, 0.0), "torque_bias": (0.0, 0.0, 0.0), "tool_mass": 0.1}
    write_calibration(path, SensorCalibration(**known, centre_of_mass=(0.0, 0.0, 0.08)))
    path = files.get(robot, path)
    done = foretouch("simulate", "--robot", robot, "--calibration", path, "--duration", 0.1)
    assert done.exit_code == 0
    told = [line for line in done.stderr.splitlines() if line.startswith("calibration:")]
    why = "robot simulated shows no torques, as the wrist of an arm does"
    assert told == (
        [f"calibration: {path}: left out torque_bias, centre_of_mass: {why}"] if robot == "simulated" else []
    )


def test_what_gives_way_behind_the_tip_of_an_arm_without_a_sensor_is_used(tmp_path: Path) -> None:
    path = tmp_path / "block.toml"
    write_calibration(path, SensorCalibration(series_stiffness=20e3))
    assert calibrated_arm(SessionSettings(robot="so101", calibration=str(path))).tool is None


# --- the file belongs to the sensor -----------------------------------------------------------------------------------

SENSOR = WristSensor(1e-3, seed=0)
"""That of an arm in a session, of which bias and drift count here."""


@pytest.mark.long
def test_the_example_of_the_page_touches_and_predicts(tmp_path: Path) -> None:
    path = tmp_path / "fr3.toml"
    assert foretouch("calibrate", "sensor", DOCS / "examples" / "fr3.csv", "--output", path).exit_code == 0
    for name in ARMS:
        answer = foretouch("simulate", "--robot", name, "--calibration", path, "--duration", "8", "--json")
        assert answer.exit_code == 0, answer.output
        report = json.loads(answer.stdout)
        assert report["contact_force_rms_N"] > 1.5
        assert report["prediction_error_percent"] < 0.5 * report["delayed_force_error_percent"]


@pytest.mark.parametrize("where", [("--robot", "fr3"), ("--robot", "ur5e", "--scene", "hill"), ()], ids=str)
@pytest.mark.long
def test_the_file_of_another_sensor_is_one_line_and_leaves_nothing(where: tuple[str, ...], tmp_path: Path) -> None:
    path, recording = tmp_path / "sensor.toml", tmp_path / "session.mcap"
    foretouch("calibrate", "sensor", DOCS / "examples" / "poses.csv", "--output", path)
    words = ["simulate", *where, "--calibration", path, "--recording", recording, "--report", tmp_path / "out"]
    done = subprocess.run([sys.executable, "-m", "foretouch", *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 2
    line = next(one for one in done.stderr.splitlines() if not one.startswith(("compiling", "calibration:")))
    assert line.startswith(f"foretouch: --calibration = '{path}': leaves ")
    assert line.endswith("calibrate again (foretouch calibrate sensor)")
    assert ("N m about the tip" in line) == bool(where)
    assert not recording.exists()
    assert not (tmp_path / "out").exists()


def begin(path: Path, name: str, load: Any, seed: int, *, wrench: Any = (0.0,) * 6, mass: float = 0.0) -> None:
    """Begin a session with this calibration, whose bias is wrong by a wrench, and whose tool by a mass."""
    off = np.asarray(load.bias) + wrench
    known: dict[str, Any] = {"force_bias": tuple(off[:3].tolist()), "torque_bias": tuple(off[3:].tolist())}
    known |= {"tool_mass": load.mass + mass, "centre_of_mass": load.centre_of_mass, "sensor_turn": load.sensor_turn}
    write_calibration(path, SensorCalibration(**known))
    settings = SessionSettings(robot=name, calibration=str(path), seed=seed)
    drive_follower(make_session_robot(settings)[0], settings, 1)


def found(measuring: Any, name: str, seed: int) -> Any:
    """A calibration in twelve poses, of three rows each."""
    matrices, shown = zip(
        *[(matrix, rows[:3].mean(axis=0)) for matrix, rows in poses(measuring, name, seed)], strict=True
    )
    down, wrench = -np.array(matrices)[:, 2, :], np.array(shown)
    return fit_tool_load(down, wrench[:, :3], wrench[:, 3:]).load


def poses(measuring: Any, name: str, seed: int) -> list[Any]:
    standing = measuring.Standing(name, 500 + seed)
    return [standing.pose() for _ in range(12)]


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.long
def test_a_right_file_is_never_refused(measuring: Any, tmp_path: Path, name: str) -> None:
    """With other poses and other noise each time; nor is one that was made when the sensor was warm, and cold it is."""
    for seed in range(20):
        load = found(measuring, name, seed)
        for warm in (0.0, 1.0):
            begin(tmp_path / "wrist.toml", name, load, seed, wrench=warm * SENSOR.drift)


WRONG: dict[str, Any] = {
    "force": {"wrench": (0.0, 0.0, 0.5, 0.0, 0.0, 0.0)},
    "mass": {"mass": 0.05},
    "across": {"wrench": (0.3, 0.0, 0.0, 0.0, 0.0, 0.0)},
    "torque": {"wrench": (0.0, 0.0, 0.0, 0.05, 0.0, 0.0)},
}


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.first
def test_an_error_with_which_it_would_not_press_is_refused(measuring: Any, tmp_path: Path, what: str) -> None:
    load = found(measuring, "fr3", 0)
    for seed in range(5):
        with pytest.raises(SettingError, match=r"wrist.toml': leaves .* at the start, in free air, where"):
            begin(tmp_path / "wrist.toml", "fr3", load, seed, **WRONG[what])

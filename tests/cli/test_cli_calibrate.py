"""`foretouch calibrate` as a user types it, on the example files of the documentation, whose truth is known."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typed_commands import output_of, refusal_of, run

from foretouch.recordings import read_calibration

DOCS = Path(__file__).resolve().parents[2] / "docs"
POSES, BLOCK, SPRING, WRIST = (DOCS / "examples" / f"{name}.csv" for name in ("poses", "block", "spring", "wrist"))


@pytest.fixture(scope="module")
def truth() -> ModuleType:
    spec = importlib.util.spec_from_file_location("examples", DOCS / "make_calibration_examples.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_files_are_those_of_the_script(truth: ModuleType) -> None:
    assert truth.poses() == POSES.read_text()
    assert truth.wrist() == WRIST.read_text()


def test_the_truth_lies_within_three_standard_errors(truth: ModuleType, tmp_path: Path) -> None:
    content = output_of("calibrate", "sensor", POSES, "--output", tmp_path / "sensor.toml")
    result = read_calibration(tmp_path / "sensor.toml")
    for name, expected in (
        ("force_bias", truth.FORCE_BIAS),
        ("torque_bias", truth.TORQUE_BIAS),
        ("tool_mass", truth.MASS),
        ("centre_of_mass", truth.CENTRE),
    ):
        away = np.abs((np.array(getattr(result, name)) - expected) / np.array(getattr(result, f"{name}_error")))
        assert np.all(away < 3.0), name
    assert content["force_bias_N"] == list(result.force_bias or ())
    assert content["free_air_force_N"] == pytest.approx(-truth.FORCE_BIAS[2] - truth.MASS * truth.GRAVITY, abs=0.03)
    assert content["poses"] == 8
    assert 0.005 < content["force_residual_rms_N"] < 0.03


def test_a_turned_sensor_and_a_touch_at_the_wrist_are_said(truth: ModuleType, tmp_path: Path) -> None:
    output, figure = tmp_path / "wrist.toml", tmp_path / "residuals.png"
    result = run("calibrate", "sensor", WRIST, "--output", output, "--figure", figure, "--report", tmp_path / "page")
    assert result.exit_code == 0, result.exception
    assert "1 pose (9)" in result.stderr
    assert "the sensor's x, y and z axes point along y, -x, z of" in result.stderr
    assert "poses_left_out                   9" in result.stdout
    assert figure.read_bytes().startswith(b"\x89PNG")
    load, true = read_calibration(output).tool_load, truth.WRIST_TOOL
    assert load is not None
    assert load.mass == pytest.approx(true.mass, abs=0.003)
    np.testing.assert_allclose(load.centre_of_mass, true.centre_of_mass, atol=1e-3)
    np.testing.assert_allclose(load.sensor_turn, true.sensor_turn, atol=0.01)


def wrist_table(folder: Path, change: Callable[[dict[str, np.ndarray]], object]) -> Path:
    """The table of the wrist's poses without the one that touches, changed; columns by the first letter of a group."""
    header, *lines = WRIST.read_text().splitlines()
    rows = np.array([[float(value) for value in line.split(",")] for line in lines if not line.startswith("9,")])
    groups = {"pose": rows[:, :1], "force": rows[:, 1:4], "torque": rows[:, 4:7], "turn": rows[:, 7:]}
    change(groups)
    path = folder / "changed.csv"
    changed = "\n".join(",".join(f"{value:.6f}" for value in row) for row in np.hstack(list(groups.values())))
    path.write_text(f"{header}\n{changed}\n")
    return path


def upright_about_x(groups: dict[str, np.ndarray]) -> None:
    """Orientations in a base whose x axis points up."""
    tilt = Rotation.from_euler("y", 90.0, degrees=True)
    groups["turn"][:] = (tilt * Rotation.from_rotvec(groups["turn"])).as_rotvec()


WRONG: dict[str, tuple[Callable[[dict[str, np.ndarray]], object], str]] = {
    "reaction": (lambda all_: (all_["force"].__imul__(-1), all_["torque"].__imul__(-1)), "the sensor's axes are left-"),
    "one axis": (lambda all_: all_["force"].__imul__((1, 1, -1)), "left-handed against the flange's"),
    "inverse": (
        lambda all_: all_["turn"].__imul__(-1),
        "give what turns vectors of the flange into the frame of the base",
    ),
    "base": (upright_about_x, "gravity pulls along its x axis; give them in a base whose z"),
    "torque axes": (lambda all_: all_["torque"].__imul__((-1, 1, 1)), "no centre of mass explains the torques"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_sign_or_frame_is_one_line_that_names_it(tmp_path: Path, name: str) -> None:
    change, said = WRONG[name]
    refused = refusal_of("calibrate", "sensor", wrist_table(tmp_path, change), "--output", tmp_path / "wrist.toml")
    assert said in refused
    assert len(refused.strip().splitlines()) == 1
    assert not (tmp_path / "wrist.toml").exists()


def test_torques_of_the_wrong_sign_are_said(tmp_path: Path) -> None:
    """They are explained by a centre of mass on the other side of the sensor: no data tells the two apart."""
    table = wrist_table(tmp_path, lambda all_: all_["torque"].__imul__(-1))
    assert (
        "behind the sensor, along -z of the flange: the sign of the torques" in run("calibrate", "sensor", table).stderr
    )
    right = run("calibrate", "sensor", wrist_table(tmp_path, lambda _: None))
    assert right.exit_code == 0, right.exception
    assert "behind" not in right.stderr


def test_an_arm_without_a_sensor_at_its_wrist_refuses_the_file_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    output_of("calibrate", "sensor", WRIST, "--output", tmp_path / "wrist.toml")
    session = ("--calibration", tmp_path / "wrist.toml", "--duration", 0.1)
    for command in (("simulate",), ("teleop", "--headless")):
        refused = refusal_of(*command, "--robot", "so101", *session)
        assert "so101 has no sensor at its wrist: leave it out" in refused
        assert len(refused.strip().splitlines()) == 1


def test_both_commands_fill_one_file_and_identify_takes_it(truth: ModuleType, tmp_path: Path) -> None:
    output = tmp_path / "sensor.toml"
    lag = output_of("calibrate", "sensor", POSES, "--motion", SPRING, "--output", output)
    assert lag["sensor_lag_s"] == pytest.approx(truth.LAG, abs=3e-4)
    fit = output_of("calibrate", "compliance", BLOCK, "--output", output)
    series = 1.0 / (1.0 / truth.STIFFNESS + 1.0 / 400e3)  # the block gives way too
    assert fit["series_stiffness_N_per_m"] == pytest.approx(series, abs=3.0 * fit["series_stiffness_error_N_per_m"])
    assert fit["lost_motion_m"] == pytest.approx(truth.LOST_MOTION, abs=1.5e-6)
    both = read_calibration(output)
    assert both.tool_mass is not None
    assert both.series_stiffness == fit["series_stiffness_N_per_m"]
    again = output_of("calibrate", "sensor", POSES, "--output", output)  # without motion the lag stays
    assert again["sensor_lag_s"] == lag["sensor_lag_s"]
    assert read_calibration(output) == both
    law = ("--model", "kelvin-voigt", "--estimator", "offline", "--surface", 0.01)
    plain, mended = output_of("identify", SPRING, *law), output_of("identify", SPRING, *law, "--sensor", output)
    assert plain.keys() == mended.keys()
    assert abs(mended["parameters"]["stiffness"] - 3000.0) < 40.0 < 150.0 < abs(plain["parameters"]["stiffness"] - 3000)
    assert mended["sensor_lag_s"] < 1e-4
    assert mended["force_offset_N"] == both.force_offset


def test_an_approach_along_another_axis(truth: ModuleType, tmp_path: Path) -> None:
    content = output_of("calibrate", "sensor", POSES, "--axis", "0,-2,0", "--approach-gravity", 0)
    assert content["free_air_force_N"] == pytest.approx(truth.FORCE_BIAS[1], abs=0.03)


def test_pages_and_text(tmp_path: Path) -> None:
    for arguments in (("sensor", POSES), ("compliance", BLOCK)):
        result = run("calibrate", *arguments, "--report", tmp_path / arguments[0])
        assert result.exit_code == 0, result.exception
        assert "residual_rms" in result.stdout
        page = (tmp_path / arguments[0] / "index.html").read_text()
        assert page.count("data:image/svg+xml") == 1
        assert arguments[1].name in page


def test_refusals_leave_the_file_as_it_was(tmp_path: Path) -> None:
    output = tmp_path / "sensor.toml"
    output_of("calibrate", "compliance", BLOCK, "--output", output)
    before = output.read_bytes()
    lines = POSES.read_text().splitlines()
    flat = tmp_path / "flat.csv"
    flat.write_text("\n".join([lines[0], *lines[1:3], *lines[1:3]]) + "\n")
    assert "add poses with the sensor tilted" in refusal_of("calibrate", "sensor", flat, "--output", output)
    assert "samples while loading" in refusal_of("calibrate", "compliance", air(tmp_path), "--output", output)
    assert "tell no lag" in refusal_of("calibrate", "sensor", POSES, "--motion", air(tmp_path), "--output", output)
    assert output.read_bytes() == before
    assert "is what is read" in refusal_of("calibrate", "compliance", output, "--output", output)
    assert "must end with .toml" in refusal_of("calibrate", "sensor", POSES, "--output", tmp_path / "sensor.csv")
    assert "axis = '1,2'" in refusal_of("calibrate", "sensor", POSES, "--axis", "1,2")
    assert "must end with .png" in refusal_of("calibrate", "sensor", POSES, "--figure", tmp_path / "residuals.pdf")
    assert "no such file" in refusal_of("calibrate", "compliance", tmp_path / "no.csv")
    assert "No such file" in refusal_of("calibrate", "sensor", tmp_path / "no.csv")
    assert {path.name for path in tmp_path.iterdir()} == {"sensor.toml", "flat.csv", "air.csv"}


def air(folder: Path) -> Path:
    """A recording that never touches."""
    path = folder / "air.csv"
    noise = np.random.default_rng(0).normal(0.3, 0.01, 2000)
    rows = "\n".join(f"{0.001 * tick:.3f},{1e-6 * tick:.6f},{force:.4f}" for tick, force in enumerate(noise))
    path.write_text(f"time_s,position_m,force_N\n{rows}\n")
    return path


def test_what_is_given_twice_is_refused(tmp_path: Path) -> None:
    output = tmp_path / "sensor.toml"
    output_of("calibrate", "sensor", POSES, "--motion", SPRING, "--output", output)
    for option in ("--force-offset", "--sensor-lag"):
        assert "give one of them" in refusal_of("identify", SPRING, "--sensor", output, option, 0.001)
    assert "cannot be read" in refusal_of("identify", SPRING, "--sensor", tmp_path / "none.toml")

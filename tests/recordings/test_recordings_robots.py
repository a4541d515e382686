"""Logs of common robots are read as they are; and units that are given are heard."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import RecordingError
from foretouch.recordings import inspect_recording, read_recording, read_with_notes

ROWS = 400
TIME = np.arange(ROWS) * 1e-3
DEPTH = 0.004 * np.sin(TIME * 20.0)
FORCE = 900.0 * np.maximum(DEPTH, 0.0)

FRANKA = ["time", *(f"q[{n}]" for n in range(7)), *(f"tau_J[{n}]" for n in range(7)),
          *(f"O_T_EE[{n}]" for n in range(16)), *(f"O_T_EE_d[{n}]" for n in range(16)),
          *(f"O_F_ext_hat_K[{n}]" for n in range(6)), *(f"K_F_ext_hat_K[{n}]" for n in range(6))]  # fmt: skip
UR = ["timestamp", *(f"target_q_{n}" for n in range(6)), *(f"actual_q_{n}" for n in range(6)),
      *(f"actual_TCP_pose_{n}" for n in range(6)), *(f"actual_TCP_speed_{n}" for n in range(6)),
      *(f"actual_TCP_force_{n}" for n in range(6))]  # fmt: skip


def write(path: Path, names: list[str], position: str, force: str, separator: str = ",") -> Path:
    """A log with nonsense in all columns but those of time, position and force."""
    rng = np.random.default_rng(1)
    values = {name: rng.normal(0.0, 0.3, ROWS) for name in names} | {names[0]: TIME, position: DEPTH, force: FORCE}
    rows = [separator.join(names)]
    rows += [separator.join(f"{values[name][row]:.9g}" for name in names) for row in range(ROWS)]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize(
    ("names", "position", "force", "frame"),
    [
        (FRANKA, "O_T_EE[14]", "O_F_ext_hat_K[2]", "base frame"),
        ([name for name in FRANKA if "O_F" not in name], "O_T_EE[14]", "K_F_ext_hat_K[2]", "along that frame itself"),
        ([name.replace("[", "_").replace("]", "") for name in FRANKA], "O_T_EE_14", "O_F_ext_hat_K_2", "base frame"),
        ([f"state/{name}" for name in FRANKA], "state/O_T_EE[14]", "state/O_F_ext_hat_K[2]", "base frame"),
        (UR, "actual_TCP_pose_2", "actual_TCP_force_2", "base frame"),
    ],
)
def test_the_columns_of_common_robots_are_known(
    tmp_path: Path, names: list[str], position: str, force: str, frame: str
) -> None:
    read = read_with_notes(write(tmp_path / "robot.csv", names, position, force, " " if names is UR else ","))
    np.testing.assert_allclose(read.recording.position, DEPTH, atol=1e-9)
    np.testing.assert_allclose(read.recording.force, FORCE, atol=1e-8)
    notes = "\n".join(read.notes)
    assert f"{position} is taken for position: " in notes
    assert f"{force} is taken for force: " in notes
    assert "robot's base frame" in notes
    assert frame in notes


def test_a_column_that_says_plainly_what_it_is_goes_before_a_robots(tmp_path: Path) -> None:
    read = read_with_notes(write(tmp_path / "robot.csv", [*FRANKA, "force_N"], "O_T_EE[14]", "force_N"))
    np.testing.assert_allclose(read.recording.force, FORCE, atol=1e-8)
    assert not any("is taken for force" in note for note in read.notes)


def test_a_unit_that_is_given_is_heard_whichever_it_is(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", ["t_s", "z_mm", "Fz"], "z_mm", "Fz")
    with pytest.raises(RecordingError, match="the unit of the force Fz is not known"):
        read_recording(path)
    for unit, size in (("N", 1.0), ("mN", 1e-3), ("kN", 1e3)):
        with pytest.warns(UserWarning, match="columns guessed"):
            matches = read_recording(path, force_unit=unit)
        np.testing.assert_allclose(matches.force, FORCE * size, atol=1e-8 * size)
    with pytest.raises(RecordingError, match="the position z_mm is in mm: leave --position-unit out"):
        read_recording(path, position_unit="m", force_unit="N")
    result = CliRunner().invoke(
        app, ["recordings", "convert", str(path), str(tmp_path / "out.csv"), "--force-unit", "N"]
    )
    assert result.exit_code == 0, result.output


def test_numbers_are_numbers_and_words_are_text(tmp_path: Path) -> None:
    path = tmp_path / "mixed.csv"
    path.write_text("Zeit [s];Weg [mm];Kraft [N];Phase\n" + "".join(f"0,0{n};{n},5;1,25;auf\n" for n in range(9)))
    kinds = {column.name: column.kind for column in inspect_recording(path).columns}
    assert kinds == {"Zeit [s]": "number", "Weg [mm]": "number", "Kraft [N]": "number", "Phase": "text"}

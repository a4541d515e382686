"""Make the small files that the pages on calibration use, in `docs/examples`: poses, presses on a block and a spring.

They are simulated, with known truth: the numbers below. Usage: `.venv/bin/python docs/make_calibration_examples.py`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from foretouch.quantities import ToolLoad
from foretouch.robot.arms.sensing.wrist_sensor import WristSensor

sys.path.insert(0, str(Path(__file__).parent))
from measure_arms import Standing

FOLDER = Path(__file__).parent / "examples"
FORCE_BIAS, TORQUE_BIAS = np.array([1.2, -0.7, 3.1]), np.array([0.02, -0.05, 0.01])
MASS, CENTRE = 0.35, np.array([0.002, -0.001, 0.045])
GRAVITY = 9.80665
STIFFNESS, LOST_MOTION, LAG = 40e3, 12e-6, 2e-3
FORCE_NOISE, TORQUE_NOISE, COUNT = 0.02, 0.0005, 5e-6
DIRECTIONS = np.array(
    [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (1, 1, 1), (-1, 1, 1)], dtype=float
)


def poses() -> str:
    """Eight poses of a tool, as a sensor of six axes shows them."""
    random = np.random.default_rng(1)
    rows = ["pose,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm,gx,gy,gz"]
    for number, direction in enumerate(DIRECTIONS, 1):
        down = direction / np.linalg.norm(direction)
        weight = MASS * GRAVITY * down
        force = FORCE_BIAS + weight + random.normal(0.0, FORCE_NOISE, 3)
        torque = TORQUE_BIAS + np.cross(CENTRE, weight) + random.normal(0.0, TORQUE_NOISE, 3)
        rows.append(",".join([str(number), *(f"{value:.5f}" for value in (*force, *torque, *down))]))
    return "\n".join(rows) + "\n"


WRIST_TOOL = ToolLoad((0.0,) * 6, 0.3, (0.004, -0.003, 0.06), (0.0, 0.0, -0.5 * np.pi))
WRIST_PIECE, TOUCHING = 1, 9
"""Which simulated sensor it is, and the pose in which the end of the tool, 0.2 m away, touches something."""


FLANGE_COLUMNS = "pose,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm,rx_rad,ry_rad,rz_rad"


def flange_row(number: int, wrench: np.ndarray, turn: Rotation) -> str:
    """A row of a pose: the load on the sensor, and how the flange is turned."""
    return ",".join([str(number), *(f"{value:.5f}" for value in (*wrench, *turn.as_rotvec()))])


def wrist() -> str:
    """Twelve poses of an arm's flange, three rows each, with a wrist's sensor that is turned by a quarter."""
    sensor, random = WristSensor(1e-3, seed=4, piece=WRIST_PIECE), np.random.default_rng(4)
    turns = [Rotation.from_euler("xyz", angles, degrees=True) for angles in ((180, 0, 0), (0, 0, 0), (90, 0, 0))]
    turns += [Rotation.from_euler("xyz", angles, degrees=True) for angles in ((-90, 0, 0), (0, 90, 0), (0, -90, 0))]
    turns += list(Rotation.random(6, rng=random))
    rows = [FLANGE_COLUMNS]
    for number, turn in enumerate(turns, 1):
        load = WRIST_TOOL.wrench(turn.as_matrix())
        if number == TOUCHING:
            touch = np.array((0.3, 0.2, 0.0))
            load = load + np.concatenate((touch, np.cross((0.0, 0.0, 0.2), touch)))
        sensor.settle(-load)
        for _ in range(3):
            rows.append(flange_row(number, sensor.read(), turn))
    return "\n".join(rows) + "\n"


def fr3() -> str:
    """Twelve poses of the simulated FR3, three rows each, with the sensor and the tool that it has in a session."""
    arm, rows = Standing("fr3", 4), [FLANGE_COLUMNS]
    for number in range(1, 13):
        matrix, shown = arm.pose()
        rows += [flange_row(number, wrench, Rotation.from_matrix(matrix)) for wrench in shown[:3]]
    return "\n".join(rows) + "\n"


def press(depth: np.ndarray, stiffness: float, time: np.ndarray, seed: int) -> str:
    """A press on a spring, felt late through an arm that gives way and loses motion."""
    random = np.random.default_rng(seed)
    force = stiffness * np.maximum(depth, 0.0)
    lost = 0.5 * LOST_MOTION * np.clip(np.gradient(force, time) / 1.0, -1.0, 1.0)
    position = 0.01 + depth + force / STIFFNESS - lost
    position = COUNT * np.round((position + random.normal(0.0, 0.4 * COUNT, time.size)) / COUNT)
    shown = np.interp(time - LAG, time, force) - FORCE_BIAS[2] - MASS * GRAVITY
    shown += random.normal(0.0, FORCE_NOISE, time.size)
    rows = (f"{t:.3f},{x:.6f},{f:.4f}" for t, x, f in zip(time, position, shown, strict=True))
    return "time_s,position_m,force_N\n" + "\n".join(rows) + "\n"


def main() -> None:
    """Write them."""
    FOLDER.mkdir(exist_ok=True)
    time = np.arange(0.0, 4.0, 2e-3)
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * time)
    (FOLDER / "poses.csv").write_text(poses())
    (FOLDER / "wrist.csv").write_text(wrist())
    (FOLDER / "fr3.csv").write_text(fr3())
    (FOLDER / "block.csv").write_text(press(-2e-4 + 2.3e-4 * swing, 400e3, time, 2))
    quick = 0.5 - 0.5 * np.cos(5.0 * np.pi * time)
    (FOLDER / "spring.csv").write_text(press(-1e-3 + 6e-3 * quick, 3e3, time, 3))


if __name__ == "__main__":
    main()

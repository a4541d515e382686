"""MuJoCo where the environment names a library for drawing that is not there."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("mujoco")

STEP = """
import os
from foretouch.robot.engine import load_mujoco
mujoco = load_mujoco()
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
mujoco.mj_step(model, mujoco.MjData(model))
print(os.environ.get("MUJOCO_GL"))
"""


@pytest.mark.parametrize(
    "chosen", ["nonsense", "egl", *(pytest.param(chosen, marks=pytest.mark.long) for chosen in ("osmesa", None))]
)
def test_a_robot_moves_whatever_is_said_of_drawing(chosen: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    environment |= {} if chosen is None else {"MUJOCO_GL": chosen}
    run = subprocess.run([sys.executable, "-c", STEP], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == str(chosen)

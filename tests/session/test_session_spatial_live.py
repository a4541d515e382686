"""A session in three dimensions in real time: five processes, a camera among them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from foretouch.link import free_endpoint
from foretouch.recordings import read_session
from foretouch.session.spatial.scenes import NOMINAL

pytestmark = pytest.mark.live


def foretouch(*arguments: object, timeout: float = 90.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "foretouch", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


@pytest.mark.long
def test_a_scene_is_pressed_seen_and_recorded(tmp_path: Path) -> None:
    path = tmp_path / "scene.mcap"
    ended = foretouch(
        "teleop",
        "--headless",
        "--scene",
        "hill",
        "--operator",
        "scripted",
        "--duration",
        9,
        "--recording",
        path,
        "--json",
    )
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
    report = json.loads(ended.stdout)
    assert "scene" in report
    log = read_session(path)
    assert log.settings["scene"] == "hill"
    assert log.leader_space.size > 0.7 * log.leader.size
    assert log.follower["exact_force"].max() > 0.3
    assert any(model.valid for model in log.models)
    assert log.fields
    last = log.follower_space[-1]
    believed, true = (np.array([last[f"{name}_{axis}"] for axis in "xyz"]) for name in ("fixture", "exact"))
    if log.images:  # where something here draws
        assert np.linalg.norm(believed - true) < 2e-3
        assert np.linalg.norm(np.array(NOMINAL[:3]) - true) > 5e-3


@pytest.mark.long
def test_sides_of_different_scenes_are_told_apart() -> None:
    endpoint = free_endpoint()
    common = ["--parent", str(os.getpid())]
    follower = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "foretouch",
            "follower",
            "--scene",
            "hill",
            "--listen",
            endpoint,
            "--duration",
            "30",
            *common,
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        ended = foretouch("leader", "--connect", endpoint, "--duration", 3, timeout=60)
        assert ended.returncode != 0
        assert "give this side --scene hill too" in ended.stderr
    finally:
        follower.terminate()
        follower.wait(20)

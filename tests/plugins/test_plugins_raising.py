"""A driver of another package that raises in the loop of a session, against its promise: the session ends in order."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from plugin_packages import make_package

from foretouch.recordings import is_whole, read_session

pytestmark = pytest.mark.live

DEVICE = """
from foretouch.devices import Device


class Torn(Device):
    name = "torn"
    closed_loop = False
    real_time = False

    left = 2000

    def read(self, now_ns):
        self.left -= 1
        if self.left < 0:
            raise OSError("the cable is torn")
        return 0.0

    def render(self, force):
        return 0.0


def make(settings, reach):
    return Torn()
"""

ROBOT = """
from foretouch.robot import make_robot


def make(settings):
    robot = make_robot("hunt-crossley", seed=1)
    move, left = robot.exchange, [8000]

    def exchange(desired):
        left[0] -= 1
        if left[0] < 0:
            raise OSError("the drive is gone")
        return move(desired)

    robot.exchange = exchange
    return robot
"""


@pytest.mark.parametrize(
    ("kind", "source", "options", "said"),
    [
        ("device", DEVICE, ("--operator", "torn"), "the leader failed: OSError: the cable is torn"),
        (
            "robot",
            ROBOT,
            ("--robot", "torn", "--operator", "scripted"),
            "the follower failed: OSError: the drive is gone",
        ),
    ],
)
def test_the_session_ends_in_order_and_says_why(
    tmp_path: Path, kind: str, source: str, options: tuple[str, ...], said: str
) -> None:
    site = make_package(tmp_path / "site", "torn", {kind: {"torn": "torn:make"}}, source)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "foretouch",
            "teleop",
            "--headless",
            "--duration",
            "60",
            "--recording",
            "s.mcap",
            *options,
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])},
        timeout=60,
    )
    assert done.returncode == 1, done.stderr
    assert f"foretouch: {said}\n" in done.stderr
    assert "in read" in done.stderr if kind == "device" else "in exchange" in done.stderr
    assert is_whole(tmp_path / "s.mcap")
    assert read_session(tmp_path / "s.mcap").leader.size > 100

"""A driver of another package that raises in the loop of a session, against its promise: the session ends in order."""

from __future__ import annotations

from pathlib import Path

import pytest
from plugin_sessions import run_with

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


def torn(settings, reach):
    return Torn()
"""

ROBOT = """
from foretouch.robot import make_robot


def torn(settings):
    robot = make_robot("hunt-crossley", seed=1)
    move, left = robot.exchange, [1000]

    def exchange(desired):
        sample = move(desired)
        if left[0] < 1000 or sample.exact_force > 0.5:  # from the first press on: then there is a leader
            left[0] -= 1
        if left[0] < 0:
            raise OSError("the drive is gone")
        return sample

    robot.exchange = exchange
    return robot
"""


@pytest.mark.parametrize(
    ("kind", "source", "options", "said"),
    [
        pytest.param(
            *("device", DEVICE, ("--operator", "torn"), "the leader failed: OSError: the cable is torn"),
            marks=pytest.mark.long,
        ),
        (
            "robot",
            ROBOT,
            ("--robot", "torn", "--operator", "scripted"),
            "the follower failed: OSError: the drive is gone",
        ),
    ],
    ids=["device", "robot"],
)
def test_the_session_ends_in_order_and_says_why(
    tmp_path: Path, kind: str, source: str, options: tuple[str, ...], said: str
) -> None:
    teleop = ("teleop", "--headless", "--duration", 60, "--recording", "s.mcap")
    ran = run_with(tmp_path, kind, source, "torn", *teleop, *options)
    assert ran.code == 1, ran.err
    assert f"foretouch: {said}\n" in ran.err
    assert "in read" in ran.err if kind == "device" else "in exchange" in ran.err
    assert is_whole(tmp_path / "s.mcap")
    assert read_session(tmp_path / "s.mcap").leader.size > 100

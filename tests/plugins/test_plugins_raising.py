"""A driver of another package that raises in the loop of a session, against its promise: the session ends in order."""

from __future__ import annotations

from pathlib import Path

import pytest
from failing_drivers import DEVICE, ROBOT
from plugin_sessions import run_with

from foretouch.recordings import is_whole, read_session

pytestmark = [pytest.mark.live, pytest.mark.long]  # simulated, in test_session_failures.py


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

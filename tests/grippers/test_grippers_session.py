"""A session over two grippers, each on a bus of its own, with a hand that feels what is rendered."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from pathlib import Path

import pytest
from servo_bus import LEVER, TORQUE, ServoBus

from apart import Apart

pytestmark = [pytest.mark.live, pytest.mark.long]

DEEPEST, SLOW, PRESSES = 0.036, 9.0, 2.5
"""To which the hand wants [m]; the time of its first way in, for a follower feels its way to a surface at 4 mm/s [s];
that of each press after it [s]."""


def wanted(seconds: float) -> float:
    """How far the hand wants to be in [m]: in and out slowly, then presses."""
    if seconds < SLOW:
        return DEEPEST * math.sin(math.pi * seconds / SLOW) ** 0.5
    return DEEPEST * math.sin(math.pi * (seconds - SLOW) / PRESSES) ** 2


def test_a_press_is_felt_and_both_are_left_without_torque(tmp_path: Path) -> None:
    pytest.importorskip("dynamixel_sdk")
    with Apart(ServoBus) as far, Apart(ServoBus) as near:
        far.thing, near.hand = 0.03, near.start  # 16 mm in, 500 N/m
        words = ("--robot", f"dynamixel@{far.port},lever={LEVER}", "--operator", f"dynamixel@{near.port},lever={LEVER}")
        command = [sys.executable, "-m", "foretouch", "teleop", "--headless", "--json", "--duration", "24", *words]
        session = subprocess.Popen(
            [*command, "--device-damping", "1.5", "--position-delay", "0.08", "--force-delay", "0.08"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
        began, met = 0.0, 0.0
        while session.poll() is None:
            if not began and far.get(TORQUE) and near.get(TORQUE):
                began = time.monotonic()
            seconds = max(time.monotonic() - began - 3.0, 0.0) if began else 0.0
            near.hand = near.start - wanted(seconds)
            met = max(met, far.met())
            time.sleep(0.02)
        printed, said = session.communicate()
        assert session.returncode == 0, said
        assert "exchanges a second: with 1.5 N s/m no more than" in said
        report = json.loads(printed)
        assert report["max_rendered_force_N"] > 0.5, said
        assert report["hand"]["certificate_holds"]
        assert 1.0 < met < 8.0
        assert not far.get(TORQUE)
        assert not near.get(TORQUE)

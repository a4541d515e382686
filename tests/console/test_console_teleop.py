"""The whole lap with a browser: the mouse moves the real probe and the forces that are plotted."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console_driver import chromium, held_handle, open_page, plot_data

from foretouch.link import free_endpoint
from foretouch.recordings import read_session
from foretouch.rendering.mediation import LARGEST_STEP

pytestmark = [
    pytest.mark.browser,
    pytest.mark.live,
    pytest.mark.skipif(chromium() is None, reason="no Chromium: install it, or set FORETOUCH_BROWSER"),
]


def wait_for_page(url: str, seconds: float = 40.0) -> None:
    end = time.monotonic() + seconds
    while True:
        try:
            urllib.request.urlopen(url, timeout=2).close()
        except (urllib.error.URLError, OSError):
            assert time.monotonic() < end, "the console did not come up"
            time.sleep(0.2)
        else:
            return


@contextlib.contextmanager
def teleop_page(path: Path, *options: str) -> Iterator[tuple[Any, list[str], subprocess.Popen[str]]]:
    """A live session with its console on a page; it must end well once the stop button was clicked."""
    port = int(free_endpoint().rpartition(":")[2])
    url = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "foretouch", "teleop", "--port", str(port), "--material", "hunt-crossley"]
    with subprocess.Popen(
        [*command, "--recording", str(path), "--json", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as teleop:
        try:
            wait_for_page(url)
            with open_page(url) as (page, requests):
                yield page, requests, teleop
                page.get_by_text("Stop the session").click()
                _, err = teleop.communicate(timeout=40)
        finally:
            teleop.kill()
    assert teleop.returncode == 0, err


def test_dragging_the_handle_presses_the_material(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    with teleop_page(path) as (page, requests, _):
        page.wait_for_timeout(4000)
        with held_handle(page, press_mm=18.0, seconds=2.0):
            page.wait_for_timeout(3500)
            columns = plot_data(page)
        assert all(address.split("//")[1].startswith("127.0.0.1") for address in requests if "//" in address)
    log = read_session(path)
    # A hand on the handle rests, which the script never does for two seconds; so does the real probe, where it pressed.
    surface = float(log.settings["surface"])
    rows = log.rows()
    half_seconds = (rows.leader["time_ns"] - rows.leader["time_ns"][0]) // 500_000_000
    stretches = [np.flatnonzero(half_seconds == number) for number in np.unique(half_seconds)]
    resting = [stretch for stretch in stretches if np.ptp(rows.leader["position"][stretch]) < 1e-4][1:-1]
    assert len(resting) >= 3, "the handle did not hold the leader still"
    held = np.concatenate(resting)
    depth = np.median(rows.follower["position"][held]) - surface
    assert depth > 0.004
    assert np.median(rows.follower["position"][held] - rows.leader["position"][held]) == pytest.approx(0.0, abs=1e-4)
    pressed = np.median(rows.follower["exact_force"][held])
    assert pressed > 1.0
    # What the page drew as true force while the handle was held is what the simulator says.
    true = columns[1][np.isfinite(columns[1])]
    assert true[-20:].mean() == pytest.approx(pressed, abs=0.3)


def test_the_clutch_lets_a_hand_go_alone(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    with teleop_page(path, "--grip", "normal", "--force-delay", "0.05") as (page, _, _teleop):
        page.get_by_text("It moves a hand that follows your mouse (normal grip).").wait_for()
        page.get_by_text("Energy put in").wait_for()
        page.wait_for_timeout(3000)
        with held_handle(page, press_mm=16.0, seconds=1.0):
            page.wait_for_timeout(1500)
        clutch = page.get_by_role("button", name="Clutch")
        clutch.press("Enter")
        page.get_by_text("Clutch is pressed: let it go").wait_for(timeout=30_000)
        page.wait_for_timeout(1000)
        clutch.press("Enter")
        page.get_by_text("Clutch", exact=True).wait_for(timeout=30_000)
        page.wait_for_timeout(1000)
    leader = read_session(path).leader
    met = int(np.argmax(leader["engaged"]))
    alone = met + np.flatnonzero(~leader["engaged"][met:])
    assert alone.size > 200, "the clutch was not pressed"  # of 1000; a busy machine skips ticks
    np.testing.assert_array_equal(np.diff(alone), 1)  # once
    start, stop = int(alone[0]), int(alone[-1]) + 1
    assert np.ptp(leader["position"][alone]) == 0.0
    assert np.abs(leader["update_step"]).max() <= LARGEST_STEP + 1e-9
    assert leader["rendered_force"][alone[-1]] < 1e-3
    # A late tick lets the hand go further; what it went is all that a command moves, before and after.
    for tick in (start, stop):
        moved = leader["position"][tick] - leader["position"][tick - 1]
        assert abs(moved) <= abs(leader["hand_position"][tick] - leader["hand_position"][tick - 1]) + 1e-9
    assert (leader["energy"] >= -leader["energy_bound"] - 1e-12).all()

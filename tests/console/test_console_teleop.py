"""The whole lap with a browser: the mouse moves the real probe and the forces that are plotted."""

from __future__ import annotations

import base64
import contextlib
import importlib.util
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console_driver import (
    choose,
    chromium,
    held_handle,
    held_in_space,
    kill_tab,
    open_page,
    open_tab,
    plot_data,
    take_handle,
    wait_for,
)
from visitors import Printed

from foretouch.console.panels.space import DRAW_PROBE
from foretouch.console.panels.stop import LATCHED, READY
from foretouch.console.views.space import SPACE_INSTRUCTION
from foretouch.devices.browser import HOLD_TIME
from foretouch.link import free_endpoint
from foretouch.messages import Status
from foretouch.quantities.colours import BLUE
from foretouch.recordings import read_session
from foretouch.rendering.mediation import LARGEST_STEP

pytestmark = [
    pytest.mark.browser,
    pytest.mark.live,
    pytest.mark.skipif(chromium() is None, reason="no Chromium: install it, or set FORETOUCH_BROWSER"),
]


def docs_script(name: str) -> Any:
    """One of the documentation's scripts as a module."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).parents[2] / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def wait_for_bytes(page: Any, path: Path, size: int) -> None:
    """Wait until a recording has grown to so many bytes: about 400 a tick of either side."""
    wait_for(lambda: path.exists() and path.stat().st_size >= size, 30.0, page)


@contextlib.contextmanager
def teleop_page(
    path: Path, *options: str, click: bool = True, says: str = "Drag the blue handle down to press"
) -> Iterator[tuple[Any, list[str], subprocess.Popen[str]]]:
    """A live session with its console on a page; it must end well once it was ended: by `click`, or by the block."""
    port = int(free_endpoint().rpartition(":")[2])
    command = [sys.executable, "-m", "foretouch", "teleop", "--port", str(port), "--material", "hunt-crossley"]
    with subprocess.Popen(
        [*command, "--recording", str(path), "--json", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as teleop:
        try:
            printed = Printed(teleop)
            with open_page(printed.address(), says=says) as (page, requests):
                yield page, requests, teleop
                if click:
                    open_tab(page, "Session")
                    page.get_by_text("End the session").click()
                assert teleop.stdout is not None
                teleop.stdout.read()
                teleop.wait(timeout=40)
        finally:
            teleop.kill()
    assert teleop.returncode == 0, printed.text


@pytest.mark.long
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
    segments = [np.flatnonzero(half_seconds == number) for number in np.unique(half_seconds)]
    resting = [segment for segment in segments if np.ptp(rows.leader["position"][segment]) < 1e-4][1:-1]
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


@pytest.mark.long
def test_the_clutch_lets_a_hand_go_alone(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    with teleop_page(path, "--grip", "normal", "--force-delay", "0.05") as (page, _, _teleop):
        page.get_by_text("It moves a hand that follows your mouse (normal grip).").wait_for()
        page.wait_for_timeout(3000)
        with held_handle(page, press_mm=16.0, seconds=1.0):
            page.wait_for_timeout(1500)
        clutch = page.get_by_role("button", name="Clutch")
        clutch.press("Enter")
        page.get_by_text("Clutch is pressed: let it go").wait_for(timeout=30_000)
        page.wait_for_timeout(1000)
        clutch.press("Enter")
        page.get_by_text("Clutch (C)", exact=True).wait_for(timeout=30_000)
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


@pytest.mark.long
def test_what_is_chosen_while_it_runs_is_what_runs_and_each_recording_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    with teleop_page(path, "--force-delay", "0.1") as (page, _, _teleop):
        open_tab(page, "Session")
        page.get_by_text("Recording: ").wait_for()
        choose(page, "Material", "kelvin-voigt")
        page.get_by_text("Begins anew with kelvin-voigt").wait_for()
        page.get_by_text("kelvin-voigt · contact-map · bank").wait_for(timeout=40_000)
        wait_for_bytes(page, path, path.stat().st_size + 1_000_000)
        page.keyboard.press("r")
        page.get_by_text("Nothing is recorded.").wait_for()
        page.wait_for_timeout(500)
        page.keyboard.press("r")
        page.get_by_text("live-2.mcap").wait_for()
        wait_for_bytes(page, tmp_path / "live-2.mcap", 1_000_000)
        open_tab(page, "Recordings")
        choose(page, "Recording", str(path))  # it is in another folder than the command
        page.get_by_text(f"RECORDING, NOT LIVE: {path}").wait_for(timeout=20_000)
    first, second = read_session(path), read_session(tmp_path / "live-2.mcap")
    assert "truncated" not in first.counts | second.counts
    assert second.settings["material"] == "kelvin-voigt"
    before, after = (len(np.unique(column)) for column in (first.leader["epoch"], first.follower["run"]))
    assert (before, after) == (2, 2)  # both sides began anew, and the recording went on
    new = first.leader[first.leader["epoch"] == first.leader["epoch"][-1]]
    assert min(new.size, second.leader.size) > 500
    assert second.leader["epoch"][0] == new["epoch"][0]  # a recording that begins starts nobody again
    assert np.unique(second.leader["epoch"]).size == 1


@pytest.mark.long
def test_no_browser_that_stalls_or_leaves_is_felt_by_the_loops() -> None:
    """A busy machine is late by itself; a loop that waited for a browser would stand still for as long as it does."""
    measure_console = docs_script("measure_console")
    runs = {"alone": measure_console.nobody, "stopped": measure_console.one_that_stands_still}
    runs["closed"] = measure_console.one_that_is_closed
    measured = measure_console.timing(*measure_console.run_all(runs, seconds=6.0, rounds=1))
    for (name, side), ((median, most, late),) in measured.items():
        _, most_alone, late_alone = measured["alone", side][0]
        assert median == pytest.approx(1.0, abs=0.01), name
        assert most < 3.0 * most_alone + 5.0
        assert late < late_alone + 15.0


@pytest.mark.long
def test_a_browser_that_draws_in_software_beside_the_loops_leaves_them_their_processor() -> None:
    """Drawing gives way: the robot is hardly ever held for it, and the prediction is as good as with nobody looking.

    Where others want the processor too, the robot is held with nobody looking, and what is left to be given is less.
    """
    measure_console = docs_script("measure_console")
    runs = {"nobody": measure_console.nobody, "drawn": measure_console.one_that_draws}
    felt = measure_console.felt(*measure_console.run_all(runs, seconds=20.0, rounds=2))
    (held_alone, error_alone), (held, error) = (np.median(felt[name], axis=0) for name in ("nobody", "drawn"))
    assert held < held_alone + 1.0
    assert error < error_alone + 3.0


@pytest.mark.long
def test_an_emergency_stop_is_released_at_the_follower_and_a_killed_tab_lets_go(tmp_path: Path) -> None:
    path = tmp_path / "live.mcap"
    with teleop_page(path, "--grip", "normal", "--force-delay", "0.05", click=False) as (page, _, teleop):
        page.wait_for_timeout(2000)
        take_handle(page, press_mm=20.0)
        page.wait_for_timeout(500)
        page.get_by_role("button", name=READY).press("Enter")
        page.get_by_role("button", name=LATCHED).wait_for(timeout=20_000)
        page.get_by_text(re.compile(r"Emergency stop \(pressed in the console\): .* foretouch release \d+")).wait_for()
        page.wait_for_timeout(800)
        page.get_by_text(re.compile(r"^foretouch release \d+$")).click()
        assert re.fullmatch(r"foretouch release \d+", str(page.evaluate("getSelection().toString()")))  # to be copied
        words = [sys.executable, "-m", "foretouch", "release"]
        output = subprocess.run(words, input="y\nrelease\n", capture_output=True, text=True, check=True).stdout
        assert output.endswith("the robot follows again, slowly at first\n")
        page.get_by_role("button", name=READY).wait_for(timeout=20_000)
        page.wait_for_timeout(500)
        page.get_by_role("button", name="Clutch").press("Enter")
        page.get_by_text("Clutch is pressed: let it go").wait_for(timeout=20_000)
        kill_tab(page)
        time.sleep(HOLD_TIME + 2.5)
        teleop.send_signal(signal.SIGINT)
    log = read_session(path)
    leader, follower = log.leader, log.follower
    stopped = np.flatnonzero(follower["status"] == Status.STOPPED)
    np.testing.assert_array_equal(np.diff(stopped), 1)  # once, and not to the end
    assert 300 < stopped.size < follower.size - stopped[0] - 1000
    assert follower["exact_force"][stopped[0]] > 1.0  # it pressed
    assert np.abs(follower["exact_force"][stopped[200:]]).max() < 1.0
    assert (follower["status"][stopped[-1] + 1 :] == Status.FOLLOWING).any()
    assert follower["exact_force"].max() < 15.0
    knows = np.isin(leader["telemetry_sequence"], follower["sequence"][stopped])
    assert knows.sum() > 200
    assert not leader["engaged"][knows].any()
    assert leader["rendered_force"][knows][150:].max() < 1e-3  # it falls as fast as a force may for a hand
    # The hand moved with the mouse, stayed where the tab let go of it, and moved with the script again; and the clutch,
    # which the tab had pressed after the release, was let go.
    moved = np.flatnonzero(np.abs(np.diff(leader["intended_position"])) > 1e-7)
    assert np.diff(leader["time_ns"][moved]).max() * 1e-9 > HOLD_TIME - 0.1
    engaged = leader["engaged"][np.flatnonzero(knows)[-1] :].astype(int)
    assert np.count_nonzero(np.diff(engaged) == 1) == 2
    assert engaged[-1] == 1


@pytest.mark.long
def test_a_scene_is_seen_and_pressed_in_three_dimensions(tmp_path: Path) -> None:
    """The mouse takes the handle's arrow and pushes it down; the camera's image changes, and the probe over it too."""
    pytest.importorskip("cv2")
    path = tmp_path / "scene.mcap"
    options = ("--scene", "hill", "--force-delay", "0.1", "--position-delay", "0.02")
    with teleop_page(path, *options, says=SPACE_INSTRUCTION) as (page, requests, _):
        page.get_by_text("Local stiffness at 2 mm [N/m]").wait_for()
        page.get_by_text("of 4 markers found").wait_for(timeout=20_000)
        image = page.locator(".foretouch-camera").locator("xpath=../following-sibling::div[1]//img")
        first = pixels_of(page, image)

        def pressing(curve: int) -> bool:
            force = plot_data(page)[curve]
            return bool(force[np.isfinite(force)][-1] > 0.5)

        with held_in_space(page, down_mm=45.0):
            wait_for(lambda: all(map(pressing, (1, 2, 4))), 60.0, page)  # true, predicted, rendered
            wait_for(lambda: changed(first, pixels_of(page, image)) > 0.005, 30.0, page)  # the robot came down
            pressed = pixels_of(page, image)
            page.keyboard.press("o")  # the mouse is busy
            wait_for(lambda: blue(pixels_of(page, image)) > 5 * blue(pressed) + 100, page=page)  # the probe is drawn
            assert page.get_by_label(DRAW_PROBE).is_checked()
            page.wait_for_timeout(1000)  # a rest that the script never has
        assert all(address.split("//")[1].startswith("127.0.0.1") for address in requests if "//" in address)
        open_tab(page, "Fixture")
        page.get_by_text("Images / touches used").wait_for()
    log = read_session(path)
    assert log.leader_space["depth"].max() > 0.002
    assert log.leader_space["force_z"].max() > 0.5
    assert log.follower["exact_force"].max() > 0.5
    # The hand rested where the mouse held it, which the script never does, and pressed there.
    resting = np.ptp(np.lib.stride_tricks.sliding_window_view(log.leader_space["hand_z"], 400), axis=1) < 1e-5
    assert resting.any()
    assert log.leader_space["depth"][:-399][resting].max() > 0.002


def pixels_of(page: Any, image: Any) -> np.ndarray:
    """What an image of the page shows, red, green and blue."""
    import cv2

    address = image.evaluate(
        "image => {const c = document.createElement('canvas'); c.width = 640; c.height = 480;"
        " c.getContext('2d').drawImage(image, 0, 0, 640, 480); return c.toDataURL('image/png')}"
    )
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(address.partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)
    return picture[..., ::-1].astype(int)


def changed(one: np.ndarray, other: np.ndarray) -> float:
    """Share of pixels that differ by more than noise."""
    return float((np.abs(one - other).max(axis=2) > 40).mean())


def blue(pixels: np.ndarray) -> int:
    """Pixels of the virtual probe's colour."""
    return int((np.abs(pixels - np.array(BLUE)).max(axis=2) < 45).sum())

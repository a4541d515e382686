"""Take the pictures of the documentation again, from a real session in a real browser.

Starts `foretouch teleop`, opens its console in Chromium, and writes to `docs/images`: `console.png`, the mouse
pressing; `console-model.png`, what was learnt; `console-recording.png`, a recording beside a second run under a longer
delay; `console-stopped.png`, after the emergency stop; and `console-unreached.png`, while the console hangs. A second
session, over the phantom, gives `console-scene.png`, the script palpating with the virtual probe drawn over the image,
and `console-scene-pressed.png`, the mouse pressing beside what is known of the fixture. A third, of 2,000 bytes a
second over the slowest of the measured networks, gives `console-thin.png`. Recordings of the three simulated arms that
press the phantom give `console-arms.png`.

Usage: `make screenshots`, or `.venv/bin/python docs/take_screenshots.py [PORT [line|scene|thin|arms]]`; all without the
last word.
"""

from __future__ import annotations

import io
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "console"))  # the mouse and the browser are the tests' own

from console_driver import choose, held_handle, held_in_space, open_page, open_tab  # noqa: E402
from visitors import Printed  # noqa: E402

from foretouch.console.gate.page import LOST  # noqa: E402
from foretouch.console.panels.panel import CHOOSE_RECORDING  # noqa: E402
from foretouch.console.panels.stop import ALERTS, LATCHED, READY, WHOLE_ARM  # noqa: E402
from foretouch.console.views.space import SPACE_INSTRUCTION  # noqa: E402
from foretouch.recordings import read_session  # noqa: E402

Hanging = Callable[[], None]
"""Lets the console hang."""

IMAGES = ROOT / "docs" / "images"
PRESSED, MODEL, RECORDING, STOPPED, UNREACHED = (
    IMAGES / f"console{name}.png" for name in ("", "-model", "-recording", "-stopped", "-unreached")
)
ARMS_PRESSING = IMAGES / "console-arms.png"
SCENE, SCENE_PRESSED = (IMAGES / f"{name}.png" for name in ("console-scene", "console-scene-pressed"))
THIN = IMAGES / "console-thin.png"
THIN_SESSION = ("--budget", "2000", "--network", "5g-rural", "--grip", "normal")
THIN_WATCHED = 60.0
"""So long that session goes on before its picture is taken [s]: it has stood still for some seconds by then."""
ARM_NAMES = {"fr3": "FR3", "ur5e": "UR5e", "so101": "SO-101"}
ARM_SESSION = 12.0
"""Length of the recording with each arm [s]: the script has pressed some times then."""
NARROW = 480
"""Width of a page that is too narrow for the legend [pixel]."""
NEAR, WHOLE = ({"x": 40, "y": top, "width": 400, "height": height} for top, height in ((84, 240), (12, 440)))
"""Parts of it with the scene and with the whole arm."""
BANNER = "[role=status]{visibility:hidden}"
"""Style without the banner over the scene, which says that this is a recording."""
HEAD = 36
"""Height of the line with an arm's name, above its pictures [pixel]."""
PALPATED = 24.0
"""So long the script palpates before the picture is taken [s]: the stiff inclusion is found then."""
DOWN_MM = 44.0
"""The handle in space is pushed down by this from where it stands."""
PRESS_MM = 9.0
WATCHED = 12.0
"""So long the script presses before the picture is taken [s]: the plot is full then."""
LONGER, MOMENT = "0.6", "9"
"""The delay back of the second run, and the moment of the recording that is shown [s]."""
QUIET = 30_000
"""So long a picture waits for the moment in which no warning lies over the scene [ms]."""
SETTLED = 1.5
"""So long after the emergency stop the last picture is taken [s]: the robot has unloaded."""


def main(port: int, which: str = "") -> None:
    """Take the pictures of a session along a line, of one in three dimensions, over a thin link, of arms, or of all."""
    if which in ("", "line"):
        _session(port, (), _take, (PRESSED, MODEL, RECORDING, STOPPED, UNREACHED))
    if which in ("", "scene"):
        _session(port, ("--scene", "phantom"), _take_scene, (SCENE, SCENE_PRESSED))
    if which in ("", "thin"):
        _session(port, THIN_SESSION, _take_thin, (THIN,))
    if which in ("", "arms"):
        with tempfile.TemporaryDirectory() as folder:
            _take_arms(port, Path(folder))


def _session(
    port: int, options: tuple[str, ...], take: Callable[[str, Hanging], None], images: tuple[Path, ...]
) -> None:
    """Run a session while its pictures are taken."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "foretouch",
            "teleop",
            "--duration",
            "180",
            "--port",
            str(port),
            "--recording",
            "pressed.mcap",
            *options,
        ]
        quiet = subprocess.DEVNULL
        session = subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=subprocess.PIPE, text=True)
        try:
            take(Printed(session).address(), lambda: _signal_console(session, "STOP"))
        finally:
            _signal_console(session, "CONT")
            session.terminate()
            session.wait(120)  # it writes its report
    for image in images:
        if take is _take:  # a scene's colours have a meaning: all of them stay
            _shrink(image)
        print(f"{image.relative_to(ROOT)}: {image.stat().st_size / 1000:.0f} kB")


def _signal_console(session: subprocess.Popen[str], signal: str) -> None:
    """Let the console's own process hang, or go on."""
    subprocess.run(["pkill", f"-{signal}", "-P", str(session.pid), "-f", "foretouch console"], check=False)


def _take(url: str, hang: Hanging) -> None:
    """Watch for a while, look at what was recorded, press while the robot is still behind; then stop it, and hang."""
    with open_page(url, 1280, 900) as (page, _):
        page.wait_for_timeout(1000 * WATCHED)
        open_tab(page, "Model")
        page.get_by_text("at rest").wait_for()
        _scroll(page, to_end=True)
        _picture(page, MODEL)
        _scroll(page, to_end=False)
        _look_at_recording(page)
        open_tab(page, "Network")
        with held_handle(page, PRESS_MM, seconds=1.0, steps=20):
            _picture(page, PRESSED)
            page.get_by_role("button", name=READY).press("Enter")
            page.get_by_role("button", name=LATCHED).wait_for()
            page.get_by_text("foretouch release").wait_for()
            page.wait_for_timeout(1000 * SETTLED)
            page.screenshot(path=STOPPED)
            hang()
            page.get_by_text(LOST).wait_for()
            page.wait_for_timeout(1000 * SETTLED)
            page.screenshot(path=UNREACHED)


def _take_scene(url: str, _: Hanging) -> None:
    """Watch the script palpate, then press with the mouse."""
    with open_page(url, 1440, 900, SPACE_INSTRUCTION) as (page, _):
        page.keyboard.press("o")
        page.wait_for_timeout(1000 * PALPATED)
        _picture(page, SCENE)
        open_tab(page, "Fixture")
        with held_in_space(page, DOWN_MM):
            _scroll(page, to_end=True)
            page.wait_for_timeout(1500)
            _picture(page, SCENE_PRESSED)


def _take_thin(url: str, _: Hanging) -> None:
    """Watch the script press over a network that stands still now and then."""
    with open_page(url, 1280, 900) as (page, _):
        open_tab(page, "Network")
        page.wait_for_timeout(1000 * THIN_WATCHED)
        _scroll(page, to_end=True)
        page.screenshot(path=THIN)


def _take_arms(port: int, folder: Path) -> None:
    """Record a session with each arm, open them in a console, and put their pictures side by side."""
    from PIL import Image, ImageDraw

    program = [sys.executable, "-m", "foretouch"]
    for robot in ARM_NAMES:
        options = ["--duration", str(ARM_SESSION), "--recording", f"{robot}.mcap", "--robot", robot]
        subprocess.run([*program, "simulate", "--scene", "phantom", *options], cwd=folder, check=True)
    console = [*program, "console", "--port", str(port), "--recordings", str(folder)]
    shown = subprocess.Popen(console, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        with open_page(Printed(shown).address(), NARROW, 1100, CHOOSE_RECORDING) as (page, _):
            page.add_style_tag(content=BANNER)
            columns = [_arm(page, folder, robot) for robot in ARM_NAMES]
    finally:
        shown.terminate()
        shown.wait(60)
    width, heights = NEAR["width"], (HEAD, NEAR["height"], WHOLE["height"])
    together = Image.new("RGB", (width * len(columns), sum(heights)), "white")
    for column, (name, parts) in enumerate(zip(ARM_NAMES.values(), columns, strict=True)):
        middle = (width * column + width // 2, HEAD // 2)
        ImageDraw.Draw(together).text(middle, name, fill="black", anchor="mm", font_size=20)
        for part, top in zip(parts, itertools.accumulate(heights), strict=False):
            together.paste(Image.open(io.BytesIO(part)), (width * column, top))
    together.save(ARMS_PRESSING, optimize=True)
    _shrink(ARMS_PRESSING)
    print(f"{ARMS_PRESSING.relative_to(ROOT)}: {ARMS_PRESSING.stat().st_size / 1000:.0f} kB")


def _pressing(recording: Path) -> float:
    """When the operator hears of the largest force in a recording [s]."""
    log = read_session(recording)
    told = log.follower[log.follower["time_ns"] < log.follower["time_ns"][0] + 1e9 * (ARM_SESSION - 1.0)]
    felt = 1e-9 * float(told["time_ns"][told["exact_force"].argmax()] - told["time_ns"][0])
    return felt + float(log.settings["force_delay"])


def _arm(page: Any, folder: Path, robot: str) -> tuple[bytes, bytes]:
    """The scene of a recording while the arm presses most, and the whole arm over it."""
    moment = _pressing(folder / f"{robot}.mcap")
    open_tab(page, "Recordings")
    choose(page, "Recording", f"{robot}.mcap")
    page.get_by_text(f"robot {robot}").wait_for()
    page.wait_for_timeout(3000)  # the bar has the length of this recording then
    field = page.locator("input[type=text]:visible").nth(0)
    while not page.get_by_text(f"{moment:.1f} of").count():
        field.fill(str(moment))
        field.press("Enter")
        page.wait_for_timeout(1000)
    page.wait_for_timeout(2000)  # first as one sees the scene, and then the whole arm
    near = page.screenshot(clip=NEAR)
    page.evaluate("document.activeElement.blur()")  # letters are text in a field
    page.keyboard.press(WHOLE_ARM[1])
    page.wait_for_timeout(2000)
    whole = page.screenshot(clip=WHOLE)
    page.keyboard.press(WHOLE_ARM[1])
    return near, whole


def _picture(page: Any, path: Path) -> None:
    """Take a picture while nothing urgent stands over the scene: a machine that is late holds the robot now and then.

    Raises:
        TimeoutError: A warning stayed, or came back in each picture.
    """
    for _ in range(5):
        page.locator(ALERTS).wait_for(state="detached", timeout=QUIET)
        picture = page.screenshot()
        if not page.locator(ALERTS).count():
            path.write_bytes(picture)
            return
    raise TimeoutError(f"{path.name}: a warning stood over every picture of the scene; this machine is late")


def _look_at_recording(page: Any) -> None:
    """End the recording, open it, run it again under a longer delay, and go to a moment of it."""
    page.keyboard.press("r")
    open_tab(page, "Session")
    page.get_by_text("Nothing is recorded.").wait_for()
    open_tab(page, "Recordings")
    choose(page, "Recording", "pressed.mcap")
    page.get_by_text("RECORDING, NOT LIVE").wait_for()
    numbers = page.locator("input[type=text]:visible")
    for field, text in ((numbers.nth(2), LONGER), (numbers.nth(0), MOMENT)):
        field.fill(text)
        field.press("Enter")
        page.wait_for_timeout(500)
    page.get_by_role("button", name="Run it again").click()
    page.get_by_text("Run again under").wait_for(timeout=120_000)
    page.get_by_text(f"{float(MOMENT):.1f} of").wait_for()
    page.wait_for_timeout(1000)
    _picture(page, RECORDING)
    page.get_by_role("button", name="Back to live").click()


def _scroll(page: Any, *, to_end: bool) -> None:
    """Scroll the panel to its end, or back."""
    page.evaluate(
        "down => document.querySelectorAll('.mantine-ScrollArea-viewport')"
        ".forEach(area => area.scrollTop = down ? area.scrollHeight : 0)",
        to_end,
    )
    page.wait_for_timeout(500)


def _shrink(path: Path) -> None:
    """Fewer colours, where Pillow is there to do it (Matplotlib brings it)."""
    from PIL import Image

    with Image.open(path) as image:
        small = image.convert("RGB").quantize(colors=256, method=Image.Quantize.MEDIANCUT)
    small.save(path, optimize=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8091, sys.argv[2] if len(sys.argv) > 2 else "")

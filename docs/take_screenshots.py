"""Take the pictures of the documentation again, from a real session in a real browser.

Starts `foretouch teleop`, opens its console in Chromium, takes the handle with the mouse, presses, and writes
`docs/images/console.png`; then presses the emergency stop for `docs/images/console-stopped.png`.

Usage: `make screenshots`, or `.venv/bin/python docs/take_screenshots.py [PORT]`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "console"))  # the mouse and the browser are the tests' own

from console_driver import held_handle, open_page  # noqa: E402

from foretouch.console.alarm import LATCHED, READY  # noqa: E402

IMAGES = ROOT / "docs" / "images"
PRESSED, STOPPED = IMAGES / "console.png", IMAGES / "console-stopped.png"
PRESS_MM = 9.0
WATCHED = 12.0
"""So long the script presses before the picture is taken [s]: the plot is full then."""


SETTLED = 1.5
"""So long after the emergency stop the second picture is taken [s]: the robot has unloaded."""


def main(port: int) -> None:
    """Take the pictures."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "foretouch", "teleop", "--duration", "60", "--port", str(port)]
        session = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
        try:
            _take(f"http://127.0.0.1:{port}")
        finally:
            session.terminate()
            session.wait(30)
    for image in (PRESSED, STOPPED):
        _shrink(image)
        print(f"{image.relative_to(ROOT)}: {image.stat().st_size / 1000:.0f} kB")


def _take(url: str) -> None:
    """Watch for a while, then press with the mouse and take a picture while the robot is still behind; then stop it."""
    _wait_for(url)
    with open_page(url, 1280, 800) as (page, _):
        page.wait_for_timeout(1000 * WATCHED)
        _close_notices(page)
        with held_handle(page, PRESS_MM, seconds=1.0, steps=20):
            page.screenshot(path=PRESSED)
            page.get_by_role("button", name=READY).press("Enter")
            page.get_by_role("button", name=LATCHED).wait_for()
            page.get_by_text("kill -USR2").wait_for()
            page.wait_for_timeout(1000 * SETTLED)
            page.screenshot(path=STOPPED)


def _close_notices(page: Any) -> None:
    """Close what the viewer says about rendering without a graphics card."""
    for button in page.locator(".mantine-Notification-closeButton").all():
        button.click()


def _wait_for(url: str) -> None:
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        try:
            urllib.request.urlopen(url, timeout=1.0).close()
            return
        except (urllib.error.URLError, OSError):
            time.sleep(0.2)
    raise SystemExit(f"the console did not come up at {url}")


def _shrink(path: Path) -> None:
    """Fewer colours, where Pillow is there to do it (Matplotlib brings it)."""
    from PIL import Image

    with Image.open(path) as image:
        small = image.convert("RGB").quantize(colors=256, method=Image.Quantize.MEDIANCUT)
    small.save(path, optimize=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8091)

"""The camera at the robot: its newest image, as late as the network is, and what it shows of the fixture."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from foretouch.console.fixture_view import footprint
from foretouch.console.overlay import can_draw, draw_over
from foretouch.console.space_heard import fixture_of
from foretouch.console.watched import Watched
from foretouch.console.window import Array
from foretouch.errors import install_command
from foretouch.messages import CameraImage, LeaderSpace
from foretouch.quantities.colours import VERMILLION, css

__all__ = ["DRAW_PROBE", "NO_IMAGE", "ImagePanel", "missing_image"]

DRAW_PROBE = "Probe over image"
WHAT_IS_DRAWN = "Draw the virtual probe (blue) and the fixture as rendered (green) over the delayed image"
NO_OPENCV = "OpenCV is not here: the probe cannot be drawn over images. "
NO_CAMERA = "There is no camera at the robot."
NOT_USED = ("contact", "none")
"""With these values of ``fusion`` no image is needed."""
NO_IMAGE = "No image has come yet."
CAMERA_DELAY = 0.05
"""From exposure to reading [s] until the session says its own."""
MARKERS = 4
"""Of the board."""
TITLE = "Camera at the robot, delayed"
_STYLE = (
    '<div class="foretouch-camera"><style>'
    "div:has(> .foretouch-camera) + div{position:fixed !important;z-index:40;bottom:12px;right:472px;"
    "width:clamp(200px, calc(100vw - 900px), 400px);background:#fff;border:1px solid #999;border-radius:6px;"
    "padding:2px 6px 6px 6px !important;margin:0 !important}"
    "@media (max-width:1100px){div:has(> .foretouch-camera) + div{bottom:92px}}"
    "@media (max-width:36em){div:has(> .foretouch-camera) + div{position:static !important;width:auto}}"
    "</style></div>"
)
"""The image comes next: it stands in the corner of the picture while the panel scrolls."""
BLANK = np.full((480, 640, 3), 96, np.uint8)


class ImagePanel:
    """The camera's image, hidden in sessions along a line.

    What it shows goes to the browser as it came, as a JPEG; only with the probe drawn over it is it read here.

    Args:
        gui: The viewer's user interface.
    """

    def __init__(self, gui: Any) -> None:
        self._style = gui.add_html(_STYLE, visible=False)
        self._image = gui.add_image(BLANK, label=TITLE, format="jpeg", visible=False)
        self._text = gui.add_html("", visible=False)
        self._over = gui.add_checkbox(DRAW_PROBE, False, hint=WHAT_IS_DRAWN, visible=False)
        self._can_draw: bool | None = None  # not asked yet: loading OpenCV takes its time
        self._shown = False
        self._sent: CameraImage | None = None
        self._drawn_over = False

    def show(self, shown: bool) -> None:
        """Show the panel, or hide it."""
        if shown != self._shown:
            if self._can_draw is None:
                self._can_draw = can_draw()
                self._over.disabled = not self._can_draw
            self._shown = shown
            self._style.visible = self._text.visible = self._over.visible = shown
            self._image.visible = shown and self._sent is not None

    def toggle_overlay(self) -> None:
        """Draw the virtual probe over the image, or no more."""
        if self._can_draw:
            self._over.value = not self._over.value

    def draw(self, watched: Watched, vertices: Array) -> None:
        """Draw the newest image that has come over the network.

        Args:
            watched: The session, or a recording.
            vertices: Of the touched surface in the fixture's frame [m], shape (n, 3).
        """
        image = watched.space.image(watched.heard_sequence, watched.setting("camera_delay", CAMERA_DELAY))
        leader = watched.space.leader
        self._write(watched, image)
        if self._image.visible != (image is not None):
            self._image.visible = image is not None
        if image is None or leader is None or not image.jpeg:
            return
        over = bool(self._over.value) and bool(self._can_draw)
        if image is self._sent and not over and not self._drawn_over:
            return
        jpeg = _over(image, leader, vertices) if over else image.jpeg
        self._sent, self._drawn_over = image, over
        if jpeg is not None:
            self._image._data = jpeg  # as it came: the viewer would read and write it once more

    def _write(self, watched: Watched, image: CameraImage | None) -> None:
        lines = []
        if image is None:
            lines.append(missing_image(watched.settings))
        else:
            lines.append(f"{_age(watched, image)}; {image.markers} of {MARKERS} markers found.")
            if image.reason:
                lines.append(f"No pose from it: {image.reason}.")
        if image is not None and not self._can_draw:
            lines.append(NO_OPENCV + install_command("vision"))
        wrong = image is None or bool(image.reason)
        colour = css(VERMILLION) if wrong else "#555"
        text = (
            f'<div style="padding:0 12px;color:{colour};line-height:1.35">{"<br>".join(map(html.escape, lines))}</div>'
        )
        if self._text.content != text:
            self._text.content = text


def missing_image(settings: Mapping[str, str]) -> str:
    """Why there is no image, and what to install, in a sentence.

    Args:
        settings: What all have said of the session.
    """
    fusion, why = settings.get("fusion", ""), settings.get("camera_missing", "")
    if why:
        return f"{why[:1].upper()}{why[1:].rstrip('.')}."
    if settings.get("camera") == "there is none" or fusion in NOT_USED:
        return f"{NO_CAMERA} Images are not used (--fusion {fusion})." if fusion in NOT_USED else NO_CAMERA
    return NO_IMAGE


def _over(image: CameraImage, leader: LeaderSpace, vertices: Array) -> bytes | None:
    probe = (leader.place_x, leader.place_y, leader.place_z)
    return draw_over(image.jpeg, image.camera, probe, fixture_of(leader), footprint(vertices))


def _age(watched: Watched, image: CameraImage) -> str:
    """How old the image is, in words: the ticks of the robot since then, and the network's delay."""
    there = (watched.heard_sequence - image.tick) * 1e-3
    back = watched.setting("force_delay", math.nan)
    age = there + (back if math.isfinite(back) else 0.0)
    return f"Shows the robot of {age:.1f} s ago"

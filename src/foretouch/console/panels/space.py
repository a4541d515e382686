"""A session in three dimensions: the camera's image, as late as the network is, and what is known of the fixture.

The virtual probe and the fixture can be drawn over the image: what the camera would see if there were no delay. Such
predictive displays for delayed teleoperation: Bejczy, Kim and Venema (1990), The phantom robot, IEEE International
Conference on Robotics and Automation, 546-551.
"""

from __future__ import annotations

import functools
import html
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.console.history import Array
from foretouch.console.plots import Curve, Row, TimePlot, by_person, inset, number, put, table
from foretouch.console.watched import Watched
from foretouch.errors import MissingExtraError, SettingError, install_command
from foretouch.messages import CameraImage, FixtureBelief, LeaderSpace, fixture_of
from foretouch.quantities import Pose
from foretouch.quantities.colours import BLUE, GREEN, INK, VERMILLION, Colour, css
from foretouch.quantities.pose import Vector
from foretouch.vision.camera import opencv

ROD = 0.03  # Length of the probe that is drawn [m]
TIP_RADIUS = 2.25e-3  # Of the ball of a point [m]
PARTS = 8  # Number of parts in which a side of the outline is drawn: a lens bends it
QUALITY = 80


def can_draw() -> bool:
    """Whether OpenCV, which reads and draws images, is there and starts: it may lack a library of its own."""
    try:
        opencv()
    except MissingExtraError:
        return False
    return True


def draw_over(
    jpeg: bytes, camera: Sequence[float], probe: Vector, pose: Sequence[float], corners: Array, radius: float = 0.0
) -> bytes | None:
    """A JPEG with the virtual probe [m] and the fixture's outline in it; None where it cannot be read.

    The probe is a sphere of a radius [m] about its position; 0 for a point. The camera is that of
    `foretouch.messages.CameraImage`; the pose is the rendered one, a position [m] and a rotation vector [rad], and the
    corners of the outline are in the fixture's frame [m], shape (n, 3).
    """
    from foretouch.session.spatial.camera import pixels

    cv2 = opencv()
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None or len(camera) != 15:
        return None
    part = np.arange(PARTS)[:, None] / PARTS
    sides = [a + part * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    outline = Pose.from_rotation_vector(pose[3:], pose[:3]).apply(np.concatenate(sides))
    try:
        seen = pixels(camera, outline)
    except SettingError:  # no such lens
        return None
    image = cv2.resize(image, (round(2 * camera[2]) + 1, round(2 * camera[3]) + 1))  # over a thin link it came small
    _draw_line(image, np.vstack([seen, seen[:1]]), GREEN, 2)
    if all(map(math.isfinite, probe)):
        rod = np.asarray(probe) + np.outer(np.linspace(0.0, ROD + radius, PARTS), (0.0, 0.0, 1.0))
        _draw_line(image, pixels(camera, rod), BLUE, 6)
        middle, right = tip = pixels(camera, np.array(probe) + np.outer((0.0, radius or TIP_RADIUS), (1.0, 0.0, 0.0)))
        if np.isfinite(tip).all():
            at, size = np.rint(middle).astype(int).tolist(), max(round(math.dist(middle, right)), 5)
            widths = (7, 3) if radius else (-1, -1)  # a ring hides nothing of a large sphere
            for wide, painted, more in zip(widths, ((255, 255, 255), BLUE[::-1]), (2, 0), strict=True):
                cv2.circle(image, at, size + (0 if radius else more), painted, wide, cv2.LINE_AA)
    written, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data) if written else None


def _draw_line(image: np.ndarray, points: Array, colour: Colour, width: int) -> None:
    """A line with a white rim, left out where it is not before the camera or far beside the image."""
    cv2, size = opencv(), max(image.shape)
    near = np.isfinite(points).all(axis=1) & (np.abs(points) < 4 * size).all(axis=1)
    for wider, painted in ((width + 3, (255, 255, 255)), (width, colour[::-1])):
        for begin in np.flatnonzero(near[:-1] & near[1:]):
            ends = np.rint(points[begin : begin + 2]).astype(int).tolist()
            cv2.line(image, *ends, painted, wider, cv2.LINE_AA)


DRAW_PROBE = "Probe over image"
WHAT_IS_DRAWN = "Draw the virtual probe (blue) and the fixture as rendered (green) over the delayed image"
NO_OPENCV = "OpenCV is not here: the probe cannot be drawn over images. "
NO_CAMERA = "There is no camera at the robot."
NOT_USED = ("contact", "none")  # With these values of ``fusion`` no image is needed
NO_IMAGE = "No image has come yet."
NO_IMAGE_LEFT = "No image has come yet: over a thin link they take what nothing else needs."
CAMERA_DELAY = 0.05  # Time from exposure to reading [s] until the session sends its value
MARKERS = 4  # Number of markers on the board
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
"""The image comes next: it is in the corner of the picture while the panel scrolls."""
BLANK = np.full((480, 640, 3), 96, np.uint8)


class ImagePanel:
    """The camera's image, hidden in sessions along a line.

    What it shows goes to the browser as it came, as a JPEG; only with the probe drawn over it is it read here.
    """

    def __init__(self, gui: Any) -> None:
        self._style = gui.add_html(_STYLE, visible=False)
        self._image = gui.add_image(BLANK, label=TITLE, format="jpeg", visible=False)
        self._text = gui.add_html("", visible=False)
        self._over = gui.add_checkbox(DRAW_PROBE, False, hint=WHAT_IS_DRAWN, visible=False)
        self._can_draw: bool | None = None  # not asked yet: loading OpenCV takes its time
        self._sent: CameraImage | None = None
        self._drawn_over = False

    def show(self, shown: bool) -> None:
        """Show the panel, or hide it."""
        if self._can_draw is None:
            self._can_draw = can_draw()
            self._over.disabled = not self._can_draw
        self._style.visible = self._text.visible = self._over.visible = shown
        self._image.visible = shown and self._sent is not None

    def toggle_overlay(self) -> None:
        """Draw the virtual probe over the image, or no more."""
        if self._can_draw:
            self._over.value = not self._over.value

    def draw(self, watched: Watched, vertices: Array) -> None:
        """Draw the newest image; vertices of what is touched are in the fixture's frame [m], shape (n, 3)."""
        image = watched.space.image(watched.telemetry_sequence, watched.setting("camera_delay", CAMERA_DELAY))
        leader = watched.leader_space
        self._write(watched, image)
        put(self._image, visible=image is not None)
        if image is None or not image.jpeg:
            return
        over = bool(self._over.value) and bool(self._can_draw)
        if image is self._sent and not over and not self._drawn_over:
            return
        probe = (leader.place_x, leader.place_y, leader.place_z)
        pose, corners = fixture_of(leader), footprint(vertices)
        jpeg: bytes | None = image.jpeg
        if over:
            jpeg = draw_over(image.jpeg, image.camera, probe, pose, corners, watched.probe_radius)
        self._sent, self._drawn_over = image, over
        if jpeg is not None:
            self._image._data = jpeg  # as it came: the viewer would read and write it once more

    def _write(self, watched: Watched, image: CameraImage | None) -> None:
        lines = [missing_image(watched.settings)]
        if image is not None:  # as old as the ticks of the robot since then, and the network's delay
            age = (watched.telemetry_sequence - image.tick) * 1e-3 + watched.setting("force_delay", 0.0)
            lines = [f"Shows the robot of {age:.1f} s ago; {image.markers} of {MARKERS} markers found."]
            if image.reason:
                lines.append(f"No pose from it: {image.reason}.")
            if not self._can_draw:
                lines.append(NO_OPENCV + install_command("vision"))
        colour = css(VERMILLION) if image is None or image.reason else "#555"
        put(self._text, content=inset("<br>".join(map(html.escape, lines)), f";color:{colour};line-height:1.35"))


def missing_image(settings: Mapping[str, str]) -> str:
    """The reason that there is no image, and what to install, in a sentence."""
    fusion, why = settings.get("fusion", ""), settings.get("camera_missing", "")
    if why:
        return f"{why[:1].upper()}{why[1:].rstrip('.')}."
    if settings.get("camera") == "there is none" or fusion in NOT_USED:
        return f"{NO_CAMERA} Images are not used (--fusion {fusion})." if fusion in NOT_USED else NO_CAMERA
    return NO_IMAGE if settings.get("budget", "0.0") == "0.0" else NO_IMAGE_LEFT


BOARD, MARKER = 0.060, 0.024
"""Sides of the board and of a marker as they are drawn [m]."""
MARGIN = 0.004  # Distance of the outline from what it encloses [m]


def footprint(vertices: np.ndarray) -> np.ndarray:
    """Corners of a rectangle about board and specimen, in the fixture's frame [m], shape (4, 3)."""
    left, near = np.minimum(vertices.min(axis=0)[:2], -0.5 * BOARD) - MARGIN
    right, far = np.maximum(vertices.max(axis=0)[:2], 0.5 * BOARD) + MARGIN
    return np.array([(left, near, 0.0), (right, near, 0.0), (right, far, 0.0), (left, far, 0.0)])


PLACE = Curve("Deviation of its position", BLUE, 2.0)
TURN = Curve("Deviation of its rotation", VERMILLION, 2.0, "dashed")
AGE = Curve("Since an image showed it", INK, 2.0)
AGED = 0.5  # An older pose is worth a sentence [s]
CAMERA_SILENT = 1.0
"""The tracker of the fixture speaks thirty times a second; it is gone when nothing has come for this time [s]."""
MOST_AGE = 60.0
SLIDERS = ("Hand to the right, x [mm]", "Hand away, y [mm]", "Hand up, z [mm]")
HALF_RANGE = 100.0  # [mm]
SMALLEST_MOVE = 0.3  # A slider follows the hand by steps of this [mm]


class SpacePanel:
    """Numbers and plots of the fixture; a slider says along which axis, 0 to 2, the hand is to be where [m]."""

    def __init__(self, gui: Any, on_move: Callable[[int, float], None]) -> None:
        self._on_move = on_move
        self._text = gui.add_html("")
        self._pose = TimePlot(gui, "Deviation of the pose [mm] and [degrees]", (PLACE, TURN), height=120)
        self._age = TimePlot(gui, "Since an image showed the fixture [s]", (AGE,), height=100)
        self._sliders = [
            gui.add_slider(label, -HALF_RANGE, HALF_RANGE, 0.5, 0.0, hint="Moves the hand; let go after 1 s")
            for label in SLIDERS
        ]
        for axis, slider in enumerate(self._sliders):
            slider.on_update(by_person(functools.partial(self._move, axis)))

    def draw(self, watched: Watched, seconds: float, now: float, hand: Vector | None) -> None:
        """Draw and write what is known over seconds before now [s], and the hand's requested position [m] if any."""
        trace = watched.space.pose_trace(seconds)
        self._pose.draw(trace.time, (trace.deviation * 1e3, np.degrees(trace.turn)))
        age = np.where(np.isfinite(trace.age), trace.age, math.nan)  # never seen is no age
        self._age.draw(trace.time, (age,), most=MOST_AGE)
        self._follow(hand)
        leader = watched.leader_space
        colour = css(VERMILLION) if leader.fixture_age > AGED else "#555"
        known = html.escape(pose_sentence(watched, now))
        sentence = f'<div style="color:{colour};line-height:1.35;padding-bottom:2px"><b>{known}</b></div>'
        put(
            self._text,
            content=inset(sentence + table(_rows(leader, watched.space.belief))),
        )

    def _follow(self, hand: Vector | None) -> None:
        """Put the sliders where the hand is, without telling anybody."""
        for axis, slider in enumerate(self._sliders):
            put(slider, disabled=hand is None)
            if hand is None or not math.isfinite(hand[axis]):
                continue
            value = min(max(round(2e3 * hand[axis]) / 2.0, -HALF_RANGE), HALF_RANGE)
            if abs(slider.value - value) > SMALLEST_MOVE:
                slider.value = value

    def _move(self, axis: int, event: Any) -> None:
        self._on_move(axis, float(event.target.value) * 1e-3)


def pose_sentence(watched: Watched, now: float) -> str:
    """Uncertainty of the fixture's pose, in a sentence."""
    leader, belief = watched.leader_space, watched.space.belief
    silence = watched.space.camera_silence(now)
    if watched.settings.get("fusion") == "none":
        return "The fixture is believed where it was expected: nothing is tracked (--fusion none)."
    if belief is not None and silence > CAMERA_SILENT:
        return f"The camera's side has been silent for {silence:.1f} s: the pose stays as it was."
    if belief is None:
        return "Nobody tracks the fixture yet: it is believed where it was expected."
    if watched.settings.get("camera") == "there is none":
        return f"No camera: {belief.reason}."
    if leader.fixture_age > AGED and math.isfinite(leader.fixture_age):
        return f"The board was last seen {leader.fixture_age:.1f} s before that pose was sent: it gets less certain."
    return f"{belief.reason[:1].upper()}{belief.reason[1:].rstrip('.')}."


def _rows(leader: LeaderSpace, belief: FixtureBelief | None) -> list[Row]:
    turn = leader.fixture_turn * 180.0 / math.pi
    force = math.hypot(leader.force_x, leader.force_y, leader.force_z)
    used = ("–", "–") if belief is None else (f"{belief.images} / {belief.contacts}", f"{belief.refused}")
    return [
        Row("Deviation of the fixture's position", number(leader.fixture_deviation * 1e3, "mm"), PLACE),
        Row("Deviation of its rotation", number(turn, "°"), TURN),
        Row(AGE.name, number(leader.fixture_age, "s", 1), AGE),
        Row("Images / touches used", used[0]),
        Row("Images and touches refused", used[1]),
        Row("Force on the hand, with friction", number(force, "N")),
        Row("Friction, Coulomb", number(leader.friction, "")),
        Row("Local stiffness here, rendered", number(leader.stiffness, "N/m", 0)),
    ]

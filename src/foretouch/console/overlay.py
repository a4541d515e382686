"""The virtual probe and the fixture drawn over the delayed image: what the camera would see if there were no delay.

Predictive displays for delayed teleoperation: Bejczy, Kim and Venema (1990), The phantom robot, IEEE International
Conference on Robotics and Automation, 546-551.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from foretouch.console.window import Array
from foretouch.errors import MissingExtraError, SettingError
from foretouch.quantities import Pose
from foretouch.quantities.colours import BLUE, GREEN, Colour
from foretouch.quantities.pose import Vector
from foretouch.vision.camera import opencv

__all__ = ["can_draw", "draw_over"]

ROD = 0.03
"""Length of the probe that is drawn [m]."""
TIP_RADIUS = 2.25e-3
PARTS = 8
"""A side of the outline is drawn in so many parts: a lens bends it."""
QUALITY = 80


def can_draw() -> bool:
    """Whether OpenCV, which reads and draws images, is there and starts: it may lack a library of its own."""
    try:
        opencv()
    except MissingExtraError:
        return False
    return True


def draw_over(
    jpeg: bytes, camera: Sequence[float], probe: Vector, pose: Sequence[float], corners: Array
) -> bytes | None:
    """An image with the virtual probe and the fixture's outline in it; None where it cannot be read.

    Args:
        jpeg: The image.
        camera: As `foretouch.messages.CameraImage.camera` has it.
        probe: Place of the virtual probe [m].
        pose: Of the fixture as it is rendered: a place [m] and a rotation vector [rad].
        corners: Of the outline in the fixture's frame [m], shape (n, 3).
    """
    cv2 = opencv()

    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if image is None or len(camera) != 15:
        return None
    outline = Pose.from_rotation_vector(pose[3:], pose[:3]).apply(_divided(corners))
    try:
        seen = _pixels(camera, outline)
    except SettingError:  # no such lens
        return None
    _draw_line(image, np.vstack([seen, seen[:1]]), GREEN, 2)
    if all(map(math.isfinite, probe)):
        rod = np.asarray(probe) + np.outer(np.linspace(0.0, ROD, PARTS), (0.0, 0.0, 1.0))
        _draw_line(image, _pixels(camera, rod), BLUE, 6)
        _draw_tip(image, camera, probe)
    written, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(data) if written else None


def _draw_tip(image: np.ndarray, camera: Sequence[float], probe: Vector) -> None:
    """A disc as large as the tip would be."""
    cv2 = opencv()

    x, y, z = probe
    middle, right = _pixels(camera, np.array([(x, y, z), (x + TIP_RADIUS, y, z)]))
    if np.isfinite(middle).all() and np.isfinite(right).all():
        radius = max(round(math.dist(middle, right)), 5)
        at = (round(float(middle[0])), round(float(middle[1])))
        cv2.circle(image, at, radius + 2, (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(image, at, radius, BLUE[::-1], -1, cv2.LINE_AA)


def _draw_line(image: np.ndarray, points: Array, colour: Colour, width: int) -> None:
    """A line with a white rim, left out where it is not before the camera or far beside the image."""
    cv2 = opencv()

    height, across = image.shape[:2]
    near = np.isfinite(points).all(axis=1) & (np.abs(points) < 4 * max(height, across)).all(axis=1)
    for wider, painted in ((width + 3, (255, 255, 255)), (width, colour[::-1])):
        for a, b, here, there in zip(points[:-1], points[1:], near[:-1], near[1:], strict=True):
            if here and there:
                ends = [tuple(round(float(value)) for value in point) for point in (a, b)]
                cv2.line(image, ends[0], ends[1], painted, wider, cv2.LINE_AA)


def _divided(corners: Array) -> Array:
    """Points along the sides of a closed outline."""
    share = np.arange(PARTS)[:, None] / PARTS
    sides = [a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.concatenate(sides)


def _pixels(camera: Sequence[float], points: Array) -> Array:
    from foretouch.session.spatial.camera import pixels

    return pixels(camera, points)

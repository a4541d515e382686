"""An image without distortion as a lens shows it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.vision.board import opencv
from foretouch.vision.camera import CameraModel

__all__ = ["Lens"]


class Lens:
    """Draws an ideal camera's image as the true camera has it: lens distortion, focal lengths and principal point.

    Each pixel of the true image takes its colour from where its ray meets the ideal one, between four pixels. What the
    ideal camera does not see is black. Render with `field_of_view`, so that it sees all.

    Args:
        camera: The true camera.

    Raises:
        SettingError: A corner of the image has no ray, or the view is wider than 160 degrees.
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, camera: CameraModel) -> None:
        self._cv2 = opencv()
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = camera.unproject(np.column_stack([columns.ravel(), rows.ravel()]))
        if not np.isfinite(rays).all():
            raise SettingError("camera", camera, "the distortion cannot be undone over the whole image")
        wide, high = np.abs(rays[:, 0]).max(), np.abs(rays[:, 1]).max()
        self.field_of_view = 2.0 * math.atan(max(high, wide * camera.height / camera.width) * 1.01)
        if self.field_of_view > math.radians(160.0):
            raise SettingError("camera", camera, "the view must be within 160 degrees")
        source = CameraModel.from_field_of_view(camera.width, camera.height, self.field_of_view)
        places = source.project(rays).reshape(camera.height, camera.width, 2).astype(np.float32)
        self._columns, self._rows = np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])

    def distort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The true camera's image, (height, width) or (height, width, 3).

        Args:
            image: Of an ideal camera of the same size with `field_of_view` from edge to edge [rad].

        Raises:
            SettingError: Another size than the camera's.
        """
        if image.shape[:2] != self._rows.shape:
            raise SettingError("image", image.shape, f"must be {self._rows.shape} pixels as the camera's")
        drawn = self._cv2.remap(image, self._columns, self._rows, self._cv2.INTER_LINEAR)
        return np.asarray(drawn, np.uint8)

"""A pinhole camera with lens distortion and its file, images as its lens shows them, and the board that it looks for.

The board has four markers and is fixed to what is touched.
"""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError, MissingExtraError, SettingError, UnknownNameError
from foretouch.files import read_toml
from foretouch.quantities.pose import Array

DICTIONARIES = {"4x4": "DICT_4X4_50", "5x5": "DICT_5X5_50", "6x6": "DICT_6X6_50"}
"""Families of markers by their number of squares, with OpenCV's name for them."""


def opencv() -> Any:
    """The module cv2; it is imported in this room alone, when it is first used.

    It works on one thread: loops want the other cores.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError("opencv-python-headless", "vision") from error
    cv2.setNumThreads(1)
    return cv2


@dataclass(frozen=True, slots=True)
class Board:
    """Two by two ArUco markers. Origin in the middle, x to the right, y up, z towards the viewer.

    Args:
        marker_length: Side of the black square of a marker [m], 1 mm to 1 m.
        gap: White between two markers [m], and around them; at least an eighth of a marker.
        dictionary: One of `DICTIONARIES`.

    Raises:
        SettingError: A length out of its range.
        UnknownNameError: No such dictionary.
    """

    marker_length: float = 0.024
    gap: float = 0.004
    dictionary: str = "4x4"

    def __post_init__(self) -> None:
        if not 1e-3 <= self.marker_length <= 1.0:
            raise SettingError("marker_length", self.marker_length, "must be 0.001 to 1 m")
        if not 0.125 * self.marker_length <= self.gap <= self.marker_length:
            raise SettingError("gap", self.gap, "must be an eighth of the marker's length to its whole length")
        if self.dictionary not in DICTIONARIES:
            raise UnknownNameError("dictionary", self.dictionary, DICTIONARIES)

    @property
    def size(self) -> float:
        """Side of the board with its white rim [m]: two markers and three gaps."""
        return 2.0 * self.marker_length + 3.0 * self.gap

    def corners(self) -> Array:
        """Corners in the board's frame [m], (4, 4, 3).

        Markers 0 to 3 by rows from the upper left; of each the upper left, upper right, lower right and lower left
        corner, as OpenCV numbers them. OpenCV's own board has y down; here it points up, so that z comes out of
        the paper.
        """
        near, far = 0.5 * self.gap, 0.5 * self.gap + self.marker_length
        first = np.array([(-far, far, 0.0), (near, far, 0.0), (-far, -near, 0.0), (near, -near, 0.0)])
        others = self.marker_length * np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, -1.0, 0.0), (0.0, -1.0, 0.0)])
        corners: Array = first[:, None] + others
        return corners


def markers_of(board: Board) -> Any:
    """OpenCV's dictionary of a board's markers."""
    aruco = opencv().aruco
    return aruco.getPredefinedDictionary(getattr(aruco, DICTIONARIES[board.dictionary]))


def make_board_image(board: Board, pixels: int = 840) -> NDArray[np.uint8]:
    """The board as it is printed, (n, n) grey, black 0 and white 255; n is near ``pixels``.

    Each corner lies within half a pixel of where `Board.corners` has it, and exactly there where gap and marker are a
    whole number of pixels, as with the defaults: a marker that is 0.06 % too long moves the pose by 0.2 mm in 0.35 m.

    Args:
        board: The board.
        pixels: Side of the image, 128 to 8192.

    Raises:
        SettingError: A size out of its range.
        MissingExtraError: OpenCV is not installed.
    """
    if not 128 <= pixels <= 8192:
        raise SettingError("pixels", pixels, "must be 128 to 8192")
    scale = pixels / board.size
    length = round(board.marker_length * scale)
    image = np.full((pixels, pixels), 255, np.uint8)
    for number, corners in enumerate(board.corners()):
        left, top = corners[0, 0], corners[0, 1]
        column, row = round((left + 0.5 * board.size) * scale), round((0.5 * board.size - top) * scale)
        image[row : row + length, column : column + length] = markers_of(board).generateImageMarker(number, length)
    return image


LARGEST_IMAGE = 8192
STEPS = 50  # Largest number of Newton steps: four or five are needed; what has not settled after these never will


@dataclass(frozen=True, slots=True)
class CameraModel:
    r"""Brown and Conrady's camera: x to the right, y down, z along the view, pixel centres at whole numbers.

    With a = X/Z, b = Y/Z and r^2 = a^2 + b^2:

    .. math::
        a' = a\,(1 + k_1 r^2 + k_2 r^4 + k_3 r^6) + 2 p_1 a b + p_2 (r^2 + 2 a^2) \\
        b' = b\,(1 + k_1 r^2 + k_2 r^4 + k_3 r^6) + p_1 (r^2 + 2 b^2) + 2 p_2 a b \\
        u = f_x a' + c_x, \quad v = f_y b' + c_y

    Args:
        width: Width of the image [pixel].
        height: Height of the image [pixel].
        focal_x: f_x [pixel].
        focal_y: f_y [pixel].
        centre_x: c_x [pixel]; None is the middle, (width - 1) / 2.
        centre_y: c_y [pixel]; None is the middle, (height - 1) / 2.
        k1: Radial distortion, of r^2 [-].
        k2: Of r^4 [-].
        p1: Tangential distortion [-].
        p2: Tangential distortion [-].
        k3: Of r^6 [-].

    Raises:
        SettingError: A number out of its range.

    References:
        Brown (1966), Decentering distortion of lenses; the order k1, k2, p1, p2, k3 is OpenCV's.
    """

    width: int
    height: int
    focal_x: float
    focal_y: float
    centre_x: float | None = None
    centre_y: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or not 16 <= value <= LARGEST_IMAGE:
                raise SettingError(name, value, f"must be a whole number from 16 to {LARGEST_IMAGE}")
        for name, size in (("centre_x", self.width), ("centre_y", self.height)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, (size - 1) / 2.0)
            self._require(0.0, size - 1.0, "must lie in the image", name)
        self._require(1.0, 1e6, "must be 1 to 1e6 pixels", "focal_x", "focal_y")
        self._require(-10.0, 10.0, "must be -10 to 10", "k1", "k2", "p1", "p2", "k3")

    def _require(self, least: float, most: float, rule: str, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
                raise SettingError(name, value, rule)

    @classmethod
    def from_field_of_view(cls, width: int, height: int, vertical: float) -> CameraModel:
        """An ideal camera with square pixels: f = height / (2 tan(vertical / 2)); sizes in pixel, the angle in rad.

        Raises:
            SettingError: A number out of its range.
        """
        if not 0.01 <= vertical <= 3.0:
            raise SettingError("vertical", vertical, "must be 0.01 to 3 rad")
        focal = 0.5 * height / math.tan(0.5 * vertical)
        return cls(width, height, focal, focal)

    @property
    def matrix(self) -> Array:
        """K, (3, 3) [pixel]."""
        return np.array([[self.focal_x, 0.0, self.centre_x], [0.0, self.focal_y, self.centre_y], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """k1, k2, p1, p2, k3, (5,)."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3])

    @property
    def ideal(self) -> CameraModel:
        """The camera without distortion."""
        return CameraModel(self.width, self.height, self.focal_x, self.focal_y, self.centre_x, self.centre_y)

    @property
    def _focal(self) -> Array:
        return np.array([self.focal_x, self.focal_y])

    @property
    def _centre(self) -> Array:
        return np.array([self.centre_x, self.centre_y], float)

    def project(self, points: ArrayLike) -> Array:
        """Pixels (n, 2) of points (n, 3) [m] in the camera's frame; NaN for what is not before the camera."""
        points = np.asarray(points, float).reshape(-1, 3)
        depth = np.where(points[:, 2] > 0.0, points[:, 2], np.nan)
        return self._distort(points[:, :2] / depth[:, None]) * self._focal + self._centre

    def unproject(self, pixels: ArrayLike) -> Array:
        """Rays (n, 3) with z = 1 through pixels (n, 2); NaN where the distortion cannot be undone."""
        target = (np.asarray(pixels, float).reshape(-1, 2) - self._centre) / self._focal
        plane = target.copy()
        with np.errstate(all="ignore"):
            for _ in range(STEPS):
                plane = plane - self._newton(plane, target)
            missed = np.abs(self._distort(plane) - target).max(axis=1)
        plane[~(missed < 1e-9)] = np.nan
        return np.column_stack([plane, np.ones(len(plane))])

    def _distort(self, plane: Array) -> Array:
        a, b = plane.T
        square = a * a + b * b
        radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3))
        across = a * radial + 2.0 * self.p1 * a * b + self.p2 * (square + 2.0 * a * a)
        down = b * radial + self.p1 * (square + 2.0 * b * b) + 2.0 * self.p2 * a * b
        return np.column_stack([across, down])

    def _newton(self, plane: Array, target: Array) -> Array:
        """One step of Newton's method on two equations with a symmetric derivative, in closed form."""
        a, b = plane.T
        square = a * a + b * b
        radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3))
        slope = 2.0 * (self.k1 + square * (2.0 * self.k2 + 3.0 * square * self.k3))
        aa = radial + a * a * slope + 2.0 * self.p1 * b + 6.0 * self.p2 * a
        bb = radial + b * b * slope + 6.0 * self.p1 * b + 2.0 * self.p2 * a
        ab = a * b * slope + 2.0 * self.p1 * a + 2.0 * self.p2 * b
        first, second = (self._distort(plane) - target).T
        determinant = aa * bb - ab * ab
        step: Array = np.column_stack([bb * first - ab * second, aa * second - ab * first]) / determinant[:, None]
        return step

    def write(self, path: Path) -> None:
        """Write it as TOML, whole or not at all."""
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            beside.write_text("".join(f"{name} = {value!r}\n" for name, value in asdict(self).items()))
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)

    @classmethod
    def read(cls, path: Path) -> CameraModel:
        """Read what `write` wrote.

        Raises:
            InputError: No such file, no TOML, a key that is missing or unknown, or a number out of its range.
        """
        values = read_toml(path, dict, "camera")
        unknown = sorted(set(values) - set(cls.__dataclass_fields__))
        missing = sorted({"width", "height", "focal_x", "focal_y"} - set(values))
        if unknown or missing:
            what = f"unknown key {unknown[0]!r}" if unknown else f"{missing[0]!r} is missing"
            raise InputError(f"{path}: {what}: the keys are {', '.join(cls.__dataclass_fields__)}")
        try:
            return cls(**values)
        except SettingError as error:
            raise InputError(f"{path}: {error}") from error


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
        positions = source.project(rays).reshape(camera.height, camera.width, 2).astype(np.float32)
        self._columns, self._rows = np.ascontiguousarray(positions[..., 0]), np.ascontiguousarray(positions[..., 1])

    def distort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The true camera's image, (h, w) or (h, w, 3), of an ideal camera's of the same size with `field_of_view`.

        Raises:
            SettingError: Another size than the camera's.
        """
        if image.shape[:2] != self._rows.shape:
            raise SettingError("image", image.shape, f"must be {self._rows.shape} pixels as the camera's")
        return np.asarray(self._cv2.remap(image, self._columns, self._rows, self._cv2.INTER_LINEAR), np.uint8)

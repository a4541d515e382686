"""The board of four markers that is fixed to what is touched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import MissingExtraError, SettingError, UnknownNameError

__all__ = ["DICTIONARIES", "Board", "make_board_image"]

Array = NDArray[np.float64]

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
        corners = []
        for left, top in ((-far, far), (near, far), (-far, -near), (near, -near)):
            right, bottom = left + self.marker_length, top - self.marker_length
            corners.append([(left, top, 0.0), (right, top, 0.0), (right, bottom, 0.0), (left, bottom, 0.0)])
        return np.array(corners)


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
    cv2 = opencv()
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARIES[board.dictionary]))
    scale = pixels / board.size
    length = round(board.marker_length * scale)
    image = np.full((pixels, pixels), 255, np.uint8)
    for number, corners in enumerate(board.corners()):
        left, top = corners[0, 0], corners[0, 1]
        column, row = round((left + 0.5 * board.size) * scale), round((0.5 * board.size - top) * scale)
        marker = cv2.aruco.generateImageMarker(dictionary, number, length)
        image[row : row + length, column : column + length] = marker
    return image

"""The pose of the board in one image, and its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.quantities.pose import Array, Pose, cross_matrix
from foretouch.vision.camera import Board, CameraModel, markers_of, opencv


@dataclass(frozen=True, slots=True)
class BoardPose:
    """What one image says of the board.

    Attributes:
        pose: Pose of the board in the camera's frame; None where there is none.
        covariance: Covariance of the pose's error on the right, m and rad, (6, 6); None without a pose.
        markers: Number of markers found.
        residual: Root mean square of what is left between corners and projection [pixel]; NaN without a pose.
        reason: Why there is no pose, a sentence; empty where there is one.
    """

    pose: Pose | None
    covariance: Array | None
    markers: int
    residual: float
    reason: str


def projection_derivative(camera: CameraModel, pose: Pose, points: Array) -> Array:
    r"""Derivative of ideal pixels by a twist on the right of the pose, (2n, 6), rows u, v, u, v ...

    .. math:: \frac{\partial (u, v)}{\partial \xi} =
        \begin{pmatrix} f_x/Z & 0 & -f_x X/Z^2 \\ 0 & f_y/Z & -f_y Y/Z^2 \end{pmatrix} R\,(I \;\; -[q])

    Args:
        camera: Camera, whose distortion is left out.
        pose: Pose of the body in the camera's frame.
        points: q, in the body's frame [m], (n, 3).
    """
    rows = []
    for q, (x, y, z) in zip(points, pose.apply(points), strict=True):
        column = [-camera.focal_x * x / z**2, -camera.focal_y * y / z**2]
        by_point = np.array([[camera.focal_x / z, 0.0, column[0]], [0.0, camera.focal_y / z, column[1]]])
        rows.append(by_point @ pose.rotation @ np.hstack([np.eye(3), -cross_matrix(q)]))
    return np.vstack(rows)


@dataclass(slots=True)
class BoardDetector:
    r"""Markers, corners below a pixel, and the pose that fits them.

    The corners are undistorted first and fitted by SQPnP, then Levenberg and Marquardt. With the derivative J of the
    projection, the covariance is :math:`\sigma^2 (J^T J)^{-1}`, sigma the larger of the stated corner noise and of what
    this image's residual shows.

    Args:
        board: Board to be found.
        camera: Camera that sees it.
        corner_noise: Standard deviation of a corner [pixel], measured.
        corner_shift: Shift of detected corners towards the middle of their marker along each diagonal [pixel],
            measured; it is taken out before the fit.
        least_markers: Smallest number of markers for a pose, 1 to 4.
        largest_residual: Largest residual of a pose [pixel].
        ambiguity: The mirrored pose must leave this many times the residual, or there is none.

    Raises:
        SettingError: A number out of its range.
        MissingExtraError: OpenCV is not installed.

    References:
        Terzakis & Lourakis (2020), A consistently fast and globally optimal solution to the PnP problem;
        Garrido-Jurado et al. (2014); Collins & Bartoli (2014) for the mirrored pose of a plane.
    """

    board: Board
    camera: CameraModel
    corner_noise: float = 0.15
    corner_shift: float = 0.17
    least_markers: int = 2
    largest_residual: float = 1.0
    ambiguity: float = 1.5
    _detector: Any = field(init=False, default=None)

    def __post_init__(self) -> None:
        if not 1 <= self.least_markers <= 4:
            raise SettingError("least_markers", self.least_markers, "must be 1 to 4")
        for name in ("corner_noise", "largest_residual", "ambiguity"):
            if not 1e-3 <= getattr(self, name) <= 100.0:
                raise SettingError(name, getattr(self, name), "must be 0.001 to 100")
        if not abs(self.corner_shift) <= 2.0:
            raise SettingError("corner_shift", self.corner_shift, "must be at most 2 pixels")
        cv2 = opencv()
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._detector = cv2.aruco.ArucoDetector(markers_of(self.board), parameters)

    def find(self, image: NDArray[np.uint8]) -> tuple[Array, Array]:
        """Marker numbers (m,) and their corners (m, 4, 2) [pixel] in (h, w) grey or (h, w, 3) RGB, the board's alone.

        Raises:
            SettingError: Another size than the camera's, or no bytes.
        """
        if image.dtype != np.uint8 or image.shape[:2] != (self.camera.height, self.camera.width):
            rule = f"must be bytes, {self.camera.height} x {self.camera.width} as the camera's"
            raise SettingError("image", f"{image.dtype} {image.shape}", rule)
        cv2 = opencv()
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        corners, numbers, _ = self._detector.detectMarkers(grey)
        if numbers is None:
            return np.zeros(0, int), np.zeros((0, 4, 2))
        numbers = numbers.ravel()
        once = [i for i, number in enumerate(numbers) if number < 4 and (numbers == number).sum() == 1]
        return numbers[once], np.array([corners[i].reshape(4, 2) for i in once], float).reshape(-1, 4, 2)

    def locate(self, image: NDArray[np.uint8]) -> BoardPose:
        """The board's pose in an image, (h, w) grey or (h, w, 3) RGB, or a sentence why there is none.

        Raises:
            SettingError: Another size than the camera's, or no bytes.
        """
        numbers, corners = self.find(image)
        if len(numbers) < self.least_markers:
            return _refused(len(numbers), f"{len(numbers)} of 4 markers are seen, {self.least_markers} are needed")
        return self.fit(numbers, corners)

    def fit(self, numbers: Array, corners: Array) -> BoardPose:
        """The pose that fits the markers of these numbers, (m,), and corners [pixel], (m, 4, 2)."""
        points = self.board.corners()[np.asarray(numbers, int)].reshape(-1, 3)
        ideal = self.camera.ideal
        away = corners - corners.mean(axis=1, keepdims=True)  # from the middle of their marker
        length = np.linalg.norm(away, axis=2, keepdims=True)
        moved = corners + self.corner_shift * away / np.maximum(length, 1e-9)
        pixels = ideal.project(self.camera.unproject(moved.reshape(-1, 2)))
        if not np.isfinite(pixels).all():
            return _refused(len(numbers), "corners lie where the lens cannot be undone")
        cv2 = opencv()
        good, turn, shift = cv2.solvePnP(points, pixels, ideal.matrix, None, flags=cv2.SOLVEPNP_SQPNP)
        if not good:
            return _refused(len(numbers), "no pose fits the corners")
        turn, shift = cv2.solvePnPRefineLM(points, pixels, ideal.matrix, None, turn, shift)
        pose = Pose.from_rotation_vector(turn.ravel(), shift.ravel())
        return self._judge(pose, points, pixels, len(numbers))

    def _residual(self, pose: Pose, points: Array, pixels: Array) -> float:
        missed = self.camera.ideal.project(pose.apply(points)) - pixels
        return float(np.sqrt(np.mean(missed**2)))

    def _judge(self, pose: Pose, points: Array, pixels: Array, markers: int) -> BoardPose:
        residual = self._residual(pose, points, pixels)
        if not residual <= self.largest_residual:  # NaN too: a point behind the camera
            missed = f"the corners miss the pose by {residual:.2f} pixels"
            return _refused(markers, f"{missed}, at most {self.largest_residual:g} are allowed", residual)
        if pose.rotation[:, 2] @ pose.translation >= 0.0:
            return _refused(markers, "the pose shows the back of the board", residual)
        mirrored = self._mirrored(points, pixels, pose)
        if mirrored < self.ambiguity * max(residual, self.corner_noise):
            reason = f"a mirrored pose fits as well: {mirrored:.2f} against {residual:.2f} pixels"
            return _refused(markers, reason, residual)
        derivative = projection_derivative(self.camera.ideal, pose, points)
        noise = max(self.corner_noise, residual * np.sqrt(pixels.size / max(1, pixels.size - 6)))
        covariance = noise**2 * np.linalg.inv(derivative.T @ derivative)
        return BoardPose(pose, 0.5 * (covariance + covariance.T), markers, residual, "")

    def _mirrored(self, points: Array, pixels: Array, pose: Pose) -> float:
        """Residual of the other pose that a plane may have [pixel]; infinite where there is no other."""
        cv2 = opencv()
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            points, pixels, self.camera.ideal.matrix, None, flags=cv2.SOLVEPNP_IPPE
        )
        flat = ((turn.ravel(), shift.ravel()) for turn, shift in zip(turns, shifts, strict=True))
        poses = (Pose.from_rotation_vector(*each) for each in flat)
        others = [other for other in poses if pose.distance(other)[1] > np.radians(3.0)]
        return min(filter(np.isfinite, (self._residual(other, points, pixels) for other in others)), default=math.inf)


def _refused(markers: int, reason: str, residual: float = math.nan) -> BoardPose:
    return BoardPose(None, None, markers, residual, reason)

"""The simulated camera at the follower: images of fixture, board and probe, in a process of its own in real time."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from foretouch.messages import VERSION, CameraImage, encode
from foretouch.messages.states import LARGEST_JPEG
from foretouch.quantities import Pose
from foretouch.quantities.pose import Vector
from foretouch.robot import CameraScene
from foretouch.session.spatial.scenes import Scene
from foretouch.vision import Board, BoardDetector, CameraModel, FaultyCamera, ImageFault, Lens, make_board_image
from foretouch.vision.camera import opencv

CAMERA = CameraModel(640, 480, 610.0, 610.0, k1=-0.15, k2=0.03, p1=5e-4, p2=-5e-4)
"""Intrinsics and distortion, as a calibration would give them."""

IMAGE_PERIOD = 1.0 / 30.0  # [s]

SMALL_PERIOD = 1.0  # Time between two images for a thin link [s]
PLENTY = 4000.0  # Budget from which on these are half as wide as the camera's, and not a quarter [bytes/s]
QUALITY = 30  # Of their JPEG, 1 to 100
LARGEST_SMALL = 4096  # Bytes of one at most: of a packet's content


def _looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Pose:
    """The pose of a camera that looks from a place to another: x to the right, y down, z along the view."""
    view = np.subtract(at, eye)
    view = view / np.linalg.norm(view)
    right = np.cross(view, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return Pose(np.column_stack([right, np.cross(view, right), view]), np.array(eye))


CAMERA_POSE = _looking((-0.035, -0.21, 0.205), (-0.035, 0.0, 0.0))
"""Of the camera in the world: it sees board and specimen from 44 degrees above the plane, for a board that is seen
straight from above has no certain tilt."""


VIEW = (float(CAMERA_POSE.rotation[0, 2]), float(CAMERA_POSE.rotation[1, 2]), float(CAMERA_POSE.rotation[2, 2]))
"""Direction in which it looks."""


class SimulatedCamera:
    """Draws, degrades and reads images: a camera, and the program beside it.

    Args:
        scene: Scene on the fixture.
        faults: Faults of the images.
        seed: Seed of their noise, not negative.

    Raises:
        MissingExtraError: MuJoCo or OpenCV is not installed.
        MissingGraphicsError: Nothing here draws without a display.
    """

    def __init__(self, scene: Scene, faults: Sequence[ImageFault] = (), *, seed: int = 0) -> None:
        board = Board()
        self._lens = Lens(CAMERA)
        self._scene = CameraScene(
            make_board_image(board),
            board.size,
            CAMERA_POSE,
            vertical=self._lens.field_of_view,
            specimen=scene.surface.outline(),
            probe_radius=scene.surface.radius,
        )
        self._camera = FaultyCamera(faults=tuple(faults), seed=seed)
        self._detector = BoardDetector(board, CAMERA)
        pose = (*CAMERA_POSE.translation.tolist(), *CAMERA_POSE.rotation_vector().tolist())
        self._numbers = (*CAMERA.matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), *CAMERA.distortion.tolist(), *pose)
        self._sequence = 0

    def take(
        self, fixture: Sequence[float], probe: Vector, tick: int, time: float, now_ns: int, run: int = 0
    ) -> CameraImage:
        """One image, and the pose in it.

        Args:
            fixture: True pose of the fixture: a position [m] and a rotation vector [rad].
            probe: Position of the probe [m].
            tick: Tick of the follower whose moment it shows.
            time: Time since the start of the session, by which faults come and go [s].
            now_ns: This side's clock [ns].
            run: Epoch of the follower's process.
        """
        self._sequence += 1
        true = Pose.from_rotation_vector(fixture[3:], fixture[:3])
        before = self._camera.jpeg
        image = self._camera.take(self._lens.distort(self._scene.render(true, probe)), time)
        jpeg = self._camera.jpeg if len(self._camera.jpeg) <= LARGEST_JPEG else b""
        numbers: tuple[float, ...] = ()
        spread: tuple[float, ...] = ()
        markers = 0
        if image is None:
            jpeg, reason = b"", "the stream has dropped the image"
        elif before and self._camera.jpeg == before:  # no two images of a sensor with noise are alike
            reason = "the stream stands still: the same image again"
        else:
            result = self._detector.locate(image)
            markers, reason = result.markers, result.reason
            if result.pose is not None and result.covariance is not None:
                pose, reason = CAMERA_POSE @ result.pose, ""
                numbers = (*pose.translation.tolist(), *pose.rotation_vector().tolist())
                spread = tuple(result.covariance.ravel().tolist())
        return CameraImage(
            VERSION, self._sequence, now_ns, tick, jpeg, numbers, spread, markers, reason, self._numbers, run
        )

    def close(self) -> None:
        """Give back the resources of the graphics library."""
        self._scene.close()


def small_image(image: CameraImage, budget: float) -> bytes:
    """An image as it crosses a thin link of so many bytes a second: small, grey and without a pose.

    Returns:
        Bytes of a `CameraImage`; none where the stream dropped it, or where it is too large all the same.
    """
    cv2 = opencv()
    how = cv2.IMREAD_REDUCED_GRAYSCALE_2 if budget >= PLENTY else cv2.IMREAD_REDUCED_GRAYSCALE_4
    grey = cv2.imdecode(np.frombuffer(image.jpeg, np.uint8), how) if image.jpeg else None
    if grey is None:
        return b""
    _, jpeg = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1])
    small = encode(msgspec.structs.replace(image, jpeg=jpeg.tobytes(), pose=(), covariance=()))
    return small if len(small) <= LARGEST_SMALL else b""


def pixels(camera: Sequence[float], points: np.ndarray) -> np.ndarray:
    """Positions in an image (n, 2) [pixel] of points (n, 3) [m], for a `CameraImage.camera`; NaN behind it."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = camera[:9]
    width, height = round(2 * cx) + 1, round(2 * cy) + 1
    model = CameraModel(width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3)
    pose = Pose.from_rotation_vector(camera[12:15], camera[9:12])
    return model.project(pose.inverse().apply(np.reshape(points, (-1, 3))))

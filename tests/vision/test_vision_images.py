"""Images that are really drawn and really looked at; skipped where no graphics library is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from foretouch.quantities import Pose
from foretouch.robot import TIP_RADIUS, CameraScene, MissingGraphicsError, graphics_library
from foretouch.vision import Board, BoardDetector, CameraModel, FaultyCamera, ImageFault, make_board_image

pytest.importorskip("cv2")
BOARD = Board()
CAMERA = CameraModel.from_field_of_view(640, 480, 0.75)
LOOK = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.35]))
TILTED = Pose.from_rotation_vector([0.3, 0.25, 0.2], [0.01, -0.01, 0.0])
PROBE = (0.12, 0.1, 0.1)


@pytest.fixture(scope="module")
def scene() -> Iterator[CameraScene]:
    pytest.importorskip("mujoco")
    try:
        scene = CameraScene(make_board_image(BOARD), BOARD.size, LOOK)
    except MissingGraphicsError as error:
        pytest.skip(str(error))
    yield scene
    scene.close()


def test_the_pose_of_rendered_boards(scene: CameraScene) -> None:
    random, detector, distances, angles = np.random.default_rng(1), BoardDetector(BOARD, CAMERA), [], []
    for _ in range(13):
        axis = random.normal(size=2)  # seen flatter than ten degrees, a board and its mirror image are too alike
        tilt = np.radians(random.uniform(10.0, 40.0)) * np.array([*axis / np.linalg.norm(axis), 0.0])
        fixture = Pose.from_rotation_vector(tilt, [*random.uniform(-0.02, 0.02, 2), random.uniform(-0.05, 0.1)])
        seen = detector.locate(FaultyCamera(quality=None).take(scene.render(fixture, PROBE), 0.0))
        assert seen.pose is not None, seen.reason
        distance, angle = (LOOK.inverse() @ fixture).distance(seen.pose)
        distances.append(distance)
        angles.append(angle)
    assert np.median(distances) < 0.8e-3
    assert np.degrees(np.median(angles)) < 0.3


def test_the_fixture_is_where_the_camera_model_has_it(scene: CameraScene) -> None:
    numbers, corners = BoardDetector(BOARD, CAMERA).find(scene.render(TILTED, PROBE))
    assert sorted(numbers) == [0, 1, 2, 3]
    points = (LOOK.inverse() @ TILTED).apply(BOARD.corners()[numbers].reshape(-1, 3))
    assert np.abs(CAMERA.project(points).reshape(-1, 4, 2) - corners).max() < 1.0


@pytest.mark.parametrize("radius", [0.0, 0.002, 0.01])
def test_a_sphere_is_seen_about_the_probe_s_position_and_a_point_above_it(scene: CameraScene, radius: float) -> None:
    """From beside it the lower edge of a ball is as far below its centre as the line of sight that touches it."""
    away, height = 0.2, 0.05
    beside = Pose(np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)]), np.array([0.0, -away, height]))
    seen = CameraScene(make_board_image(BOARD), BOARD.size, beside, probe_radius=radius)
    image = seen.render(Pose(np.eye(3), np.array([0.0, 0.0, -0.1])), (0.0, 0.0, height)).astype(int)
    seen.close()
    rows, columns = np.nonzero((image[..., 0] > 100) & (image[..., 1] < 90))
    ball, centre = (radius, 0.0) if radius else (TIP_RADIUS, TIP_RADIUS)
    angle = np.arctan2(-centre, away) + np.arcsin(ball / np.hypot(centre, away))
    assert rows.max() - 0.5 * 479 == pytest.approx(CAMERA.matrix[1, 1] * np.tan(angle), abs=1.5)
    width = 2.0 * CAMERA.matrix[0, 0] * np.tan(np.arcsin(ball / away))
    assert np.ptp(columns) == pytest.approx(width, abs=2.5)


def test_a_hand_before_the_lens_gives_a_sentence_and_no_pose(scene: CameraScene) -> None:
    detector = BoardDetector(BOARD, CAMERA)
    for kind in ("hand", "glare"):
        camera = FaultyCamera(faults=(ImageFault(kind, size=1.5),))
        seen = detector.locate(camera.take(scene.render(TILTED, PROBE), 0.0))
        assert seen.pose is None
        assert seen.reason == "0 of 4 markers are seen, 2 are needed"


def test_a_stream_freezes_drops_and_repeats_with_its_seed(scene: CameraScene) -> None:
    image = scene.render(TILTED, PROBE)
    faults = (ImageFault("frozen", 1.0, 2.0), ImageFault("dropped", 3.0, 4.0))
    one, other = FaultyCamera(faults=faults, seed=3), FaultyCamera(faults=faults, seed=3)
    first = one.take(image, 0.0)
    assert first is not None
    assert np.array_equal(first, other.take(image, 0.0))
    frozen = one.take(scene.render(Pose.identity(), PROBE), 1.5)
    assert np.array_equal(first, frozen)
    assert one.take(image, 3.5) is None
    assert not np.array_equal(first, one.take(image, 4.0))


@pytest.mark.long
def test_the_covariance_is_that_of_many_draws() -> None:
    random, detector = np.random.default_rng(8), BoardDetector(BOARD, CAMERA, corner_noise=0.15, corner_shift=0.0)
    true = LOOK.inverse() @ TILTED
    pixels, errors = CAMERA.project(true.apply(BOARD.corners().reshape(-1, 3))).reshape(4, 4, 2), []
    for _ in range(200):
        seen = detector.fit(np.arange(4), pixels + random.normal(0.0, 0.15, pixels.shape))
        assert seen.pose is not None
        errors.append((true.inverse() @ seen.pose).log())
    exact = detector.fit(np.arange(4), pixels)
    assert exact.pose is not None
    assert exact.pose.distance(true)[0] < 1e-6
    whiten = np.linalg.inv(np.linalg.cholesky(exact.covariance))
    assert np.trace(whiten @ np.cov(np.transpose(errors)) @ whiten.T) / 6.0 == pytest.approx(1.0, abs=0.15)


def test_bad_corners_and_the_back_of_a_board_are_refused() -> None:
    detector = BoardDetector(BOARD, CAMERA)
    true = LOOK.inverse() @ TILTED
    pixels = CAMERA.project(true.apply(BOARD.corners().reshape(-1, 3))).reshape(4, 4, 2)
    bent = pixels.copy()
    bent[0, 0] += 20.0
    assert "miss the pose" in detector.fit(np.arange(4), bent).reason
    mirrored = pixels * np.array([-1.0, 1.0]) + np.array([639.0, 0.0])
    assert detector.fit(np.arange(4), mirrored).pose is None


def test_without_graphics_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    with pytest.raises(MissingGraphicsError, match="apt-get install libegl1") as caught:
        graphics_library()
    assert "\n" not in str(caught.value)

"""Measure how well images and contacts find the fixture: the table of `docs/rooms/vision.md`.

Usage: `.venv/bin/python docs/measure_vision.py [POSES]`; 200 poses, of which the page has its figures, take less than a
minute. Fewer are printed and not written.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from measured_blocks import fill

from foretouch.quantities import Pose
from foretouch.robot import CameraScene
from foretouch.vision import (
    Board,
    BoardDetector,
    CameraModel,
    ContactSeen,
    FaultyCamera,
    Fixture,
    FixtureFilter,
    ImageSeen,
    Lens,
    make_board_image,
)

PAGE = Path(__file__).parent / "rooms" / "vision.md"
POSES = 200
BOARD = Board()
CAMERA = CameraModel(640, 480, 610.0, 610.0, k1=-0.15, k2=0.03, p1=5e-4, p2=-5e-4)
LOOK = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.35]))
PROBE = (0.12, 0.1, 0.1)


def tilted(random: np.random.Generator) -> Pose:
    """A fixture 0.25 to 0.40 m from the camera, tilted by 10 to 40 degrees and turned by up to 30."""
    axis = random.normal(size=2)
    tilt = np.radians(random.uniform(10.0, 40.0)) * np.array([*axis / np.linalg.norm(axis), 0.0])
    turn = Pose.from_rotation_vector([0.0, 0.0, random.uniform(-0.5, 0.5)], np.zeros(3))
    return Pose.from_rotation_vector(tilt, [*random.uniform(-0.02, 0.02, 2), random.uniform(-0.05, 0.1)]) @ turn


def row(name: str, errors: list[np.ndarray], scores: list[float], missed: int) -> str:
    """One row: errors are twists on the right of the true pose."""
    distance = 1e3 * np.linalg.norm([error[:3] for error in errors], axis=1)
    angle = np.degrees(np.linalg.norm([error[3:] for error in errors], axis=1))
    middle = f"{np.median(distance):.2f} / {np.percentile(distance, 95):.2f}"
    turned = f"{np.median(angle):.2f} / {np.percentile(angle, 95):.2f}"
    return f"| {name} | {missed} | {middle} | {turned} | {np.mean(scores):.1f} |"


def images(scene: CameraScene, lens: Lens, poses: int, shift: float, quality: int | None) -> str:
    """Single images of random poses."""
    random, errors, scores = np.random.default_rng(1), [], []
    detector, camera = BoardDetector(BOARD, CAMERA, corner_shift=shift), FaultyCamera(quality=quality)
    for _ in range(poses):
        fixture = tilted(random)
        seen = detector.locate(camera.take(lens.distort(scene.render(fixture, PROBE)), 0.0))
        if seen.pose is not None:
            error = (seen.pose.inverse() @ LOOK.inverse() @ fixture).log()
            errors.append(error)
            scores.append(error @ np.linalg.solve(seen.covariance, error))
    return row(f"one image, shift {shift:g} pixel, JPEG {quality or 'off'}", errors, scores, poses - len(errors))


def fused(scene: CameraScene, lens: Lens, poses: int, contacts: int) -> str:
    """One second of images of a displaced fixture, exposed 0.1 s before they come, and some contacts."""
    random, errors, scores, missed = np.random.default_rng(2), [], [], 0
    detector, camera = BoardDetector(BOARD, CAMERA), FaultyCamera()
    for _ in range(poses):
        fixture = tilted(random)
        axis = random.normal(size=(2, 3))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        offset = np.concatenate([axis[0] * random.uniform(0, 0.02), axis[1] * np.radians(random.uniform(0, 10))])
        known, image = FixtureFilter(Fixture(), fixture @ Pose.exp(offset)), lens.distort(scene.render(fixture, PROBE))
        for tick in range(30):
            seen = detector.locate(camera.take(image, 0.0))
            if seen.pose is not None:
                known.update(ImageSeen(tick / 30.0, LOOK @ seen.pose, seen.covariance))
            else:
                missed += 1
        for tick in range(contacts):
            point = fixture.apply((*random.uniform(-0.05, 0.05, 2), random.normal(0.0, 2e-4)))
            known.update(ContactSeen(1.0 + 0.1 * tick, tuple(point), 2e-4))
        state = known.state(1.5)
        error = (state.pose.inverse() @ fixture).log()
        errors.append(error)
        scores.append(error @ np.linalg.solve(state.pose_covariance, error))
    return row(f"30 images and {contacts} contacts", errors, scores, missed)


def main() -> None:
    """Print the table and fill the page."""
    poses = int(sys.argv[1]) if len(sys.argv) > 1 else POSES
    lens = Lens(CAMERA)
    scene = CameraScene(make_board_image(BOARD), BOARD.size, LOOK, vertical=lens.field_of_view)
    head = "| what | images without a pose | mm, median / 95 % | degrees, median / 95 % | mean NEES of 6 |"
    lines = [head, "|---|---|---|---|---|"]
    for shift, quality in ((0.0, None), (0.17, None), (0.17, 80), (0.17, 40)):
        lines.append(images(scene, lens, poses, shift, quality))
    for contacts in (0, 3, 5):
        lines.append(fused(scene, lens, max(10, poses // 5), contacts))
    scene.close()
    text = "\n".join(lines) + "\n"
    print(text)
    if poses == POSES:
        fill(PAGE, {"vision": text})


if __name__ == "__main__":
    main()

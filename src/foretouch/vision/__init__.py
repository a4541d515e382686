"""The camera at the follower: where the fixture is, from images of its board, and from touches."""

from foretouch.vision.board_pose import BoardDetector, BoardPose, projection_derivative
from foretouch.vision.camera import DICTIONARIES, Board, CameraModel, Lens, make_board_image
from foretouch.vision.fusion import FixtureFilter, FixtureState, FusionSettings, Verdict
from foretouch.vision.image_faults import IMAGE_FAULTS, FaultyCamera, ImageFault
from foretouch.vision.seen import ContactSeen, Fixture, ImageSeen, SlideSeen, TouchedSurface

__all__ = [
    "DICTIONARIES",
    "IMAGE_FAULTS",
    "Board",
    "BoardDetector",
    "BoardPose",
    "CameraModel",
    "ContactSeen",
    "FaultyCamera",
    "Fixture",
    "FixtureFilter",
    "FixtureState",
    "FusionSettings",
    "ImageFault",
    "ImageSeen",
    "Lens",
    "SlideSeen",
    "TouchedSurface",
    "Verdict",
    "make_board_image",
    "projection_derivative",
]

"""Sessions in three dimensions: the steps along a line, with geometry about them, a tracker and a camera."""

from foretouch.session.spatial.camera import SimulatedCamera
from foretouch.session.spatial.making import (
    make_camera,
    make_moved_spatial_robot,
    make_spatial_operator,
    make_spatial_robot,
)
from foretouch.session.spatial.scenes import Inclusion, Scene, make_scene
from foretouch.settings import SCENES

__all__ = [
    "SCENES",
    "Inclusion",
    "Scene",
    "SimulatedCamera",
    "make_camera",
    "make_moved_spatial_robot",
    "make_scene",
    "make_spatial_operator",
    "make_spatial_robot",
]

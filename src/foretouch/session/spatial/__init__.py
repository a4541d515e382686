"""Sessions in three dimensions: the steps along a line, with geometry about them, a tracker and a camera."""

from foretouch.session.spatial.camera import CAMERA_CHANNELS, SimulatedCamera, run_camera
from foretouch.session.spatial.making import make_camera, make_spatial_operator, make_spatial_robot
from foretouch.session.spatial.scenes import SCENES, Inclusion, Scene, make_scene

__all__ = [
    "CAMERA_CHANNELS",
    "SCENES",
    "Inclusion",
    "Scene",
    "SimulatedCamera",
    "make_camera",
    "make_scene",
    "make_spatial_operator",
    "make_spatial_robot",
    "run_camera",
]

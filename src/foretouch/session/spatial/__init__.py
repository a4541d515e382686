"""What a session in three dimensions has of its own: hand and probe in space, scenes, tracker and camera."""

from foretouch.session.spatial.camera import SimulatedCamera
from foretouch.session.spatial.making import make_camera, make_spatial_operator, make_spatial_robot
from foretouch.session.spatial.scenes import Inclusion, Scene, make_scene, make_specimen
from foretouch.settings import SCENES

__all__ = [
    "SCENES",
    "Inclusion",
    "Scene",
    "SimulatedCamera",
    "make_camera",
    "make_scene",
    "make_spatial_operator",
    "make_spatial_robot",
    "make_specimen",
]

"""The follower robot and the materials it presses."""

from foretouch.robot.arm_scene import REMOTE_CENTRE_HEIGHT, ROD_LENGTH, ROD_RADIUS, TIP_RADIUS
from foretouch.robot.materials import (
    DEFAULT_MATERIAL,
    FOAM_DATASETS,
    MATERIALS,
    FoamFit,
    Material,
    fit_foam,
    foam_fit_json,
    make_material,
)
from foretouch.robot.rcm_arm import RcmArm
from foretouch.robot.registry import make_robot
from foretouch.robot.robot import Robot, RobotSample, RobotSpecification

__all__ = [
    "DEFAULT_MATERIAL",
    "FOAM_DATASETS",
    "MATERIALS",
    "REMOTE_CENTRE_HEIGHT",
    "ROD_LENGTH",
    "ROD_RADIUS",
    "TIP_RADIUS",
    "FoamFit",
    "Material",
    "RcmArm",
    "Robot",
    "RobotSample",
    "RobotSpecification",
    "fit_foam",
    "foam_fit_json",
    "make_material",
    "make_robot",
]

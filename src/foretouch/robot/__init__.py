"""The follower robot and the materials it presses."""

from foretouch.robot.arms import ArmAlongLine, ArmDescription, ArmPicture, ArticulatedArm, Capsule, read_arm
from foretouch.robot.camera_scene import MESA_PACKAGES, CameraScene, MissingGraphicsError, graphics_library
from foretouch.robot.engine import REMOTE_CENTRE_HEIGHT, ROD_LENGTH, ROD_RADIUS, TIP_RADIUS, Tip
from foretouch.robot.gantry_arm import GantryArm, TouchedWorld
from foretouch.robot.materials import (
    DEFAULT_MATERIAL,
    FOAM_DATASETS,
    MATERIALS,
    FoamFit,
    Material,
    fit_foam,
    foam_fit_json,
    make_material,
    material_names,
)
from foretouch.robot.rcm_arm import RcmArm, make_robot
from foretouch.robot.robot import (
    AnyRobot,
    MovedRobot,
    MovedSpatialRobot,
    Robot,
    RobotSample,
    RobotSpecification,
    SpatialRobot,
    SpatialSample,
    WrappedRobot,
    WrappedSpatialRobot,
)
from foretouch.robot.sensor_faults import SENSOR_FAULTS, FaultySensor, FaultySpatialSensor, SensorFault

__all__ = [
    "DEFAULT_MATERIAL",
    "FOAM_DATASETS",
    "MATERIALS",
    "MESA_PACKAGES",
    "REMOTE_CENTRE_HEIGHT",
    "ROD_LENGTH",
    "ROD_RADIUS",
    "SENSOR_FAULTS",
    "TIP_RADIUS",
    "AnyRobot",
    "ArmAlongLine",
    "ArmDescription",
    "ArmPicture",
    "ArticulatedArm",
    "CameraScene",
    "Capsule",
    "FaultySensor",
    "FaultySpatialSensor",
    "FoamFit",
    "GantryArm",
    "Material",
    "MissingGraphicsError",
    "MovedRobot",
    "MovedSpatialRobot",
    "RcmArm",
    "Robot",
    "RobotSample",
    "RobotSpecification",
    "SensorFault",
    "SpatialRobot",
    "SpatialSample",
    "Tip",
    "TouchedWorld",
    "WrappedRobot",
    "WrappedSpatialRobot",
    "fit_foam",
    "foam_fit_json",
    "graphics_library",
    "make_material",
    "make_robot",
    "material_names",
    "read_arm",
]

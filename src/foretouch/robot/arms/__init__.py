"""Simulated arms that people have: a description file each, the control of its kind, and how it knows the force."""

from __future__ import annotations

from foretouch.robot.arms.along_line import ArmAlongLine
from foretouch.robot.arms.arm import ArticulatedArm
from foretouch.robot.arms.description import ArmDescription, ArmPicture, Capsule
from foretouch.robot.arms.meshes import ARM_MESHES, LinkMesh, fetch_arm_meshes, read_arm_meshes
from foretouch.robot.arms.obstacle import Obstacle
from foretouch.robot.arms.reading import read_arm

__all__ = [
    "ARM_MESHES",
    "ArmAlongLine",
    "ArmDescription",
    "ArmPicture",
    "ArticulatedArm",
    "Capsule",
    "LinkMesh",
    "Obstacle",
    "fetch_arm_meshes",
    "read_arm",
    "read_arm_meshes",
]

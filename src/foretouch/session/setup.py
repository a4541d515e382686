"""The machines of a session: robot, operator and camera, made for a line or for a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from foretouch.devices import UNKNOWN_REACH, Reach
from foretouch.errors import SettingError
from foretouch.robot import (
    ArmAlongLine,
    ArticulatedArm,
    GantryArm,
    Material,
    RcmArm,
    make_material,
    make_robot,
    material_names,
)
from foretouch.session import spatial
from foretouch.session.operators import (
    foreign_robot,
    make_operator,
    mounted_robot,
    pressed_material,
    reach_of,
    robot_inside,
)
from foretouch.session.settings import SessionSettings, shadow_settings
from foretouch.session.steps.sensing import calibrated_arm
from foretouch.session.workspace import LINE, SPACE, framed_device, inverse
from foretouch.settings import SIMULATED, is_simulated

Say = Callable[[str], None]


class LineSetup:
    """The machines along a line. What is raised is raised by what makes them."""

    def __init__(self, settings: SessionSettings) -> None:
        self._settings = settings

    def robot(self) -> Any:
        """See `make_session_robot`."""
        settings = self._settings
        if not is_simulated(settings.robot):
            robot = foreign_robot(settings)
            return robot, reach_of(robot, settings)
        arm: RcmArm | ArmAlongLine
        if settings.robot == SIMULATED:
            arm = make_robot(settings.material, seed=settings.seed)
        else:
            arm = ArmAlongLine(calibrated_arm(settings), make_material(settings.material), seed=settings.seed)
        return mounted_robot(settings, arm), arm.material

    def operator(self, reach: Any, say: Say) -> Any:
        """Who moves the leader over what is so far away, as `make_operator`."""
        return make_operator(self._settings, surface=reach.surface, press_depth=reach.press_depth, say=say)

    def texts(self, robot: Any, reach: Any) -> dict[str, str]:
        """Texts of the log on the material, where the robot presses one of its own, which no setting can name.

        Raises:
            SettingError: It presses another material than the settings name.
        """
        settings, material = self._settings, pressed_material(robot)
        if not is_simulated(settings.robot) or material is None or material.name == settings.material:
            return reach_texts(reach)
        if material.name in material_names():
            rule = f"the robot presses {material.name}; make it with make_robot(settings.material), or leave it out"
            raise SettingError("material", settings.material, rule)
        return {"material": material.name} | reach_texts(reach)

    def camera(self, robot: Any, say: Say) -> spatial.SimulatedCamera | None:
        """The camera beside the robot of a simulated session; None for none."""
        return None

    def seen(self) -> spatial.Scene:
        """The scene that a simulated camera sees; a SettingError along a line."""
        raise SettingError("scene", self._settings.scene, "is needed for a camera: plane, hill, phantom, or a mesh")


class SpaceSetup(LineSetup):
    """The machines in a scene, in three dimensions."""

    def __init__(self, settings: SessionSettings) -> None:
        super().__init__(settings)
        self._scene = spatial.make_specimen(settings)

    def robot(self) -> Any:
        """See `make_spatial_robot`; how far the material is, the scene says."""
        return spatial.make_spatial_robot(self._settings, self._scene), UNKNOWN_REACH

    def operator(self, reach: Any, say: Say) -> Any:
        """See `make_spatial_operator`."""
        return spatial.make_spatial_operator(self._settings, self._scene, self._scene.nominal, say)

    def texts(self, robot: Any, reach: Any) -> dict[str, str]:
        """Texts of the log on a robot that is not the simulated one."""
        inner, _ = robot_inside(robot)
        return {} if isinstance(inner, GantryArm | ArticulatedArm) else {"robot": type(inner).__name__}

    def camera(self, robot: Any, say: Say) -> spatial.SimulatedCamera | None:
        """See `make_camera`; it needs a robot that says where its fixture is."""
        if self._settings.fusion not in ("full", "image"):
            return None
        if robot.read().fixture:
            return spatial.make_camera(self._settings, self._scene, say=say)
        say("camera: the robot does not say where its fixture is; the session goes on without it")
        return None

    def seen(self) -> spatial.Scene:
        """See `LineSetup.seen`."""
        return self._scene


SETUPS = {LINE: LineSetup, SPACE: SpaceSetup}


def setup_of(settings: SessionSettings) -> LineSetup:
    """What makes the machines of these settings; a scene that cannot be made is refused."""
    return SETUPS[settings.workspace](settings)


def make_session_robot(settings: SessionSettings) -> Any:
    """The robot of the settings, and how far what it presses is, as far as anybody knows; in a scene that says it.

    The simulated arm counts as the settings' follower frame says because it is built to, so that its own line of
    positions, in which the material is given, is the session's. Another package's counts as it does by itself, and the
    session translates it; its specification rules. Where it has an attribute ``material`` that is a
    `foretouch.robot.Material`, the operators know where to press; else they do not, and the surface is found by
    touching.

    Raises:
        UnknownNameError: No such robot or material.
        PluginError: Another package's robot, which cannot be made.
        SettingError: One that does not exchange once in a sample period of the session.
    """
    return setup_of(settings).robot()


def make_moved_robot(settings: SessionSettings, *, say: Say) -> Any:
    """The robot of a session that only watches. A simulated one is moved by the settings' operator, a real one by hand.

    Args:
        settings: Of the session.
        say: Told in one line when the measured motion is not to be had and the script is used instead.
    """
    settings = shadow_settings(settings)
    setup = setup_of(settings)
    robot, reach = setup.robot()
    if not robot.specification.simulated:
        return robot, reach
    mover = framed_device(setup.operator(reach, say), inverse(settings.follower_frame))

    def position_at(time: float) -> Any:
        settings.workspace.show(robot, mover)
        return mover.read(round(time * 1e9))

    return settings.workspace.moved(robot, position_at), reach


def reach_texts(reach: Material | Reach) -> dict[str, str]:
    """Where a material is in the session's frame and how deep it is pressed, as far as anybody knows."""
    lengths = {"surface": reach.surface, "press_depth": reach.press_depth}
    return {name: str(length) for name, length in lengths.items() if math.isfinite(length)}

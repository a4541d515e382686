"""The machines of a session: robot, operator and camera, made for a line or for a scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from foretouch.devices import UNKNOWN_REACH
from foretouch.errors import SettingError
from foretouch.robot import material_names
from foretouch.session.operators import make_operator, own_robot, pressed_material
from foretouch.session.robots import make_moved_robot, make_session_robot, reach_texts
from foretouch.session.settings import SessionSettings
from foretouch.session.spatial import (
    Scene,
    SimulatedCamera,
    make_camera,
    make_moved_spatial_robot,
    make_scene,
    make_spatial_operator,
    make_spatial_robot,
)
from foretouch.session.workspace import LINE, SPACE
from foretouch.settings import SIMULATED

Say = Callable[[str], None]


class LineSetup:
    """The machines along a line. What is raised is raised by what makes them.

    Attributes:
        where: Where the material is, to be said after its name.
    """

    where = ""

    def __init__(self, settings: SessionSettings) -> None:
        self._settings = settings

    def robot(self) -> Any:
        """A robot and the reach of what it presses, as `make_session_robot`."""
        return make_session_robot(self._settings)

    def moved_robot(self, say: Say) -> Any:
        """The same of a robot that is moved from elsewhere, as `make_moved_robot`."""
        return make_moved_robot(self._settings, say=say)

    def operator(self, reach: Any, say: Say) -> Any:
        """Who moves the leader over what is so far away, as `make_operator`."""
        return make_operator(self._settings, surface=reach.surface, press_depth=reach.press_depth, say=say)

    def texts(self, robot: Any, reach: Any) -> dict[str, str]:
        """Texts of the log on the material, where the robot presses one of its own, which no setting can name.

        Raises:
            SettingError: It presses another material than the settings name.
        """
        settings, material = self._settings, pressed_material(robot)
        if settings.robot != SIMULATED or material is None or material.name == settings.material:
            return reach_texts(reach)
        if material.name in material_names():
            rule = f"the robot presses {material.name}; make it with make_robot(settings.material), or leave it out"
            raise SettingError("material", settings.material, rule)
        return {"material": material.name} | reach_texts(reach)

    def camera(self, robot: Any, say: Say) -> SimulatedCamera | None:
        """The camera beside the robot of a simulated session; None for none."""
        return None

    def seen(self) -> Scene:
        """The scene that a camera sees; a SettingError along a line."""
        raise SettingError("scene", self._settings.scene, "is needed for a camera: plane, hill, phantom, or a mesh")


class SpaceSetup(LineSetup):
    """The machines in a scene, in three dimensions."""

    def __init__(self, settings: SessionSettings) -> None:
        super().__init__(settings)
        self._scene, self.where = make_scene(settings.scene), f" on the scene {settings.scene}"

    def robot(self) -> Any:
        """See `make_spatial_robot`; how far the material is, the scene says."""
        return make_spatial_robot(self._settings, self._scene), UNKNOWN_REACH

    def moved_robot(self, say: Say) -> Any:
        """See `make_moved_spatial_robot`."""
        return make_moved_spatial_robot(self._settings, self._scene, say=say), UNKNOWN_REACH

    def operator(self, reach: Any, say: Say) -> Any:
        """See `make_spatial_operator`."""
        return make_spatial_operator(self._settings, self._scene, self._scene.nominal, say)

    def texts(self, robot: Any, reach: Any) -> dict[str, str]:
        """Texts of the log on a robot that is not the simulated one."""
        return own_robot(robot)

    def camera(self, robot: Any, say: Say) -> SimulatedCamera | None:
        """See `make_camera`; it needs a robot that says where its fixture is."""
        if self._settings.fusion not in ("full", "image"):
            return None
        if robot.read().fixture:
            return make_camera(self._settings, self._scene, say=say)
        say("camera: the robot does not say where its fixture is; the session goes on without it")
        return None

    def seen(self) -> Scene:
        """See `LineSetup.seen`."""
        return self._scene


SETUPS = {LINE: LineSetup, SPACE: SpaceSetup}


def setup_of(settings: SessionSettings) -> LineSetup:
    """What makes the machines of these settings; a scene that cannot be made is refused."""
    return SETUPS[settings.workspace](settings)

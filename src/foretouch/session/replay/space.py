"""A recorded session in three dimensions run again: a hand that moves as it did, and all else simulated again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from foretouch.devices import SpatialDevice
from foretouch.errors import RecordingError
from foretouch.messages import SessionLog
from foretouch.quantities import Rows
from foretouch.quantities.pose import Vector
from foretouch.robot import material_names
from foretouch.session.runners.simulated_scene import simulate_scene
from foretouch.session.settings import NO_GRIP, SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.camera import SimulatedCamera
from foretouch.session.spatial.making import make_camera, make_spatial_operator, make_spatial_robot
from foretouch.session.spatial.scenes import Scene, make_scene

_REAL = "is of a real robot in three dimensions, which nobody can simulate again"
_HELD = "is of a hand in three dimensions, which is run again with --closed-loop alone"
_UNKNOWN = "does not say what its hand meant in three dimensions: with --closed-loop only a scripted one is run again"
_STILL = "holds no place of the operator's hand: there is no motion to run again"


class PlayedSpatialOperator(SpatialDevice):
    """A hand that moves through the world as it did in a recorded session, whatever it feels or sees.

    Args:
        name: Of the operator that was recorded.
        space: Rows of `SessionLog.leader_space` of one process, with some place of the hand in them.
        position_scale: Of the session: the places are those of the follower.
    """

    def __init__(self, name: str, space: Rows, *, position_scale: float = 1.0) -> None:
        known = space[np.isfinite(space["hand_x"])]
        self._name = name
        self._time = (known["time_ns"] - space["time_ns"][0]).astype(np.float64)
        self._axes = [known[f"hand_{axis}"] / position_scale for axis in "xyz"]
        self._place: Vector = (math.nan, math.nan, math.nan)

    @property
    def name(self) -> str:  # type: ignore[override]  # that of whoever was recorded
        """Name of the operator."""
        return self._name

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m]; between the recorded ticks on a straight line."""
        x, y, z = (float(np.interp(now_ns, self._time, axis)) for axis in self._axes)
        self._place = (x, y, z)
        return self._place

    @property
    def intention(self) -> Vector:
        """Where the hand is: nothing moves it."""
        return self._place


def replay_scene(
    log: SessionLog,
    settings: SessionSettings,
    closed_loop: bool,
    description: Mapping[str, str],
    progress: Callable[[float], None] | None = None,
) -> SessionLog:
    """Run a session in three dimensions again; see `foretouch.session.replay.under`.

    World, robot and camera are simulated again from the settings and their seed. In an open loop the hand goes its
    recorded way; in a closed loop the script is played again to a hand that the force moves.

    Args:
        log: One stretch of a simulated session.
        settings: All of them.
        closed_loop: Whether the force moves the hand.
        description: Further texts for the log.
        progress: Called now and then with the time that has been run again [s].

    Raises:
        RecordingError: The robot was a real one, the material is of a package that is not installed, or there was a
            camera and there is none here. In an open loop: the hand felt something. In a closed loop: the hand did not
            follow a script.
    """
    if not np.isfinite(log.follower_space["exact_x"]).any():
        raise RecordingError("session", _REAL)
    if not np.isfinite(log.leader_space["hand_x"]).any():
        raise RecordingError("session", _STILL)
    if (material := log.settings.get("material", settings.material)) not in material_names():
        raise RecordingError("session", f"was of the material {material!r}, which is not here to be simulated again")
    scene = make_scene(settings.scene)
    operator = _operator(log, settings, scene, closed_loop)
    robot = make_spatial_robot(settings, scene)
    camera = _camera(settings, scene)
    ticks = round(np.ptp(log.leader["time_ns"]) * 1e-9 / SAMPLE_PERIOD) + 1
    try:
        return simulate_scene(
            settings,
            scene,
            duration=ticks * SAMPLE_PERIOD,
            operator=operator,
            robot=robot,
            camera=camera,
            description=description,
            progress=progress,
        ).log
    finally:
        if camera is not None:
            camera.close()


def _operator(log: SessionLog, settings: SessionSettings, scene: Scene, closed_loop: bool) -> SpatialDevice:
    name = log.settings.get("operator", settings.operator)
    if not closed_loop:
        if settings.grip != NO_GRIP:
            raise RecordingError("session", _HELD)
        return PlayedSpatialOperator(name, log.leader_space, position_scale=settings.position_scale)
    if name != "scripted":
        raise RecordingError("session", _UNKNOWN)
    return make_spatial_operator(settings, scene, scene.nominal)


def _camera(settings: SessionSettings, scene: Scene) -> SimulatedCamera | None:
    if settings.fusion not in ("full", "image"):
        return None
    said: list[str] = []
    camera = make_camera(settings, scene, say=said.append)
    if camera is None:
        problem = said[0].partition(";")[0].removeprefix("camera: ")
        raise RecordingError("session", f"has images, which are drawn again: {problem}")
    return camera

"""Sessions in simulated time: the same steps, one process, a seeded network, bit-identical on repeat."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import InputError, SettingError
from foretouch.errors.checks import require, require_type
from foretouch.robot import Robot, SpatialRobot, material_names
from foretouch.session.operators import (
    close_operator,
    felt_texts,
    make_operator,
    own_robot,
    pressed_material,
    reach_of,
    require_axes,
    require_simulated_operator,
    require_simulated_time,
    say_on_stderr,
)
from foretouch.session.robots import make_session_robot, reach_texts, require_simulated_robot
from foretouch.session.runners.lap import Progress, Record, SimulatedSession, run_session
from foretouch.session.settings import SessionSettings
from foretouch.session.spatial import (
    SimulatedCamera,
    make_camera,
    make_scene,
    make_spatial_operator,
    make_spatial_robot,
)
from foretouch.settings import SIMULATED


def simulate(
    settings: SessionSettings,
    *,
    duration: float = 20.0,
    operator: Device | SpatialDevice | None = None,
    robot: Robot | SpatialRobot | None = None,
    description: Mapping[str, str] | None = None,
    record: Record | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = say_on_stderr,
) -> SimulatedSession:
    """Run a session in simulated time, as the command ``foretouch simulate`` does; with a scene, in three dimensions.

    Each tick runs the follower, then the leader. Time is the number of the tick, so that nothing of this machine
    enters; the real computing times are kept out of the messages.

    Args:
        settings: Of the session.
        duration: Simulated [s]; by default as long as on the command line.
        operator: Moves the leader, and has moved none before; with a scene a `SpatialDevice`. It counts as the
            settings' leader frame says. None for the settings' own.
        robot: The follower's, which has not moved before and presses the settings' material, or one of your own; with a
            scene a `SpatialRobot`. It counts as the settings' follower frame says. None for the settings' own.
        description: Further settings for the log, as the sides say in their `Hello`.
        record: Called with each message to keep and its simulated time [ns].
        progress: Called now and then with the simulated time [s].
        say: Told in one line what was assumed or left out where operator and robot are made.

    Raises:
        SettingError: A duration that is negative or not finite; a robot of another material than the settings'; an
            operator or a robot of one axis in a scene, or of three along a line; settings whose operator or robot needs
            real time.
        InputError: An operator or a robot that was used before, as far as it says (`Device.fresh`, `Robot.fresh`).
        ArgumentTypeError: Settings, operator, robot or description that are none.
        MissingExtraError: What the robot needs is not installed.
    """
    return prepare_simulation(
        settings,
        duration=duration,
        operator=operator,
        robot=robot,
        description=description,
        progress=progress,
        say=say,
    )(record)


def prepare_simulation(
    settings: SessionSettings,
    *,
    duration: float,
    operator: Device | SpatialDevice | None = None,
    robot: Robot | SpatialRobot | None = None,
    description: Mapping[str, str] | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = say_on_stderr,
) -> Callable[[Record | None], SimulatedSession]:
    """Make what a simulated session needs and was not given; bad input is refused here, before anything is written.

    Args and Raises: As of `simulate`.

    Returns:
        What runs the session, once: it takes what records, or None.
    """
    require_type("settings", settings, SessionSettings, "SessionSettings: SessionSettings() are the defaults")
    kinds = {"operator": (Device, SpatialDevice), "robot": (Robot, SpatialRobot)}
    for (name, kind), given in zip(kinds.items(), (operator, robot), strict=True):
        kinds_of = f"a {kind[0].__name__}, in a scene a {kind[1].__name__}"
        wanted = f"{kinds_of}, or None for the settings' own: make_{name} gives one"
        require_type(name, given, (*kind, type(None)), wanted)
        if given is not None:
            require_axes(name, given, type(given).__name__, settings)
            if not given.fresh:
                raise InputError(f"the {name} was used before: make a fresh one for each session, or leave it out")
    require_type("description", description, (Mapping, type(None)), "texts by name, or None")
    require("duration", duration, at_least=0.0)
    if operator is None:
        require_simulated_operator(settings)
    with ExitStack() as made:  # closed here is what is made here
        machines = _machines(made, settings, operator, robot, say)
        to_close = made.pop_all()
    moved, driven, camera, texts = machines

    def run_once(record: Record | None) -> SimulatedSession:
        texts.update(description or {})
        with to_close:
            return run_session(
                settings, moved, driven, camera, duration=duration, description=texts, record=record, progress=progress
            )

    return run_once


Machines = tuple[Device | SpatialDevice, Robot | SpatialRobot, SimulatedCamera | None, dict[str, str]]
"""Operator, robot, the camera beside it and texts of the log on them."""


def _machines(
    made: ExitStack, settings: SessionSettings, operator: Any, robot: Any, say: Callable[[str], None]
) -> Machines:
    """Make the robot and operator that were not passed, and in a scene the camera."""
    scene = make_scene(settings.scene) if settings.scene else None
    reach: Any = None
    if robot is not None:
        reach = reach_of(robot, settings)
    else:
        robot, reach = make_session_robot(settings) if scene is None else (make_spatial_robot(settings, scene), None)
        made.callback(robot.close)
        require_simulated_robot(robot, settings)
    texts = own_robot(robot) if scene is not None else _own_material(robot, settings) | reach_texts(reach)
    if operator is None:
        if scene is not None:
            operator = make_spatial_operator(settings, scene, scene.nominal, say)
        else:
            operator = make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=say)
        made.callback(close_operator, operator)
        require_simulated_time(operator)
    camera = None
    if scene is not None and settings.fusion in ("full", "image"):
        if robot.read().fixture:
            camera = make_camera(settings, scene, say=say)
        else:
            say("camera: the robot does not say where its fixture is; the session goes on without it")
    if camera is not None:
        made.callback(camera.close)
    return operator, robot, camera, felt_texts(operator, settings) | texts


def _own_material(robot: Robot, settings: SessionSettings) -> dict[str, str]:
    """Texts of the log on the material, where the robot presses one of its own, which no setting can name.

    Raises:
        SettingError: It presses another material than the settings name.
    """
    material = pressed_material(robot)
    if settings.robot != SIMULATED or material is None or material.name == settings.material:
        return {}
    if material.name in material_names():
        rule = f"the robot presses {material.name}; make it with make_robot(settings.material), or leave it out"
        raise SettingError("material", settings.material, rule)
    return {"material": material.name}

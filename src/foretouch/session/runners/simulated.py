"""Sessions in simulated time: the same steps, one process, a seeded network, bit-identical on repeat."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import InputError, SettingError
from foretouch.errors.checks import require, require_type
from foretouch.robot import Robot, SpatialRobot, material_names
from foretouch.session.operators import (
    close_operator,
    felt_texts,
    make_operator,
    pressed_material,
    reach_of,
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
    operator: Device | None = None,
    robot: Robot | None = None,
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
        operator: Moves the leader, and has moved none before; counts as the settings' leader frame says. None for the
            settings' own.
        robot: The follower's, which has not moved before and presses the settings' material, or one of your own; counts
            as the settings' follower frame says. None for the settings' own.
        description: Further settings for the log, as the sides say in their `Hello`.
        record: Called with each message to keep and its simulated time [ns].
        progress: Called now and then with the simulated time [s].
        say: Told in one line what was assumed or left out where operator and robot are made.

    Raises:
        SettingError: A duration that is negative or not finite; a robot of another material than the settings'; an
            operator or a robot beside a scene, which has its own; settings whose operator or robot needs real time.
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
    operator: Device | None = None,
    robot: Robot | None = None,
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
    require_type("operator", operator, (Device, type(None)), "a Device, or None: make_operator gives one")
    require_type("robot", robot, (Robot, type(None)), "a Robot, or None: make_robot gives one")
    require_type("description", description, (Mapping, type(None)), "texts by name, or None")
    require("duration", duration, at_least=0.0)
    for name, given in (("operator", operator), ("robot", robot)):
        if given is not None and not given.fresh:
            raise InputError(f"the {name} was used before: make a fresh one for each session, or leave it out")
    if operator is None:
        require_simulated_operator(settings)
    if settings.scene and (operator is not None or robot is not None):
        raise SettingError("scene", settings.scene, "has an operator and a robot of its own: leave both out")
    with ExitStack() as made:  # closed here is what is made here
        machines = _in_scene(made, settings, say) if settings.scene else _on_line(made, settings, operator, robot, say)
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


def _in_scene(made: ExitStack, settings: SessionSettings, say: Callable[[str], None]) -> Machines:
    """Make robot, operator and camera of a scene."""
    scene = make_scene(settings.scene)
    robot = make_spatial_robot(settings, scene)
    operator = make_spatial_operator(settings, scene, scene.nominal)
    camera = make_camera(settings, scene, say=say) if settings.fusion in ("full", "image") else None
    if camera is not None:
        made.callback(camera.close)
    return operator, robot, camera, {}


def _on_line(
    made: ExitStack, settings: SessionSettings, operator: Device | None, robot: Robot | None, say: Callable[[str], None]
) -> Machines:
    """Make the robot and operator of a session along a line that were not passed."""
    if robot is None:
        robot, reach = make_session_robot(settings)
        made.callback(robot.close)
        require_simulated_robot(robot, settings)
    else:
        reach = reach_of(robot, settings)
    texts = _own_material(robot, settings) | reach_texts(reach)
    if operator is None:
        operator = make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=say)
        made.callback(close_operator, operator)
        require_simulated_time(operator)
    return operator, robot, None, felt_texts(operator, settings) | texts


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

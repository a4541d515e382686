"""Sessions in simulated time: the same steps, one process, a seeded network, bit-identical on repeat."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import InputError
from foretouch.errors.checks import require, require_type
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.operators import (
    close_operator,
    felt_texts,
    reach_of,
    require_axes,
    require_simulated_operator,
    require_simulated_time,
    say_on_stderr,
)
from foretouch.session.runners.lap import Progress, Record, SimulatedSession, run_session
from foretouch.session.settings import SessionSettings
from foretouch.session.setup import require_simulated_robot, setup_of
from foretouch.session.spatial import SimulatedCamera


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
    """Make the robot and operator that were not passed, and the camera where there is one."""
    setup = setup_of(settings)
    if robot is not None:
        reach = reach_of(robot, settings)
    else:
        robot, reach = setup.robot()
        made.callback(robot.close)
        require_simulated_robot(robot, settings)
    texts = setup.texts(robot, reach)
    if operator is None:
        operator = setup.operator(reach, say)
        made.callback(close_operator, operator)
        require_simulated_time(operator)
    camera = setup.camera(robot, say)
    if camera is not None:
        made.callback(camera.close)
    return operator, robot, camera, felt_texts(operator, settings) | texts

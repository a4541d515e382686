"""Sessions in simulated time: the same steps, one process, a seeded network, bit-identical on repeat."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from foretouch.devices import Device
from foretouch.errors import InputError, SettingError
from foretouch.errors.checks import require, require_type
from foretouch.robot import Robot
from foretouch.session.operators import require_simulated_operator, say_on_stderr
from foretouch.session.runners.lap import Record, SimulatedSession, prepare_line, prepare_scene
from foretouch.session.settings import SessionSettings


def simulate(
    settings: SessionSettings,
    *,
    duration: float = 20.0,
    operator: Device | None = None,
    robot: Robot | None = None,
    description: Mapping[str, str] | None = None,
    record: Record | None = None,
    progress: Callable[[float], None] | None = None,
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
    progress: Callable[[float], None] | None = None,
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
    if settings.scene:
        if operator is not None or robot is not None:
            raise SettingError("scene", settings.scene, "has an operator and a robot of its own: leave both out")
        return prepare_scene(settings, duration, description=description, progress=progress, say=say)
    return prepare_line(settings, duration, operator, robot, description=description, progress=progress, say=say)

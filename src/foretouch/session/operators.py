"""Operators by name: those of this package, hardware devices, and those of other packages; and their robots."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, cast

from foretouch.devices import (
    GRIPS,
    HARDWARE_OPERATORS,
    INTENDED_FORCE,
    OPERATORS,
    UNKNOWN_REACH,
    AnyDevice,
    BrowserOperator,
    Device,
    DeviceSpecification,
    Reach,
    RecordedOperator,
    RestingOperator,
    ScriptedOperator,
    SpatialDevice,
)
from foretouch.errors import InputError, SettingError, UnknownNameError, printable
from foretouch.errors.checks import NUMBER, require_type
from foretouch.plugins import make_plugin
from foretouch.quantities import Frame
from foretouch.recordings import excerpt, read_leader_motion
from foretouch.robot import (
    ArmAlongLine,
    Material,
    RcmArm,
    Robot,
    SpatialRobot,
    WrappedRobot,
    WrappedSpatialRobot,
    make_material,
)
from foretouch.robot.drivers import SlowerRobot, SlowerSpatialRobot
from foretouch.session.settings import ROBOTS, SAMPLE_PERIOD, SessionSettings
from foretouch.session.workspace import FramedRobot, device_inside, framed_device, framed_robot, inverse
from foretouch.settings import ARM_ENDING, NO_GRIP, is_simulated

RECORDED_MOTION = "tue/b-foam"  # Dataset whose leader lever moves the ``recorded`` operator

STAYS_IN_THE_AIR = (
    "does not say where its surface is, so a script stays in the air: take the handle in the console, or an operator "
    "with a hand (gamepad, your own device)"
)
"""Sentence for an operator whose robot is not known to press anything."""

DEVICE_NUMBERS = ("mass", "damping", "friction", "resolution", "delay", "watchdog")
"""Properties of a device that can be set, with the prefix ``device_``."""

NEAREST_SURFACE, FARTHEST_SURFACE, SHALLOWEST, DEEPEST = 0.001, 0.2, 0.0005, 0.1
"""Nearest and farthest surface for the operators, and their least and largest press depth [m]."""


def say_on_stderr(line: str) -> None:
    """One line for people, on the error stream, as the command line says it."""
    sys.stderr.write(f"{printable(line, lines=True)}\n")


def make_operator(
    settings: SessionSettings,
    *,
    robot: Robot | None = None,
    surface: float | None = None,
    press_depth: float | None = None,
    say: Callable[[str], None] = say_on_stderr,
) -> Device:
    """The operator of a session, newly made; with a grip, a hand that intends what that operator does.

    It counts as the settings' leader frame says: a simulated device is built to. A hardware device, or one of another
    package, counts in its own frame, and the session translates it.

    Args:
        settings: Session settings.
        robot: Robot that presses, for its surface and press depth; None for the settings' own.
        surface: Position of the material's surface for the follower [m]; the operator sees it. NaN where it is unknown;
            None for the robot's.
        press_depth: Depth of the deepest press there [m]; NaN where it is unknown; None for the robot's.
        say: Prints one line when the measured motion is not available and the script is used instead, and when the
            damping of a device that is felt had to be assumed.

    Raises:
        SettingError: A position scale by which the operator's hand cannot reach the material; an operator that needs
            an unknown surface; a device that is felt, with a simulated grip or a baseline.
        PluginError: Another package's device, which cannot be made.
        MissingExtraError: What the device needs is not installed.
        ArgumentTypeError: Settings, a robot or lengths that are none.
    """
    require_type("settings", settings, SessionSettings, "SessionSettings: SessionSettings() are the defaults")
    require_type("robot", robot, (Robot, type(None)), "a Robot, or None: make_robot gives one")
    for name, length in (("surface", surface), ("press_depth", press_depth)):
        require_type(name, length, (*NUMBER, type(None)), "a length [m], or None for what the robot knows")
    if surface is None or press_depth is None:
        known = reach_of(robot, settings)
        surface = known.surface if surface is None else surface
        press_depth = known.press_depth if press_depth is None else press_depth
    if settings.operator not in OPERATORS:
        return cast("Device", foreign_operator(settings, _scaled(settings, surface, press_depth), say))
    reach = _hand_lengths(settings, surface, press_depth)
    deepest = reach.press_depth
    if settings.grip != NO_GRIP and reach.known:
        deepest = min(deepest + INTENDED_FORCE / GRIPS[settings.grip].stiffness, DEEPEST)
    return cast("Device", mounted_operator(settings, _intention(settings, reach.surface, deepest, say)))


def mounted_operator(settings: SessionSettings, intention: Any) -> Any:
    """An operator of the package in the settings' leader frame; with a grip, a hand that intends what it does."""
    if settings.grip != NO_GRIP:
        intention = settings.workspace.hand(intention, GRIPS[settings.grip], settings.device, settings.clutch)
    return framed_device(intention, inverse(settings.leader_frame))


def reach_of(robot: Robot | SpatialRobot | None, settings: SessionSettings) -> Material | Reach:
    """Position of the surface in the session and depth of the presses, as far as the robot provides them.

    Args:
        robot: Robot of the session; None for the one of the settings, which provides them only if it is simulated.
        settings: Session settings.
    """
    if robot is None:
        return make_material(settings.material) if is_simulated(settings.robot) else UNKNOWN_REACH
    material = pressed_material(robot)
    if material is None:
        return UNKNOWN_REACH
    inner, frames = robot_inside(robot)
    if not isinstance(inner, RcmArm | ArmAlongLine):
        return material
    surface = inner.surface
    outermost: Any = settings.follower_frame  # of a line, as the robot is
    for frame in reversed((outermost, *frames)):
        surface = frame.inside(surface)
    return Reach(surface, material.press_depth)


def pressed_material(robot: Any) -> Material | None:
    """Material that a robot presses, where it is simulated and provides it."""
    material = getattr(robot_inside(robot)[0], "material", None)
    return material if isinstance(material, Material) else None


def robot_inside(robot: Any) -> tuple[Any, list[Frame]]:
    """A robot without the frames around it, and those frames, the outermost first."""
    frames = []
    while isinstance(robot, WrappedRobot | WrappedSpatialRobot):
        if isinstance(robot, FramedRobot):
            frames.append(robot.frame)
        robot = robot.robot
    return robot, frames


def felt_device(operator: AnyDevice, settings: SessionSettings) -> DeviceSpecification | None:
    """Specification of the operator's own device, if it is felt and no simulated hand holds it; else None."""
    return operator.specification if operator.closed_loop and settings.grip == NO_GRIP else None


def felt_texts(operator: AnyDevice, settings: SessionSettings) -> dict[str, str]:
    """Texts of a session on such a device, in place of its settings; empty where there is none."""
    device = felt_device(operator, settings)
    if device is None:
        return {}
    numbers = {name: getattr(device, name) for name in DEVICE_NUMBERS}
    return {"felt": "yes"} | {f"device_{name}": str(value) for name, value in numbers.items()}


def _say_assumed(operator: AnyDevice, settings: SessionSettings, say: Callable[[str], None]) -> None:
    """Print the damping or delay assumed of a device that is felt and does not specify them."""
    device = felt_device(operator, settings)
    if device is None:
        return
    assumed = {
        "damping": f"{device.damping:g} N s/m, the least of its class,",
        "delay": f"{1e3 * device.delay:g} ms, the most that there may be,",
    }
    unstated = [
        name
        for name in assumed
        if getattr(settings, f"device_{name}") is None and getattr(device, name) == getattr(settings.device, name)
    ]
    if unstated:
        taken = " and ".join(f"{assumed[name]} is taken for its {name}" for name in unstated)
        options = " and ".join(f"--device-{name}" for name in unstated)
        say(
            f"operator: nobody states the {' and '.join(unstated)} of {operator.name}: {taken} so that no more than "
            f"{device.largest_stiffness(SAMPLE_PERIOD):.0f} N/m are felt; state it by {options}"
        )


def close_operator(operator: AnyDevice) -> None:
    """Close the device that moves the hand, so that it gives no force any more."""
    device_inside(operator).close()


def require_axes(what: str, machine: Any, name: str, settings: SessionSettings) -> None:
    """Refuse an ``operator`` or ``robot`` of one axis in a scene, and one of three dimensions along a line.

    Raises:
        SettingError: It is of the other kind, and closed.
    """
    ours = settings.workspace
    if isinstance(machine, ours.device | ours.robot):
        return
    machine.close()
    kind = {"operator": ours.device, "robot": ours.robot}[what].__name__
    raise SettingError(what, name, ours.machines.format(scene=settings.scene, kind=kind))


def require_simulated_operator(settings: SessionSettings) -> None:
    """Refuse settings whose operator sits at a console.

    Raises:
        SettingError: They name ``"browser"``.
    """
    if settings.operator == "browser":
        rule = "needs real time: use `foretouch teleop`, or scripted or recorded"
        raise SettingError("operator", settings.operator, rule)


def require_simulated_time(operator: AnyDevice) -> None:
    """Refuse a device that a person's hand moves.

    Raises:
        SettingError: It needs real time.
    """
    device = device_inside(operator)
    if device.real_time:
        device.close()
        raise SettingError("operator", device.name, "is moved by your own hand and needs real time: foretouch teleop")


def foreign_operator(settings: SessionSettings, reach: Reach, say: Callable[[str], None]) -> Any:
    """A hardware device, or one of another package, where no grip is in the way also in a hand; see `make_operator`."""
    made = _with_grip(settings, _foreign(settings, reach))
    _say_assumed(made, settings, say)
    device, simulated = felt_device(made, settings), is_simulated(settings.robot) and settings.material
    if simulated and make_material(settings.material).pulls and not (device is not None and device.pulls):
        say(f"operator: {settings.material} pulls, and {made.name} draws no hand in: what pulls is predicted, not felt")
    return made


def _foreign(settings: SessionSettings, reach: Reach) -> Any:
    name = settings.operator
    if name == "gamepad":
        from foretouch.devices.gamepad import open_gamepad

        return open_gamepad(reach)
    if name == "force-dimension":
        from foretouch.devices.force_dimension import open_force_dimension

        return open_force_dimension(settings.device)
    kinds: Any = (Device, SpatialDevice)
    made = make_plugin("device", name, kinds, settings, reach, built_in=(*OPERATORS, *HARDWARE_OPERATORS))
    if made is None:
        raise UnknownNameError("operator", name, settings.operators())
    require_axes("operator", made, name, settings)
    return made


def _with_grip(settings: SessionSettings, device: Any) -> Any:
    """The device itself, or a simulated hand that intends its motion."""
    if settings.grip == NO_GRIP and (not device.closed_loop or settings.baseline == "none"):
        return device
    if device.closed_loop:
        device.close()
        what = "grip" if settings.grip != NO_GRIP else "baseline"
        rule = f"the operator {settings.operator} is felt by a hand of its own: leave {what} at none"
        raise SettingError(what, getattr(settings, what), rule)
    # The device's own frame is applied here, so that the hand and its intention count alike.
    return mounted_operator(settings, framed_device(device, settings.leader_frame))


def _scaled(settings: SessionSettings, surface: float, press_depth: float) -> Reach:
    """Position at which the hand meets the surface and its depth [m]."""
    return Reach(surface / settings.position_scale, press_depth / settings.position_scale)


def _hand_lengths(settings: SessionSettings, surface: float, press_depth: float) -> Reach:
    """The same lengths for an operator of this package, so that the proxy does what the follower should do."""
    scale, reach = settings.position_scale, _scaled(settings, surface, press_depth)
    if not reach.known:
        return reach
    least = max(surface / FARTHEST_SURFACE, press_depth / DEEPEST)
    most = min(surface / NEAREST_SURFACE, press_depth / SHALLOWEST)
    if not least <= scale <= most:
        rule = f"an operator of the package reaches this material by a scale of {least:.3g} to {most:.3g}"
        raise SettingError("position_scale", scale, rule)
    return reach


def _intention(settings: SessionSettings, surface: float, press_depth: float, say: Callable[[str], None]) -> Device:
    name = settings.operator
    if not Reach(surface, press_depth).known:
        if name == "browser":
            robot = "the robot" if is_simulated(settings.robot) else f"robot {settings.robot!r}"
            say(f"operator: {robot} {STAYS_IN_THE_AIR}")
            return BrowserOperator(RestingOperator())
        rule = (
            "presses by what it knows of the surface, and this robot does not say where it is: take one that you move"
        )
        raise SettingError("operator", name, f"{rule}, such as browser or gamepad")
    script = ScriptedOperator(surface, press_depth, settings.seed)
    if name == "browser":
        return BrowserOperator(script, deepest=surface + 1.2 * press_depth)
    if name == "recorded":
        return recorded_operator(surface, press_depth)
    assert name == "scripted", name  # an operator in OPERATORS is made above
    return script


def recorded_operator(surface: float, press_depth: float) -> RecordedOperator:
    """The measured motion of a leader's lever, into a surface there and as deep [m]."""
    time, position = read_leader_motion(excerpt(RECORDED_MOTION))
    return RecordedOperator(time, position, surface, press_depth)


def mounted_robot(settings: SessionSettings, arm: Any) -> Any:
    """A simulated arm with the settings' sensor fault, in their follower frame."""
    if settings.sensor_fault:
        arm = settings.workspace.faulty(arm, settings.sensor_fault, seed=settings.seed)
    return framed_robot(arm, inverse(settings.follower_frame))


def foreign_robot(settings: SessionSettings) -> Any:
    """Another package's robot; see `foretouch.session.make_session_robot`."""
    kinds: Any = (Robot, SpatialRobot)
    robot = make_plugin("robot", settings.robot, kinds, settings, built_in=ROBOTS)
    if robot is None:
        raise UnknownNameError("robot", settings.robot, (*settings.robots(), f"FILE{ARM_ENDING}"))
    require_axes("robot", robot, settings.robot, settings)
    if robot.specification.sample_period == SAMPLE_PERIOD:
        return robot
    slower = SlowerSpatialRobot if isinstance(robot, SpatialRobot) else SlowerRobot
    try:
        return slower(robot, SAMPLE_PERIOD)
    except InputError as error:
        robot.close()
        raise SettingError("robot", settings.robot, f"has {error}") from None

"""The settings of a session, each declared once: its default, range, heading of the help, owner, and one sentence.

The command line takes its options from here, `foretouch.session.SessionSettings` its fields, checks and documentation,
leader and follower which of them are theirs, and the safety at the robot its limits. It imports nothing of the package,
so that help is printed at once.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

Kind = TypeVar("Kind")
Owner = Literal["leader", "follower"]

LAWS_HELP = (
    "Contact law: contact-map, or continuous-switching (the paper's), hunt-crossley, kelvin-voigt, "
    "threshold-switching; without it contact-map."
)

NO_GRIP = "none"  # The grip of an operator whose hand the force does not move
NO_BASELINE = "none"  # The baseline of a session that renders models

SIMULATED = "simulated"
"""The plainest robot of the package: a slide or three in MuJoCo, which press the settings' material."""

ARMS = ("fr3", "ur5e", "so101")
"""The arms of the package, which press it too; another is the file of its description."""


def is_simulated(robot: str) -> bool:
    """Whether a robot of this name presses the settings' material in MuJoCo."""
    return robot == SIMULATED or is_arm(robot)


def is_arm(robot: str) -> bool:
    """Whether a robot of this name is a simulated arm: one of the package, or the file of a description."""
    return robot in ARMS or robot.endswith(ARM_ENDING)


ARM_ENDING = ".xml"

BASELINES = (NO_BASELINE, "delayed", "delayed-tdpa")
"""What renders: models, or for comparison the delayed force, without and with a passivity controller."""

UNKNOWN = "unknown"
"""The scene of which no shape is given."""

SCENES = ("plane", "hill", "phantom", UNKNOWN)
"""Names of the scenes of the package; another is the file of a mesh."""

MESH_ENDINGS = (".stl", ".obj", ".ply")

PRESSED = "What is pressed and learnt"
HAND = "Operator, hand and device"
GIVEN = "What the hand is given"
ROBOT = "Robot"
SCENE = "In three dimensions"
SAFETY = "Safety at the robot"
NETWORK = "Network"


@dataclass(frozen=True)
class Setting:
    """What is declared of a setting.

    Args:
        sentence: What it is, with its unit in brackets, for help and documentation.
        group: Heading under which the help lists it.
        owner: Whose it is. Each side delays what it receives, so that the delay of forces is the leader's, and that of
            positions the follower's.
        bounds: Arguments of `foretouch.errors.checks.require`, where each value by itself is checked.
        choices: All values of a text that has few.
        limit: Field of `foretouch.session.safety.safety.SafetyLimits` that it becomes.
    """

    sentence: str
    group: str
    owner: Owner = "follower"
    bounds: Mapping[str, float] = dataclasses.field(default_factory=dict)
    choices: tuple[str, ...] = ()
    limit: str = ""


def _group(group: str, owner: Owner = "follower") -> Callable[..., Any]:
    """Makes fields of one group, each of its default, its sentence, what `Setting` has besides, and bounds."""

    def setting(
        default: Any,
        sentence: str,
        *,
        owner: Owner = owner,
        choices: tuple[str, ...] = (),
        limit: str = "",
        **bounds: float,
    ) -> Any:
        return dataclasses.field(
            default=default, metadata={"setting": Setting(sentence, group, owner, bounds, choices, limit)}
        )

    return setting


_pressed, _robot, _scene, _safety, _network = map(_group, (PRESSED, ROBOT, SCENE, SAFETY, NETWORK))
_hand, _given = _group(HAND, "leader"), _group(GIVEN, "leader")


DELAY = {"at_least": 0.0, "at_most": 10.0}  # A longer delay [s] is in another unit
SCALE = {"at_least": 0.01, "at_most": 100.0}  # Of either scale


LEAST_BUDGET = 1000.0
"""Least bytes a second over a thin link: signs of life every 50 ms take half of them, and a model still comes within
two seconds."""

PROTECTIONS = ("none", "parity", "strong")
"""Names of what is sent against loss, `foretouch.session.thin.ends.Protection`."""


@dataclass(frozen=True)
class Declared:
    """Fields of `foretouch.session.SessionSettings` that are chosen."""

    material: str = _pressed(
        "",
        "What the simulated robot presses: `foretouch materials list`, or a plug-in's; without it foam-measured, in a "
        "scene hunt-crossley.",
    )
    model: str = _pressed("", LAWS_HELP)
    estimator: str = _pressed("", "Estimator; without it the law's own. A wrong name lists them all.")
    model_rate: float = _pressed(
        50.0, "Models a second while nothing changes [1/s], up to 1000.", above=0.0, at_most=1000.0
    )
    remembered: str = _pressed("", "A contact map of this material from before, as --remember writes it in recordings.")
    seed: int = _pressed(0, "Seed of all that is random: sensors, operator and network.", at_least=0)
    operator: str = _hand(
        "scripted", "Who moves the robot: scripted, recorded, browser, gamepad, force-dimension, or a plug-in."
    )
    grip: str = _hand(
        NO_GRIP,
        "Hand that holds the device and is moved by the force: soft, normal or stiff; none for the operator's motion "
        "as it is, whatever the force.",
    )
    device_mass: float = _hand(0.1, "Mass of the device in the hand [kg].")
    device_damping: float | None = _hand(
        None,
        "Viscous friction of the device [N s/m], on which depends how much stiffness it can carry; without it 2 in a "
        "simulated hand, and 0.1 in a person's.",
    )
    device_friction: float = _hand(0.1, "Coulomb friction of the device [N].")
    device_resolution: float = _hand(1e-5, "Count of the device's encoder [m].")
    device_delay: float | None = _hand(
        None,
        "Time from reading a position until its force acts [s]; without it 0.0005 in a simulated hand, and one tick "
        "in a person's.",
    )
    device_watchdog: float = _hand(
        0.02, "Time after which the device drops a force that is not renewed [s]; 0 for never."
    )
    clutch: str = _hand("", "When the hand presses its clutch [s since it met the follower]: START:END,START:END.")
    leader_frame: str = _hand(
        "0,1",
        "ORIGIN,DIRECTION: where the device has 0 [m], and -1 if it counts outwards; with a scene X,Y,Z,RX,RY,RZ: its "
        "base in the world, a position [m] and a rotation vector [rad].",
    )
    position_scale: float = _given(1.0, "Follower's motion for the hand's, 0.01 to 100.", **SCALE)
    force_scale: float = _given(1.0, "Hand's force for the follower's, 0.01 to 100.", **SCALE)
    largest_stiffness: float = _given(
        0.0, "Largest local stiffness that is rendered [N/m]; 0 for what the device carries.", at_least=0.0
    )
    baseline: str = _given(
        "none",
        "Render the delayed force instead, for comparison: delayed, or delayed-tdpa with a passivity controller.",
        choices=BASELINES,
    )
    robot: str = _robot(
        SIMULATED,
        "The follower's robot: simulated, an arm (fr3, ur5e, so101, or its description's file), or a plug-in's.",
    )
    calibration: str = _robot(
        "", "TOML file of `foretouch calibrate` for the robot's force sensor, on the robot's machine."
    )
    first_touch: str = _robot(
        "auto",
        "What the follower does at a surface that the leader does not know: guarded or follow; auto guards with a "
        "grip or a real robot.",
        owner="leader",
        choices=("auto", "guarded", "follow"),
    )
    approach_speed: float = _robot(
        0.02, "Speed of a guarded follower before it knows a surface [m/s], up to 0.5.", above=0.0, at_most=0.5
    )
    guarded_force: float = _robot(2.0, "Force at which a guarded follower holds [N], 0.5 to 15.")
    follower_frame: str = _robot("0,1", "The same of the robot, as --leader-frame.")
    sensor_fault: str = _robot(
        "", "KIND:BEGIN:END [s]: the simulated robot's sensors fail meanwhile, such as stuck:5:8."
    )
    scene: str = _scene(
        "",
        "What is touched in three dimensions: plane, hill, phantom, or the file of a mesh (.stl, .obj, .ply); unknown "
        "for a shape that is learnt; without it a session is along a line.",
    )
    specimen: str = _scene(
        "",
        "What stands there in a simulation of the scene unknown, and no side is told: plane, hill, phantom, or the "
        "file of a mesh; without it phantom.",
    )
    probe_radius: float = _scene(
        0.0,
        "Radius of the sphere that touches, whose centre is the probe's position [m], up to 0.02; 0 for a point.",
        at_least=0.0,
        at_most=0.02,
    )
    friction: str = _scene(
        "dry",
        "How a simulated scene rubs: dry, rubber (a slow probe sticks and slips) or wet.",
        choices=("dry", "rubber", "wet"),
    )
    fusion: str = _scene(
        "full",
        "What the pose of the fixture is estimated from: full (images and touches), image, contact or none.",
        choices=("full", "image", "contact", "none"),
    )
    displacement: float = _scene(
        0.02,
        "Largest distance of a simulated fixture from where it is believed at first [m], up to 0.05.",
        at_least=0.0,
        at_most=0.05,
    )
    turn: float = _scene(
        0.175,
        "Largest angle of a simulated fixture from how it is believed at first [rad], up to 0.35.",
        at_least=0.0,
        at_most=0.35,
    )
    bump: float = _scene(0.0, "When the fixture is bumped [s]; 0 for never.", at_least=0.0)
    camera_delay: float = _scene(
        0.06, "Time from an image's exposure until it has been read [s], up to 1.", at_least=0.0, at_most=1.0
    )
    image_fault: str = _scene("", "KIND:BEGIN:END [s]: hand, glare, frozen or dropped images meanwhile.")
    force_ceiling: float = _safety(
        15.0,
        "Contact force that the follower never holds more than [N], up to 1000.",
        limit="force",
        above=0.0,
        at_most=1000.0,
    )
    stiffest: float = _safety(
        1e5,
        "Stiffness at which the follower takes what it has not gone through yet [N/m].",
        limit="stiffest",
        above=0.0,
    )
    most_damped: float = _safety(
        500.0,
        "Damping at which it takes the same [N s/m]; the more, the slower it goes in.",
        limit="most_damped",
        above=0.0,
    )
    largest_depth: float = _safety(
        0.05, "Depth below a felt surface to which the follower goes at most [m].", limit="depth", above=0.0
    )
    largest_speed: float = _safety(0.25, "Largest speed of the follower [m/s].", limit="speed", above=0.0)
    largest_acceleration: float = _safety(
        40.0, "Largest acceleration of the follower [m/s^2].", limit="acceleration", above=0.0
    )
    largest_jerk: float = _safety(1e5, "Largest jerk of the follower [m/s^3].", limit="jerk", above=0.0)
    return_speed: float = _safety(
        0.05,
        "Largest speed inwards on the follower's way back to commands that it did not follow [m/s].",
        limit="return_speed",
        above=0.0,
    )
    queueing_allowance: float = _safety(
        0.5, "Time on its way after which a command is stale [s], up to 10.", above=0.0, at_most=10.0
    )
    hold_after: float = _safety(
        0.05, "Time without a fresh command after which the follower holds [s].", limit="hold_after", above=0.0
    )
    unload_after: float = _safety(
        0.5,
        "Time without a fresh command after which it does what --on-silence says [s].",
        limit="unload_after",
        above=0.0,
    )
    on_silence: str = _safety(
        "unload",
        "What a follower does without commands: unload (go back until next to nothing is felt, and stay) or retreat "
        "(go out the way in).",
        choices=("unload", "retreat"),
    )
    network: str = _network(
        "",
        "A network by name, `foretouch network list`, or a file of its delays; whatever else is given here is added to "
        "what it does.",
    )
    network_start: float = _network(
        0.0, "Where in the network's delays the session begins [s].", at_least=0.0, at_most=86_400.0
    )
    position_delay: float | None = _network(
        None,
        "One-way delay of positions, leader to follower [s], 0 to 10; without it 0.08, the paper's, and 0 where a "
        "network is given.",
        **DELAY,
    )
    force_delay: float | None = _network(
        None,
        "One-way delay of models and telemetry, follower to leader [s], 0 to 10; without it 0.3, the paper's, and 0 "
        "where a network is given.",
        owner="leader",
        **DELAY,
    )
    jitter: float = _network(0.0, "Largest change of either delay, up or down [s], 0 to 10.")
    loss: float = _network(0.0, "Ratio of messages lost in either direction, 0 to 1.")
    burst: float = _network(
        1.0, "Mean length of a burst of losses [messages], 1 to 10,000; with 1 each is lost by itself."
    )
    reorder: float = _network(0.0, "Ratio of messages that later ones overtake, 0 to 1.")
    duplicate: float = _network(0.0, "Ratio of messages that come twice, 0 to 1.")
    stall: float = _network(
        0.0, "Length of one stall in every 10 s, at whose end all that was held comes at once [s], 0 to 10."
    )
    outage: float = _network(0.0, "Length of one outage in every 10 s, in either direction [s], 0 to 10.")
    budget: float = _network(
        0.0,
        f"Bytes that each side may send in a second, at least {LEAST_BUDGET:g}, so that only what can be felt is sent; "
        "0 for all messages as they are.",
        at_least=0.0,
    )
    protection: str = _network(
        "parity",
        "What a side with a budget sends against loss: none, where nothing is lost; parity, by which one lost piece of "
        "a model comes back; strong, where a fifth is lost.",
        choices=PROTECTIONS,
    )


SETTINGS: dict[str, Setting] = {one.name: one.metadata["setting"] for one in dataclasses.fields(Declared)}
"""What is declared of each setting, by name, in the order of the help."""

DEFAULTS: dict[str, Any] = {one.name: one.default for one in dataclasses.fields(Declared)}

KINDS: dict[str, str] = {one.name: str(one.type) for one in dataclasses.fields(Declared)}
"""How each is annotated: ``"str"``, ``"int"``, ``"float"`` or ``"float | None"``; objects have a text here."""

FAULTS = ("jitter", "loss", "burst", "reorder", "duplicate", "stall", "outage", "network", "network_start")
"""What the network does to messages in either direction, beside its delays."""

PAPER_DELAYS = {"position_delay": 0.08, "force_delay": 0.3}
"""Delays of the paper [s], which are taken where neither they nor a network are given."""

GROUPS: tuple[str, ...] = tuple(dict.fromkeys(one.group for one in SETTINGS.values()))
"""Headings of the help."""

LEADER_SETTINGS = frozenset(name for name, one in SETTINGS.items() if one.owner == "leader")
"""Settings that are the leader's: what a follower that was started by hand has for them means nothing."""

SAFETY_LIMITS: dict[str, str] = {one.limit: name for name, one in SETTINGS.items() if one.limit}
"""Fields of `foretouch.session.safety.safety.SafetyLimits`, and the settings that they are."""


def documented(settings: type[Kind]) -> type[Kind]:
    """Add to the docstring of a class of settings what is declared of each."""
    lines = (f"    {name}: {one.sentence} Default: ``{getattr(settings, name)!r}``." for name, one in SETTINGS.items())
    settings.__doc__ = "\n".join((inspect.getdoc(settings) or "", "", "Args:", *lines))
    return settings

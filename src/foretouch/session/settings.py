"""The settings of a session: frozen, checked, the same for both runners and both sides."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass, field
from numbers import Integral

from foretouch.devices import GRIPS, HARDWARE_OPERATORS, OPERATORS, DeviceSpecification
from foretouch.devices.device import COUNT_FORCE, LEAST_DAMPING
from foretouch.errors import ArgumentTypeError, SettingError, UnknownNameError
from foretouch.errors.checks import NUMBER, require
from foretouch.identification import DEFAULT_ESTIMATORS, ESTIMATORS, Estimator, make_estimator
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.link import Faults
from foretouch.link.faults import LONGEST_DELAY
from foretouch.plugins import load_plugin, plugin_names
from foretouch.quantities import Brief, Frame
from foretouch.robot import MATERIALS, SensorFault, material_names
from foretouch.vision import ImageFault

SAMPLE_PERIOD = 1e-3
"""Of both loops [s]."""

RATE = 1.0 / SAMPLE_PERIOD
"""[Hz]."""

ON_SILENCE = ("unload", "retreat")
"""What a follower does that has heard no fresh command for long."""

NO_GRIP = "none"
"""The grip of an operator whose hand the force does not move."""

SIMULATED = "simulated"
"""The robot of the package: an arm in MuJoCo that presses the settings' material."""

ROBOTS = (SIMULATED,)
"""Names of the robots in the package; others come from `foretouch.plugins`."""

BASELINES = ("none", "delayed", "delayed-tdpa")
"""What renders: models, or for comparison the delayed force, without and with a passivity controller."""

FIRST_TOUCHES = ("auto", "guarded", "follow")
"""What the follower does where it touches what the leader does not know yet; auto guards where there is a grip."""

FUSIONS = ("full", "image", "contact", "none")
"""Of what the pose of a scene's fixture is made: images and touches, one of them, or neither."""

SCALES = (0.01, 100.0)
"""Smallest and largest of either scale."""

GUARDED_FORCES = (10.0 * CONTACT_FLOOR, 15.0)
"""Least and largest force at which a guarded follower can be told to hold [N]: nearer to the least force that counts as
contact, sensor noise decides what it holds, and the surface is learnt from too little."""

SIMULATED_DAMPING, SIMULATED_DELAY = 2.0, 5e-4
"""Of the device that a simulated hand holds, where nothing else is said [N s/m, s]."""

SOFTEST = 1.0
"""A device that is held carries at least this [N/m], or there is nothing to feel."""


@dataclass(frozen=True)
class SessionSettings(Brief):
    """What is pressed, by whom, over which network, and what is identified.

    The defaults of the delays are the paper's: 80 ms for positions, 300 ms for forces. The law is not: it is
    the contact map; the paper's own law and estimator are ``model="continuous-switching"``.

    Args:
        material: Name of a material of the simulated robot.
        operator: ``"scripted"``, ``"recorded"``, ``"browser"``, ``"gamepad"``, ``"force-dimension"``, or a device of
            another package.
        model: Name of the law to identify.
        estimator: Name of the estimator; empty for the law's own, whose name then stands here.
        position_delay: One-way delay of commands [s], 0 to 10.
        force_delay: One-way delay of models and telemetry [s], 0 to 10.
        jitter: Largest change of either delay [s].
        loss: Share of messages lost, in either direction.
        outage: Length of an outage in every 10 s, in either direction [s].
        seed: Of everything random: sensors, operator, network; not negative.
        model_rate: Models a second while nothing changes [1/s].
        burst: Mean length of a burst of losses [messages]; 1 loses each by itself.
        reorder: Share of messages that later ones overtake.
        duplicate: Share of messages that come twice.
        stall: Length of a stall in every 10 s, at whose end all that was held comes at once [s].
        grip: Hand that holds the device and is moved by the force: ``"soft"``, ``"normal"``, ``"stiff"``; the
            operator's motion is then what it intends. ``"none"`` for the operator's motion itself, whatever the force.
        device_mass: Of the device at the hand [kg].
        device_damping: Viscous friction of the device [N s/m]: what it can carry of stiffness depends on it; with a
            grip, at least 1 N/m. None where nobody has stated it: 2 in a simulated hand, and in a person's the least
            that is assumed of such a device.
        device_friction: Coulomb friction of the device [N].
        device_resolution: Count of its encoder [m].
        device_delay: From reading a position until its force acts [s]; None for 0.5 ms if simulated, else a tick.
        device_watchdog: Time after which the device takes a force away that nobody has renewed [s]; 0 for never.
        largest_stiffness: Largest local stiffness that is rendered [N/m]; 0 for what the device carries.
        position_scale: Proxy's motion for the hand's, 0.01 to 100.
        force_scale: Hand's force for the model's, 0.01 to 100.
        clutch: When a hand presses its clutch [s since it met the follower], as ``START:END,START:END``; or never.
        leader_frame: ``ORIGIN,DIRECTION`` of the device: see `Frame`.
        follower_frame: ``ORIGIN,DIRECTION`` of the robot.
        first_touch: ``"guarded"``, ``"follow"``, or ``"auto"``: see `guards`.
        approach_speed: Of a guarded follower before it knows a surface [m/s].
        guarded_force: At which a guarded follower holds [N], 0.5 to 15.
        force_ceiling: Contact force that the follower never holds more than [N].
        stiffest: What the follower has not gone through yet counts as so stiff [N/m].
        most_damped: And as so damped at once [N s/m].
        largest_depth: Deepest that the follower goes below a surface that it has felt [m].
        largest_speed: Of the follower [m/s].
        largest_acceleration: Of the follower [m/s^2].
        largest_jerk: Of the follower [m/s^3].
        return_speed: At most, inwards, on the follower's way back to commands that it did not follow [m/s].
        queueing_allowance: A command that waited longer than this on its way is stale [s].
        hold_after: Time without a fresh command after which the follower holds [s].
        unload_after: And after which it does what `on_silence` says [s].
        sensor_fault: Fault of the simulated robot's sensors, as ``KIND:BEGIN:END`` in seconds; empty for none.
        on_silence: ``"unload"``: go back until next to nothing is felt, and stay; ``"retreat"``: go out the way in.
        baseline: ``"none"``, or what is rendered for comparison: ``"delayed"``, ``"delayed-tdpa"``. It has no largest
            stiffness and guards nothing.
        scene: What is touched in three dimensions: a name of `foretouch.session.spatial.SCENES`, or the file of a mesh;
            empty for a session along a line. In a scene the default law is ``"quadratic"``, which is learnt as a field
            over the surface, and the default material ``"hunt-crossley"``: what remembers a press would have to
            remember each place.
        fusion: Of what the pose of the scene's fixture is made: ``"full"``, ``"image"``, ``"contact"`` or ``"none"``.
        displacement: A simulated fixture stands at most so far from where both sides believe it at first [m].
        turn: And is turned by at most so much [rad].
        bump: When it is bumped to somewhere else [s]; 0 for never.
        camera_delay: From an image's exposure until it has been read [s].
        image_fault: Fault of the camera's images, as ``KIND:BEGIN:END`` in seconds; empty for none.
        robot: ``"simulated"``, or a robot of another package.
        calibration: File of its force sensor's calibration (`foretouch.session.steps.sensing`), read there; or empty.

    Raises:
        SettingError: A value out of range.
        ArgumentTypeError: A value of another type.
        UnknownNameError: A material, operator, robot, scene, law, estimator, grip, first touch or baseline that does
            not exist.
        PluginError: An operator, robot or estimator of another package, which cannot be imported.
    """

    material: str = "foam-measured"
    operator: str = "scripted"
    model: str = "contact-map"
    estimator: str = ""
    position_delay: float = 0.08
    force_delay: float = 0.3
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    seed: int = 0
    model_rate: float = 50.0
    burst: float = 1.0
    reorder: float = 0.0
    duplicate: float = 0.0
    stall: float = 0.0
    grip: str = NO_GRIP
    device_mass: float = 0.1
    device_damping: float | None = None
    device_friction: float = 0.1
    device_resolution: float = 1e-5
    device_delay: float | None = None
    device_watchdog: float = 0.02
    largest_stiffness: float = 0.0
    position_scale: float = 1.0
    force_scale: float = 1.0
    clutch: str = ""
    leader_frame: str = "0,1"
    follower_frame: str = "0,1"
    first_touch: str = "auto"
    approach_speed: float = 0.02
    guarded_force: float = 2.0
    force_ceiling: float = 15.0
    stiffest: float = 1e5
    most_damped: float = 500.0
    largest_depth: float = 0.05
    largest_speed: float = 0.25
    largest_acceleration: float = 40.0
    largest_jerk: float = 1e5
    return_speed: float = 0.05
    queueing_allowance: float = 0.5
    hold_after: float = 0.05
    unload_after: float = 0.5
    on_silence: str = "unload"
    sensor_fault: str = ""
    baseline: str = "none"
    scene: str = ""
    fusion: str = "full"
    displacement: float = 0.02
    turn: float = 0.175
    bump: float = 0.0
    camera_delay: float = 0.06
    image_fault: str = ""
    robot: str = SIMULATED
    calibration: str = ""
    command_faults: Faults = field(init=False, repr=False)
    return_faults: Faults = field(init=False, repr=False)
    device: DeviceSpecification = field(init=False, repr=False)
    frames: tuple[Frame, Frame] = field(init=False, repr=False)
    clutch_times: tuple[tuple[float, float], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._check_types()
        for kind, choices in (
            ("grip", (NO_GRIP, *GRIPS)),
            ("first_touch", FIRST_TOUCHES),
            ("baseline", BASELINES),
            ("on_silence", ON_SILENCE),
            ("fusion", FUSIONS),
        ):
            if getattr(self, kind) not in choices:
                raise UnknownNameError(kind.replace("_", " "), getattr(self, kind), choices)
        self._check_machines()
        if self.scene:
            self._check_scene()
        if not self.estimator:
            object.__setattr__(self, "estimator", DEFAULT_ESTIMATORS.get(self.model, ""))
        if self.estimator not in ESTIMATORS.get(self.model, ()):  # one of ours is not made here: that compiles
            make_estimator(self.model, self.estimator)
        if self.model not in ESTIMATORS:
            rule = "is the law of another package, which the other side may not have: identify and compare take it"
            raise SettingError("model", self.model, rule)
        for delay in ("position_delay", "force_delay"):
            if not 0.0 <= getattr(self, delay) <= LONGEST_DELAY:
                raise SettingError(delay, getattr(self, delay), f"must lie between 0 and {LONGEST_DELAY:g} s")
        require("seed", self.seed, at_least=0)
        require("model_rate", self.model_rate, above=0.0, at_most=RATE)
        require("position_scale", self.position_scale, at_least=SCALES[0], at_most=SCALES[1])
        require("force_scale", self.force_scale, at_least=SCALES[0], at_most=SCALES[1])
        require("approach_speed", self.approach_speed, above=0.0, at_most=0.5)
        least, most = GUARDED_FORCES
        if not least <= self.guarded_force <= most:
            why = f"sensor noise counts as contact up to {CONTACT_FLOOR:g} N and more"
            raise SettingError("guarded_force", self.guarded_force, f"must lie between {least:g} and {most:g} N: {why}")
        frames = (Frame.from_text(name, getattr(self, name)) for name in ("leader_frame", "follower_frame"))
        object.__setattr__(self, "frames", tuple(frames))
        object.__setattr__(self, "clutch_times", _clutch_times(self.clutch))
        if self.clutch_times and self.grip == NO_GRIP:
            grips = ", ".join(sorted(GRIPS))
            raise SettingError("clutch", self.clutch, f"needs a hand that presses it: choose a grip of {grips}")
        object.__setattr__(self, "device", self._device())
        if self.largest_stiffness and self.grip == NO_GRIP:
            raise SettingError("largest_stiffness", self.largest_stiffness, "is felt by a hand alone: choose a grip")
        self._check_baseline()
        if self.sensor_fault:
            SensorFault.from_text("sensor_fault", self.sensor_fault)
        for name in SAFETY_LIMITS.values():
            require(name, getattr(self, name), above=0.0)
        require("force_ceiling", self.force_ceiling, at_most=LARGEST_CEILING)
        require("queueing_allowance", self.queueing_allowance, above=0.0, at_most=10.0)
        require("unload_after", self.unload_after, at_least=self.hold_after)
        common = {name: getattr(self, name) for name in _FAULTS}
        object.__setattr__(self, "command_faults", Faults(self.position_delay, **common, seed=2 * self.seed))
        object.__setattr__(self, "return_faults", Faults(self.force_delay, **common, seed=2 * self.seed + 1))

    def operators(self) -> tuple[str, ...]:
        """Names of all operators, those of other packages too."""
        return (*OPERATORS, *HARDWARE_OPERATORS, *plugin_names("device"))

    def robots(self) -> tuple[str, ...]:
        """Names of all robots, those of other packages too."""
        return (*ROBOTS, *plugin_names("robot"))

    def _check_types(self) -> None:
        """Each setting is of the type that it is annotated with."""
        for one in dataclasses.fields(self):
            types, wanted = TYPES.get(str(one.type), ((), ""))
            if one.init and not isinstance(value := getattr(self, one.name), types):
                raise ArgumentTypeError(one.name, value, f"{wanted}; the default is {one.default!r}")

    def _check_machines(self) -> None:
        """Material, operator and robot exist; other packages are looked through only for what is not built in."""
        if self.material not in MATERIALS and self.material not in material_names():
            raise UnknownNameError("material", self.material, material_names())
        built_in = (*OPERATORS, *HARDWARE_OPERATORS)
        if self.operator not in built_in and load_plugin("device", self.operator) is None:
            raise UnknownNameError("operator", self.operator, self.operators())
        if self.robot in ROBOTS:
            return
        if load_plugin("robot", self.robot) is None:
            raise UnknownNameError("robot", self.robot, self.robots())
        if self.sensor_fault:
            rule = f"is of the simulated robot, and robot = {self.robot!r} has sensors of its own: leave it empty"
            raise SettingError("sensor_fault", self.sensor_fault, rule)

    def _check_scene(self) -> None:
        """What a session in three dimensions cannot have; its own defaults."""
        from foretouch.session.spatial.scenes import MESH_ENDINGS, SCENES

        if self.scene not in SCENES and not self.scene.lower().endswith(MESH_ENDINGS):
            raise UnknownNameError("scene", self.scene, (*SCENES, *(f"FILE{ending}" for ending in MESH_ENDINGS)))
        for name, only in (
            ("operator", ("scripted", "browser")),
            ("baseline", ("none",)),
            ("sensor_fault", ("",)),
            ("robot", ROBOTS),
        ):
            if getattr(self, name) not in only:
                rule = f"is for sessions along a line; with a scene it must be {' or '.join(map(repr, only))}"
                raise SettingError(name, getattr(self, name), rule)
        for name in ("leader_frame", "follower_frame"):
            if getattr(self, name) != "0,1":
                raise SettingError(name, getattr(self, name), "is of a line; in a scene both sides count in the world")
        for name, (of_line, of_scene) in SCENE_DEFAULTS.items():
            if getattr(self, name) == of_line:
                object.__setattr__(self, name, of_scene)
        require("displacement", self.displacement, at_least=0.0, at_most=0.05)
        require("turn", self.turn, at_least=0.0, at_most=0.35)
        require("bump", self.bump, at_least=0.0)
        require("camera_delay", self.camera_delay, at_least=0.0, at_most=1.0)
        if self.image_fault:
            ImageFault.from_text("image_fault", self.image_fault)

    def make_estimator(self) -> Estimator:
        """A fresh estimator."""
        return make_estimator(self.model, self.estimator)

    def guards(self, *, simulated: bool = True) -> bool:
        """Whether the first touch is guarded: as chosen, or by itself where a hand feels it or the robot is real.

        A baseline never says that it knows a surface, so it does not guard.

        Args:
            simulated: Whether the follower's robot is.
        """
        if self.first_touch != "auto":
            return self.first_touch == "guarded"
        return self.baseline == "none" and (self.grip != NO_GRIP or not simulated)

    def as_text(self) -> dict[str, str]:
        """The settings by name, for `Hello` messages and recordings."""
        texts = {one.name: str(getattr(self, one.name)) for one in dataclasses.fields(self) if one.init}
        return texts | {f"device_{name}": str(getattr(self.device, name)) for name in ("damping", "delay")}

    def _check_baseline(self) -> None:
        """A baseline renders no model: what is said of models would have no effect, or none that is meant."""
        if self.baseline == "none":
            return
        if self.largest_stiffness:
            rule = f"is of models, and baseline = {self.baseline!r} renders none: leave it at 0"
            raise SettingError("largest_stiffness", self.largest_stiffness, rule)
        if self.first_touch == "guarded":
            rule = f"ends when the leader knows the surface, and baseline = {self.baseline!r} never does: take follow"
            raise SettingError("first_touch", self.first_touch, rule)

    def _device(self) -> DeviceSpecification:
        """The device, once it is known that it can carry the stiffness that is asked for."""
        simulated = self.grip != NO_GRIP or self.operator in OPERATORS
        assumed, late = (SIMULATED_DAMPING, SIMULATED_DELAY) if simulated else (LEAST_DAMPING, SAMPLE_PERIOD)
        try:
            device = DeviceSpecification(
                mass=self.device_mass,
                damping=assumed if self.device_damping is None else self.device_damping,
                friction=self.device_friction,
                resolution=self.device_resolution,
                delay=late if self.device_delay is None else self.device_delay,
                watchdog=self.device_watchdog,
            )
        except SettingError as error:
            error.args = (f"device_{error}",)  # the name of the setting
            raise
        carried = device.largest_stiffness(SAMPLE_PERIOD)
        if self.grip != NO_GRIP and carried < SOFTEST:  # no encoder count is so coarse
            least = SOFTEST * (0.5 * SAMPLE_PERIOD + device.delay)
            rule = f"must be at least {least:g} N s/m with a grip: less carries no {SOFTEST:g} N/m at {RATE:g} Hz"
            raise SettingError("device_damping", device.damping, rule)
        require("largest_stiffness", self.largest_stiffness, at_least=0.0)
        if self.largest_stiffness > carried:
            if carried < device.stiffness_by_encoder:
                slow = f"{device.damping:g} N s/m of damping and {1e3 * device.delay:g} ms of delay at {RATE:g} Hz"
                why = f"{slow} carries at most b / (T / 2 + d)"
            else:
                coarse = f"{device.friction:g} N of friction and an encoder count of {device.resolution:g} m"
                why = f"{coarse} carries at most max(2 f, {COUNT_FORCE:g} N) / count"
            # In whole N/m, rounded down, so that the value we name works.
            rule = f"a device with {why} = {math.floor(carried)} N/m; 0 takes that"
            raise SettingError("largest_stiffness", self.largest_stiffness, rule)
        return device


TYPES: dict[str, tuple[tuple[type, ...], str]] = {
    "str": ((str,), "a text"),
    "int": ((Integral,), "a whole number"),
    "float": (NUMBER, "a number"),
    "float | None": ((*NUMBER, type(None)), "a number, or None"),
}
"""What a setting that is annotated so may be, and how that is called."""

SCENE_DEFAULTS = {"model": ("contact-map", "quadratic"), "material": ("foam-measured", "hunt-crossley")}
"""What stands for the default of a session along a line where there is a scene."""

SAFETY_LIMITS = {
    "force": "force_ceiling",
    "stiffest": "stiffest",
    "most_damped": "most_damped",
    "depth": "largest_depth",
    "speed": "largest_speed",
    "acceleration": "largest_acceleration",
    "jerk": "largest_jerk",
    "return_speed": "return_speed",
    "hold_after": "hold_after",
    "unload_after": "unload_after",
}
"""Fields of `foretouch.session.safety.safety.SafetyLimits`, and the settings that they are."""

LARGEST_CEILING = 1000.0
"""[N]."""

_FAULTS = ("jitter", "loss", "outage", "burst", "reorder", "duplicate", "stall")


def _clutch_times(text: str) -> tuple[tuple[float, float], ...]:
    """Intervals from a text such as ``5:8,12:13``."""
    try:
        pairs = [tuple(map(float, part.split(":"))) for part in text.split(",") if part]
        times = tuple((start, end) for start, end in pairs)
        ends = [moment for pair in times for moment in pair]
        if not all(0.0 <= earlier < later < math.inf for earlier, later in itertools.pairwise(ends)):
            raise ValueError
    except ValueError:
        rule = "must be START:END,START:END in seconds, each finite and later than the one before"
        raise SettingError("clutch", text, rule) from None
    return times

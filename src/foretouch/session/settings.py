"""The settings of a session: frozen, checked, the same for both runners and both sides."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral

from foretouch.devices import GRIPS, HARDWARE_OPERATORS, OPERATORS, DeviceSpecification
from foretouch.devices.device import COUNT_FORCE, LEAST_DAMPING
from foretouch.errors import ArgumentTypeError, InputError, SettingError, UnknownNameError
from foretouch.errors.checks import NUMBER, require
from foretouch.identification import DEFAULT_ESTIMATORS, ESTIMATORS, ContactMap, Estimator, make_estimator
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.link import Faults, network_trace
from foretouch.messages import Choice, Settings
from foretouch.models import ContactMapModel
from foretouch.plugins import load_plugin, plugin_names
from foretouch.quantities import Brief, Frame, SpatialFrame, shortest
from foretouch.robot import MATERIALS, SensorFault, make_material, material_names
from foretouch.session.workspace import WORKSPACES, Line
from foretouch.settings import (
    ARM_ENDING,
    ARMS,
    DEFAULTS,
    FAULTS,
    KINDS,
    LEAST_BUDGET,
    NO_GRIP,
    PAPER_DELAYS,
    SETTINGS,
    SIMULATED,
    Declared,
    documented,
    is_simulated,
)
from foretouch.vision import ImageFault

SAMPLE_PERIOD = 1e-3
"""Period of both loops [s]."""

RATE = 1.0 / SAMPLE_PERIOD  # Rate of both loops [Hz]
ROBOTS = (SIMULATED, *ARMS)  # Names of the robots in the package; others come from `foretouch.plugins`

GUARDED_FORCES = (10.0 * CONTACT_FLOOR, 15.0)
"""Least and largest holding force of a guarded follower [N]: nearer to the least force that counts as contact, sensor
noise decides the force held, and the surface is learnt from too little."""

SIMULATED_DAMPING, SIMULATED_DELAY = 2.0, 5e-4
"""Default damping and delay of the device that a simulated hand holds [N s/m, s]."""

NO_FRAME = Frame()  # Frame of a machine that counts as the session does
SOFTEST = 1.0  # A device that is held carries at least this [N/m], or there is nothing to feel


@documented
@dataclass(frozen=True)
class SessionSettings(Declared, Brief):
    """What is pressed, by whom, over which network, and what is identified.

    The defaults of the delays are the paper's: 80 ms for positions, 300 ms for forces; with a ``network``, which has
    delays of its own, they are 0. The law is not: it is the contact map; the paper's own law and estimator are
    ``model="continuous-switching"``.

    What has parts is an object: ``clutch=[(5, 8), (12, 13)]``, ``leader_frame=Frame(0.1, -1)``,
    ``sensor_fault=SensorFault("stuck", 5, 8)``, in a scene ``leader_frame=SpatialFrame((0.4, 0, 0))``; None says that
    there is none of it, here and where the default is ``''``, ``'none'`` or 0. The texts of the command line, of
    recordings and of messages are taken too.

    Raises:
        SettingError: A value out of range.
        ArgumentTypeError: A value of another type.
        UnknownNameError: A material, operator, robot, scene, law, estimator, grip, first touch or baseline that does
            not exist.
        PluginError: An operator, robot or estimator of another package, which cannot be imported.
    """

    # Declared as the texts that the command line takes, and kept as what they say.
    clutch: Sequence[tuple[float, float]] = ()  # type: ignore[assignment]
    leader_frame: Frame | SpatialFrame = NO_FRAME  # type: ignore[assignment]
    follower_frame: Frame | SpatialFrame = NO_FRAME  # type: ignore[assignment]
    sensor_fault: SensorFault | None = None  # type: ignore[assignment]
    image_fault: ImageFault | None = None  # type: ignore[assignment]
    position_delay: float = None  # type: ignore[assignment]
    force_delay: float = None  # type: ignore[assignment]
    command_faults: Faults = field(init=False, repr=False)
    return_faults: Faults = field(init=False, repr=False)
    device: DeviceSpecification = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._read_texts()
        self._check_types()
        if self.network:
            network_trace(self.network)  # refused here where it is none
        for name, delay in PAPER_DELAYS.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, 0.0 if self.network else delay)
        for name, default in self.workspace.unchosen:
            if not getattr(self, name):
                object.__setattr__(self, name, default)
        for name, declared in SETTINGS.items():
            choices = (NO_GRIP, *GRIPS) if name == "grip" else declared.choices
            if choices and getattr(self, name) not in choices:
                raise UnknownNameError(name.replace("_", " "), getattr(self, name), choices)
        self._check_machines()
        for name in ("leader_frame", "follower_frame"):
            frame = getattr(self, name)
            if frame != NO_FRAME and not isinstance(frame, self.workspace.frame):
                raise SettingError(name, str(frame), self.workspace.frames)
        self.workspace.check(self)
        if not self.estimator:
            object.__setattr__(self, "estimator", DEFAULT_ESTIMATORS.get(self.model, ""))
        if self.estimator not in ESTIMATORS.get(self.model, ()):  # one of ours is not made here: that compiles
            make_estimator(self.model, self.estimator)
        if self.remembered:
            ContactMapModel.from_text(self.remembered)
        if self.model not in ESTIMATORS:
            rule = "is the law of another package, which the other side may not have: identify and predict take it"
            raise SettingError("model", self.model, rule)
        for name, declared in SETTINGS.items():
            if declared.bounds:
                require(name, getattr(self, name), **declared.bounds)
        least, most = GUARDED_FORCES
        if not least <= self.guarded_force <= most:
            why = f"sensor noise counts as contact up to {CONTACT_FLOOR:g} N and more"
            raise SettingError("guarded_force", self.guarded_force, f"must lie between {least:g} and {most:g} N: {why}")
        if self.clutch and self.grip == NO_GRIP:
            grips = ", ".join(sorted(GRIPS))
            raise SettingError("clutch", _text(self.clutch), f"needs a hand that presses it: choose a grip of {grips}")
        object.__setattr__(self, "device", self._device())
        if self.largest_stiffness and self.grip == NO_GRIP:
            raise SettingError("largest_stiffness", self.largest_stiffness, "is felt by a hand alone: choose a grip")
        self._check_baseline()
        if self.budget:
            require("budget", self.budget, at_least=LEAST_BUDGET)
        elif self.protection != type(self).protection:
            raise SettingError("protection", self.protection, "is of a thin link: give a budget, too")
        require("unload_after", self.unload_after, at_least=self.hold_after)
        common = {name: getattr(self, name) for name in FAULTS}
        object.__setattr__(self, "command_faults", Faults(self.position_delay, **common, seed=2 * self.seed))
        object.__setattr__(self, "return_faults", Faults(self.force_delay, **common, seed=2 * self.seed + 1))

    @property
    def workspace(self) -> Line:
        """What the session is made of, along a line or in a scene; everybody else asks this."""
        return WORKSPACES[bool(self.scene)]

    def operators(self) -> tuple[str, ...]:
        """Names of all operators, those of other packages too."""
        return (*OPERATORS, *HARDWARE_OPERATORS, *plugin_names("device"))

    def robots(self) -> tuple[str, ...]:
        """Names of all robots, those of other packages too."""
        return (*ROBOTS, *plugin_names("robot"))

    def _read_texts(self) -> None:
        """Turn settings that have parts into objects."""
        object.__setattr__(self, "clutch", _intervals(self.clutch))
        for name, kinds in OBJECTS.items():
            given, absent = getattr(self, name), getattr(type(self), name)
            if given is None or (given == "" and absent is None):
                object.__setattr__(self, name, absent)
            elif isinstance(given, str):
                kind = kinds[-1 if given.count(",") > self.workspace.commas else 0]
                object.__setattr__(self, name, kind.from_text(name, given))
            elif not isinstance(given, kinds):
                wanted = " or ".join(kind.__name__ for kind in kinds)
                raise ArgumentTypeError(name, given, f"a {wanted}; the default is {absent!r}")
        if self.image_fault and self.image_fault != ImageFault.from_text("image_fault", str(self.image_fault)):
            rule = "must have its place and size by default: a recording could not say others"
            raise SettingError("image_fault", str(self.image_fault), rule)

    def _check_types(self) -> None:
        """Check that each setting is of its annotated type, and replace None by the object for none."""
        for name, kind in KINDS.items():
            value, default = getattr(self, name), DEFAULTS[name]
            types, wanted = TYPES[kind]
            if name in OBJECTS or name == "clutch":
                continue
            if value is None and kind != "int" and default in ABSENT:
                object.__setattr__(self, name, default)
            elif not isinstance(value, types):
                raise ArgumentTypeError(name, value, f"{wanted}; the default is {default!r}")

    def _check_machines(self) -> None:
        """Material, operator and robot exist; other packages are looked through only for what is not built in."""
        if self.material not in MATERIALS and self.material not in material_names():
            raise UnknownNameError("material", self.material, material_names())
        built_in = (*OPERATORS, *HARDWARE_OPERATORS)
        if self.operator not in built_in and load_plugin("device", self.operator) is None:
            raise UnknownNameError("operator", self.operator, self.operators())
        if is_simulated(self.robot):
            return
        if load_plugin("robot", self.robot) is None:
            raise UnknownNameError("robot", self.robot, (*self.robots(), f"FILE{ARM_ENDING}"))
        if self.sensor_fault:
            rule = f"is of the simulated robot, and robot = {self.robot!r} has sensors of its own: leave it empty"
            raise SettingError("sensor_fault", str(self.sensor_fault), rule)

    def make_estimator(self) -> Estimator:
        """A fresh estimator, which begins with what is remembered of the material."""
        estimator = make_estimator(self.model, self.estimator)
        if self.remembered and isinstance(estimator, ContactMap):
            estimator.recall(ContactMapModel.from_text(self.remembered))
        return estimator

    def guards(self, *, simulated: bool = True) -> bool:
        """Whether the first touch is guarded: as chosen, or by itself where a hand feels it or the robot is real.

        A baseline never reports a known surface, so it does not guard.

        Args:
            simulated: Whether the follower's robot is.
        """
        if self.first_touch != "auto":
            return self.first_touch == "guarded"
        return self.baseline == "none" and (self.grip != NO_GRIP or not simulated)

    def as_text(self) -> dict[str, str]:
        """The settings by name, for `Hello` messages and recordings."""
        texts = {name: _text(getattr(self, name)) for name in SETTINGS}
        return texts | {f"device_{name}": str(getattr(self.device, name)) for name in ("damping", "delay")}

    def _check_baseline(self) -> None:
        """A baseline renders no model: settings of models would have no effect, or an unintended one."""
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
                pulls=self.grip != NO_GRIP,
            )
        except SettingError as error:
            error.args = (f"device_{error}",)  # the name of the setting
            raise
        carried = device.largest_stiffness(SAMPLE_PERIOD)
        if self.grip != NO_GRIP and carried < SOFTEST:  # no encoder count is so coarse
            least = SOFTEST * (0.5 * SAMPLE_PERIOD + device.delay)
            rule = f"must be at least {least:g} N s/m with a grip: less carries no {SOFTEST:g} N/m at {RATE:g} Hz"
            raise SettingError("device_damping", device.damping, rule)
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

ABSENT = ("", "none", 0.0)  # Defaults that stand for nothing, for which None may be given

OBJECTS: dict[str, tuple[type[Frame | SpatialFrame | SensorFault | ImageFault], ...]] = {
    "leader_frame": (Frame, SpatialFrame),
    "follower_frame": (Frame, SpatialFrame),
    "sensor_fault": (SensorFault,),
    "image_fault": (ImageFault,),
}
"""Settings that are objects with a text of their own."""


def _text(value: object) -> str:
    """A setting as the command line takes it."""
    if isinstance(value, tuple):
        return ",".join(f"{shortest(start)}:{shortest(end)}" for start, end in value)
    return "" if value is None else str(value)


def _intervals(given: str | Sequence[tuple[float, float]] | None) -> tuple[tuple[float, float], ...]:
    """Pairs of times, or a text such as ``5:8,12:13``."""
    try:
        pairs = [part.split(":") for part in given.split(",") if part] if isinstance(given, str) else given or ()
        times = tuple((float(start), float(end)) for start, end in pairs)
        ends = [moment for pair in times for moment in pair]
        if not all(0.0 <= earlier < later < math.inf for earlier, later in itertools.pairwise(ends)):
            raise ValueError
    except (TypeError, ValueError):
        rule = "must be START:END,START:END in seconds, each finite and later than the one before"
        raise SettingError("clutch", given if isinstance(given, str) else repr(given), rule) from None
    return times


def shadow_settings(settings: SessionSettings) -> SessionSettings:
    """The settings of a shadow, which has nobody's hand: no commands, force, clutch, scales or frame of the leader."""
    return replace(
        settings,
        position_delay=0.0,
        grip=NO_GRIP,
        clutch=(),
        largest_stiffness=0.0,
        position_scale=1.0,
        force_scale=1.0,
        leader_frame=Frame(),
        first_touch="follow",
        baseline="none",
    )


def choose(settings: SessionSettings, choice: Choice) -> SessionSettings:
    """Settings with the console's choice applied, whose "" change nothing; errors where other settings forbid it."""
    named = {name: getattr(choice, name) for name in ("material", "operator", "grip")}
    chosen = replace(settings, **{name: value for name, value in named.items() if value})
    make_material(chosen.material)
    return chosen


def with_faults(settings: SessionSettings, faults: Settings) -> SessionSettings:
    """Settings with the delays and faults set at a console since, unless other settings forbid them."""
    names = ("position_delay", "force_delay", "jitter", "loss", "outage")
    try:
        return replace(settings, **{name: getattr(faults, name) for name in names})
    except InputError:
        return settings

"""The settings of a session: frozen, checked, the same for both runners and both sides."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass, field

from foretouch.devices import GRIPS, OPERATORS, DeviceSpecification
from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import DEFAULT_ESTIMATORS, Estimator, make_estimator
from foretouch.link import Faults
from foretouch.models.checks import require
from foretouch.quantities import Frame

__all__ = ["BASELINES", "FIRST_TOUCHES", "NO_GRIP", "SAMPLE_PERIOD", "SessionSettings"]

SAMPLE_PERIOD = 1e-3
"""Of both loops [s]."""

NO_GRIP = "none"
"""The grip of an operator whose hand the force does not move."""

BASELINES = ("none", "delayed", "delayed-tdpa")
"""What renders: models, or for comparison the delayed force, without and with a passivity controller."""

FIRST_TOUCHES = ("auto", "guarded", "follow")
"""What the follower does where it touches what the leader does not know yet; auto guards where there is a grip."""


@dataclass(frozen=True)
class SessionSettings:
    """What is pressed, by whom, over which network, and what is identified.

    The defaults of the delays are the paper's: 80 ms for positions, 300 ms for forces. The law is not: it is
    the contact map; the paper's own law and estimator are ``model="continuous-switching"``.

    Args:
        material: Name of a material of the simulated robot.
        operator: ``"scripted"``, ``"recorded"`` or ``"browser"``.
        model: Name of the law to identify.
        estimator: Name of the estimator; empty for the law's own, whose name then stands here.
        position_delay: One-way delay of commands [s].
        force_delay: One-way delay of models and telemetry [s].
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
        device_damping: Viscous friction of the device [N s/m]: what it can carry of stiffness depends on it.
        device_friction: Coulomb friction of the device [N].
        device_resolution: Count of its encoder [m].
        largest_stiffness: Largest local stiffness that is rendered [N/m]; 0 for what the device carries.
        position_scale: Proxy's motion for the hand's.
        force_scale: Hand's force for the model's.
        clutch: When a hand presses its clutch, in seconds since it met the follower, as ``START:END,START:END``; empty
            for never.
        leader_frame: ``ORIGIN,DIRECTION`` of the device: see `Frame`.
        follower_frame: ``ORIGIN,DIRECTION`` of the robot.
        first_touch: ``"guarded"``, ``"follow"``, or ``"auto"``: see `guards`.
        approach_speed: Of a guarded follower before it knows a surface [m/s].
        guarded_force: At which a guarded follower holds [N].
        baseline: ``"none"``, or what is rendered for comparison: ``"delayed"``, ``"delayed-tdpa"``.

    Raises:
        SettingError: A value out of range.
        UnknownNameError: An operator, law, estimator, grip, first touch or baseline that does not exist.
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
    device_damping: float = 2.0
    device_friction: float = 0.1
    device_resolution: float = 1e-5
    largest_stiffness: float = 0.0
    position_scale: float = 1.0
    force_scale: float = 1.0
    clutch: str = ""
    leader_frame: str = "0,1"
    follower_frame: str = "0,1"
    first_touch: str = "auto"
    approach_speed: float = 0.02
    guarded_force: float = 2.0
    baseline: str = "none"
    command_faults: Faults = field(init=False, repr=False)
    return_faults: Faults = field(init=False, repr=False)
    device: DeviceSpecification = field(init=False, repr=False)
    frames: tuple[Frame, Frame] = field(init=False, repr=False)
    clutch_times: tuple[tuple[float, float], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for kind, choices in (
            ("operator", OPERATORS),
            ("grip", (NO_GRIP, *GRIPS)),
            ("first_touch", FIRST_TOUCHES),
            ("baseline", BASELINES),
        ):
            if getattr(self, kind) not in choices:
                raise UnknownNameError(kind.replace("_", " "), getattr(self, kind), choices)
        if not self.estimator:
            object.__setattr__(self, "estimator", DEFAULT_ESTIMATORS.get(self.model, ""))
        make_estimator(self.model, self.estimator)
        require("position_delay", self.position_delay, at_least=0.0)
        require("force_delay", self.force_delay, at_least=0.0)
        require("seed", self.seed, at_least=0)
        require("model_rate", self.model_rate, above=0.0, at_most=1.0 / SAMPLE_PERIOD)
        require("position_scale", self.position_scale, above=0.0, at_most=LARGEST_SCALE)
        require("force_scale", self.force_scale, above=0.0, at_most=LARGEST_SCALE)
        require("approach_speed", self.approach_speed, above=0.0, at_most=0.5)
        require("guarded_force", self.guarded_force, above=0.0, at_most=LARGEST_GUARDED_FORCE)
        object.__setattr__(self, "frames", (self._frame("leader_frame"), self._frame("follower_frame")))
        object.__setattr__(self, "clutch_times", _clutch_times(self.clutch))
        if self.clutch_times and self.grip == NO_GRIP:
            grips = ", ".join(sorted(GRIPS))
            raise SettingError("clutch", self.clutch, f"needs a hand that presses it: choose a grip of {grips}")
        object.__setattr__(self, "device", self._device())
        if self.largest_stiffness and self.grip == NO_GRIP:
            raise SettingError("largest_stiffness", self.largest_stiffness, "is felt by a hand alone: choose a grip")
        common = {name: getattr(self, name) for name in _FAULTS}
        object.__setattr__(self, "command_faults", Faults(self.position_delay, **common, seed=2 * self.seed))
        object.__setattr__(self, "return_faults", Faults(self.force_delay, **common, seed=2 * self.seed + 1))

    def make_estimator(self) -> Estimator:
        """A fresh estimator."""
        return make_estimator(self.model, self.estimator)

    def guards(self, *, simulated: bool = True) -> bool:
        """Whether the first touch is guarded: as chosen, or by itself where a hand feels it or the robot is real.

        A baseline never says that it knows a surface, so it guards only if told to.

        Args:
            simulated: Whether the follower's robot is.
        """
        if self.first_touch != "auto":
            return self.first_touch == "guarded"
        return self.baseline == "none" and (self.grip != NO_GRIP or not simulated)

    def as_text(self) -> dict[str, str]:
        """The settings by name, for `Hello` messages and recordings."""
        return {one.name: str(getattr(self, one.name)) for one in dataclasses.fields(self) if one.init}

    def _frame(self, name: str) -> Frame:
        return Frame.from_text(name, getattr(self, name))

    def _device(self) -> DeviceSpecification:
        """The device, once it is known that it can carry the stiffness that is asked for."""
        try:
            device = DeviceSpecification(
                mass=self.device_mass,
                damping=self.device_damping,
                friction=self.device_friction,
                resolution=self.device_resolution,
            )
        except SettingError as error:
            error.args = (f"device_{error}",)  # the name of the setting
            raise
        carried = device.largest_stiffness(SAMPLE_PERIOD)
        if self.grip != NO_GRIP and not carried > 0.0:
            rule = f"must be above 0 with a grip: each N s/m carries {2.0 / SAMPLE_PERIOD:g} N/m, and none carries none"
            raise SettingError("device_damping", self.device_damping, rule)
        if not 0.0 <= self.largest_stiffness <= carried:
            rule = (
                f"a device with {self.device_damping:g} N s/m of damping at {1.0 / SAMPLE_PERIOD:g} Hz carries at most "
                f"2 b / T = {carried:g} N/m; 0 takes that"
            )
            raise SettingError("largest_stiffness", self.largest_stiffness, rule)
        return device


LARGEST_SCALE = 100.0
LARGEST_GUARDED_FORCE = 15.0
_FAULTS = ("jitter", "loss", "outage", "burst", "reorder", "duplicate", "stall")


def _clutch_times(text: str) -> tuple[tuple[float, float], ...]:
    """Intervals from a text such as ``5:8,12:13``."""
    try:
        pairs = [tuple(map(float, part.split(":"))) for part in text.split(",") if part]
        times = tuple((start, end) for start, end in pairs)
        ends = [moment for pair in times for moment in pair]
        if not all(0.0 <= earlier < later for earlier, later in itertools.pairwise(ends)):
            raise ValueError
    except ValueError:
        raise SettingError(
            "clutch", text, "must be START:END,START:END in seconds, each later than the one before"
        ) from None
    return times

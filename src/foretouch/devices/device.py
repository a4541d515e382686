"""What a device is: where the operator's hand is, what it is given to feel, and how stiff that may be by its build.

Motion between two positions is smooth here.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from foretouch.errors.checks import require

COUNT_FORCE = 0.1  # Largest change of force by one count of the encoder on a device without friction [N]

LEAST_DAMPING = 0.1
"""Damping assumed for a device that a person feels where none is stated [N s/m]. No measurement of a product: a
twentieth of what the simulated device has, so that a stiffness that is rendered by it is small at first."""

LONGEST_DELAY = 1e-3
"""A tick [s]. A force that comes later than the next position is read belongs to a loop nearer to the device."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSpecification:
    r"""A force-feedback device along its one axis.

    `damping` is what the passivity condition counts: the damping that is there between the samples too, by the bearings
    or by an analogue loop of the drive (electrical damping, Mehling et al.). What a program makes of sampled positions
    is not part of it.

    It has no default: it decides how stiff a wall may be. `delay` is counted from the reading of a position until the
    force that is computed from it acts: the device's own input and output, and the computing between (`foretouch
    doctor` measures that part). `watchdog` is the device's own: how long it goes on giving a force that is not renewed.

    The other defaults are a desktop device, not one product. Its force limit is of the order of Novint's
    Falcon (8 N) and of the SensAble Phantom (6 N), as the device files of CHAI3D give them, which also advise at most
    3000 and 1000 N/m for these; `largest_stiffness` gives 2000 N/m for 2 N s/m and 0.5 ms at 1 kHz. Inertia,
    friction and encoder count could not be checked against data sheets; 0.05 to 0.3 kg, 0.05 to 1 N and 1 to 60 um is
    what such devices span. Bare mechanisms have less viscous damping than 2 N s/m, which therefore asks for damping by
    the drive. Diolaiti et al. show that many devices work beyond the passivity condition thanks to their dry friction;
    here it is not relied on.

    Args:
        damping: b [N s/m], 0 to 1000.
        mass: Moving mass at the handle [kg], 0.001 to 10.
        friction: Coulomb friction [N], 0 to 100; stiction is as large.
        force_limit: Largest force [N] that it gives, above 0, at most 1000.
        resolution: One encoder count [m], 0 (none) to 0.001.
        delay: d [s], 0 to 0.001; without a value one tick, the longest.
        watchdog: [s], 0.002 to 10, or 0 for none.
        pulls: Whether it can draw the hand in, as what sticks does. One that does not say so gets no force below zero.

    Raises:
        SettingError: A number out of range.

    References:
        Colgate and Schenkel (1997), Passivity of a class of sampled-data systems: application to haptic interfaces,
        Journal of Robotic Systems 14(1). Mehling, Colgate and Peshkin (2005), Increasing the impedance range of a
        haptic display by adding electrical damping, World Haptics Conference. Diolaiti, Niemeyer, Barbagli and
        Salisbury (2006), Stability of haptic rendering: discretization, quantization, time delay, and Coulomb effects,
        IEEE Transactions on Robotics 22(2). Abbott and Okamura (2005), Effects of position quantization and sampling
        rate on virtual-wall passivity, IEEE Transactions on Robotics 21(5).
    """

    damping: float
    mass: float = 0.1
    friction: float = 0.1
    force_limit: float = 10.0
    resolution: float = 1e-5
    delay: float = LONGEST_DELAY
    watchdog: float = 0.0
    pulls: bool = False

    def __post_init__(self) -> None:
        require("mass", self.mass, at_least=1e-3, at_most=10.0)
        require("damping", self.damping, at_least=0.0, at_most=1000.0)
        require("friction", self.friction, at_least=0.0, at_most=100.0)
        require("force_limit", self.force_limit, above=0.0, at_most=1000.0)
        require("resolution", self.resolution, at_least=0.0, at_most=1e-3)
        require("delay", self.delay, at_least=0.0, at_most=LONGEST_DELAY)
        if self.watchdog != 0.0:
            require("watchdog", self.watchdog, at_least=0.002, at_most=10.0)

    def largest_stiffness(self, sample_period: float, rendered_damping: float = 0.0) -> float:
        r"""The stiffest spring [N/m] that the device renders passively, with any hand.

        .. math:: K = \min\left(\frac{b - |B|}{T / 2 + d}, \frac{\max(2 f, 0.1\,\mathrm{N})}{\Delta}\right)

        The first for a force held from sample to sample and a velocity that is the difference of two positions
        (Colgate and Schenkel 1997: :math:`b > K T / 2 + |B|`; with a delay Diolaiti et al. 2006:
        :math:`b > K (T / 2 + d)`); 0 where the damping B alone is too much. The second for
        an encoder whose count :math:`\Delta` is not 0: up to 2 f per count the Coulomb friction f takes what rounding
        gives (Abbott and Okamura 2005); `COUNT_FORCE` per count is allowed whatever the friction.

        Args:
            sample_period: T [s], positive.
            rendered_damping: B [N s/m], of either sign.

        Raises:
            SettingError: `sample_period` not positive, or a damping that is no number.
        """
        require("sample_period", sample_period, above=0.0)
        require("rendered_damping", rendered_damping)
        by_damping = max((self.damping - abs(rendered_damping)) / (0.5 * sample_period + self.delay), 0.0)
        return min(by_damping, self.stiffness_by_encoder)

    @property
    def stiffness_by_encoder(self) -> float:
        """What the encoder alone would allow [N/m], infinite without one: see `largest_stiffness`."""
        return max(2.0 * self.friction, COUNT_FORCE) / self.resolution if self.resolution > 0.0 else math.inf


PEAK_SPEED_RATIO = 1.875  # Peak speed of a minimum-jerk move over its mean speed


def minimum_jerk(fraction: float) -> float:
    r"""Fraction of the distance covered after a fraction of the time.

    .. math:: s = 10 \tau^3 - 15 \tau^4 + 6 \tau^5

    Velocity and acceleration are zero at both ends.

    Args:
        fraction: tau [-]; what lies outside 0 to 1 counts as the nearer end.

    References:
        Flash and Hogan (1985), The coordination of arm movements, Journal of Neuroscience 5(7).
    """
    tau = 0.0 if fraction < 0.0 else 1.0 if fraction > 1.0 else fraction
    return tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0))


class Quintic(NamedTuple):
    """Coefficients of c0 + c1 t + ... + c5 t^5 [m], t [s] from the start of the move."""

    c0: float
    c1: float
    c2: float
    c3: float
    c4: float
    c5: float

    def __call__(self, t: float) -> float:
        """Position [m] at t [s]."""
        return self.c0 + t * (self.c1 + t * (self.c2 + t * (self.c3 + t * (self.c4 + t * self.c5))))


def quintic_move(start: Sequence[float], end: Sequence[float], duration: float) -> Quintic:
    """The polynomial of fifth degree that meets position, velocity and acceleration at both ends.

    Args:
        start: Position [m], velocity [m/s] and acceleration [m/s^2] at t = 0.
        end: The same at t = `duration`.
        duration: Length of the move [s], positive.
    """
    x0, v0, a0 = start
    x1, v1, a1 = end
    # What is left to do beyond carrying on with the acceleration of the start, scaled to unit time.
    dx = x1 - x0 - duration * (v0 + 0.5 * a0 * duration)
    dv = (v1 - v0 - a0 * duration) * duration
    da = (a1 - a0) * duration**2
    return Quintic(
        x0,
        v0,
        0.5 * a0,
        (10.0 * dx - 4.0 * dv + 0.5 * da) / duration**3,
        (-15.0 * dx + 7.0 * dv - da) / duration**4,
        (6.0 * dx - 3.0 * dv + 0.5 * da) / duration**5,
    )


class Tracker:
    r"""Follows a goal r smoothly: critically damped, exact for every step, without overshoot, late by 2 / omega.

    .. math:: \ddot x = \omega^2 (r - x) - 2 \omega \dot x

    An aim goes towards the goal in a straight line at a bounded speed; the position x follows the aim as a constant r.

    Args:
        rate: omega [1/s].

    Attributes:
        aim: The aim [m].
        position: x [m].
        velocity: Its velocity [m/s].
    """

    __slots__ = ("_rate", "aim", "position", "velocity")

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self.aim = self.position = self.velocity = 0.0

    def update(self, goal: float, speed: float, period: float) -> float:
        """One step of this time [s] towards a goal [m], with an aim of at most this speed [m/s]; the position [m]."""
        left, step = goal - self.aim, speed * period
        self.aim = goal if abs(left) <= step else self.aim + math.copysign(step, left)
        error = self.position - self.aim
        pull = self.velocity + self._rate * error
        decay = math.exp(-self._rate * period)
        self.position = self.aim + (error + pull * period) * decay
        self.velocity = (self.velocity - self._rate * pull * period) * decay
        return self.position


FORCE_LIMIT = 10.0  # Largest force [N] that a device without a limit of its own accepts


class AnyDevice(ABC):
    """An operator's handle, along a line or in space. It reads no clock: the caller says what time it is.

    Times never go back; a time that does counts as the newest one. The first time that `read` is given is the start.

    Attributes:
        name: Name of the device, one of `foretouch.devices.OPERATORS` for those in the package.
        closed_loop: Whether the rendered force moves the hand. Where it is False, the motion would have been the same
            without any force, and reports say so.
        real_time: Whether a person's hand moves it: then it needs a session in real time.
    """

    __slots__ = ()
    name: ClassVar[str]
    closed_loop: ClassVar[bool]
    real_time: ClassVar[bool] = False

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet, so that a simulated session can begin; True where a device does not say."""
        return True

    @property
    def specification(self) -> DeviceSpecification | None:
        """What the device can render; None where nothing is felt (open loop)."""
        return None

    @property
    def clutched(self) -> bool:
        """Whether the operator holds the clutch at the newest `read`: the hand moves, the probe is to stay."""
        return False

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Give no force any more and give back what the device holds; a second call does nothing."""


class Device(AnyDevice):
    """A handle along a line."""

    __slots__ = ()

    @abstractmethod
    def read(self, now_ns: int) -> float:
        """Position of the hand [m] in the probe's frame: 0 = start in free air, growing into the material."""

    @abstractmethod
    def render(self, force: float) -> float:
        """Give the hand a force [N], and return what it was really given after the device's own limits.

        Below zero it draws the hand in; a device whose specification does not say that it pulls gives none then.
        A force that is not a number is rendered as none.
        """

    @property
    def intention(self) -> float:
        """Where the hand wants to be [m] at the newest `read`; NaN where unknown."""
        return math.nan

    @property
    def exact_position(self) -> float:
        """Where the hand is [m] at the newest `read`, without the encoder's counts; NaN where unknown."""
        return math.nan


class Operator(Device):
    """An open loop whose motion depends on the time since the first `read` alone: no hand feels its force."""

    __slots__ = ("_start_ns", "_time")
    closed_loop: ClassVar[bool] = False

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._time = 0.0

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self._start_ns is None

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]."""
        if self._start_ns is None:
            self._start_ns = now_ns
        self._time = max(self._time, (now_ns - self._start_ns) * 1e-9)
        return self.position_at(self._time)

    @abstractmethod
    def position_at(self, time: float) -> float:
        """Position of the hand [m] at a time since the first `read` [s], which never goes back."""

    def render(self, force: float) -> float:
        """Limit the force [N] as every device does; no hand feels it."""
        return limit_force(force)


def limit_force(force: float, limit: float = FORCE_LIMIT, *, pulls: bool = False) -> float:
    """The force [N] within 0, or minus `limit` for what pulls, and `limit` [N]; 0 where it is not a number."""
    if force > 0.0:
        return force if force < limit else limit
    if not (pulls and force < 0.0):
        return 0.0
    return force if force > -limit else -limit

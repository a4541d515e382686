"""A hand that holds a force-feedback device, how it holds it, and the force that a simulated device really gives.

That force is as late as the device is, and lasts no longer than its watchdog lets it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from foretouch.devices.device import Device, DeviceSpecification, limit_force
from foretouch.errors import SettingError
from foretouch.errors.checks import require

INTENDED_FORCE = 3.0
"""Force with which a hand intends to press [N]: it aims deeper by this over the stiffness of its grip."""


@dataclass(frozen=True, slots=True)
class Grip:
    r"""A hand as a mass that a spring and a damper hold to where it wants to be.

    .. math:: F = k (x_d - x) + b (\dot x_d - \dot x)

    Args:
        mass: Mass of the hand that moves with the device [kg], 0 to 10.
        damping: b [N s/m], 0 to 1000.
        stiffness: k [N/m], 0 to 100,000.

    Raises:
        SettingError: A number out of range.
    """

    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        require("mass", self.mass, at_least=0.0, at_most=10.0)
        require("damping", self.damping, at_least=0.0, at_most=1000.0)
        require("stiffness", self.stiffness, at_least=0.0, at_most=1e5)

    def holds(self, specification: DeviceSpecification) -> tuple[NDArray[np.void], Callable[..., Any]]:
        """A hand with this grip, at rest at 0, that holds a device, and what moves it: see `hand_kernel`."""
        # Imported here: it brings a compiler along, which open-loop operators do without.
        from foretouch.devices.hand_kernel import Held, move

        held = Held.new(
            mass=self.mass + specification.mass,
            damping=self.damping + specification.damping,
            hand_damping=self.damping,
            stiffness=self.stiffness,
            friction=specification.friction,
        )
        return held, move


GRIPS = MappingProxyType(
    {
        "soft": Grip(mass=0.10, damping=4.0, stiffness=150.0),
        "normal": Grip(mass=0.15, damping=8.0, stiffness=400.0),
        "stiff": Grip(mass=0.25, damping=18.0, stiffness=1000.0),
    }
)
"""Hands that hold a stylus loosely, as one works, and tightly.

The numbers are chosen within what was published, not taken from one table. What is known:

- A mass, a spring and a damper describe fingers and hands up to some 20 to 30 Hz; stiffness and damping rise steadily
  with the grip force, the inertia does not (Hasser and Cutkosky 2002, nine subjects). Fu and Cavusoglu (2012) fitted
  models that depend on the grip force to 15 subjects who held a stylus by 1 to 3 N; Speich, Shao and Goldfarb (2005)
  add a spring and a damper in series, and find that in some cases they gain little.
- One published fit for an arm that holds a handle is 0.554 kg, 6.45 N s/m and 135 N/m (van Beek et al. 2015, their
  figure 3): a damping ratio of 0.37. `GRIPS` have 0.52 to 0.57 without the device. A stylus moves less of the arm.
- Other ranges were not checked against the papers: a fingertip (Hajian and Howe 1997) some 200 to 1500 N/m, 1 to 10 N
  s/m and some grams; the wrist with a stylus (Kuchenbecker, Park and Niemeyer 2003) some 100 to 1000 N/m, rising with
  the grip; hand and forearm 0.05 to 1 kg. The three grips span 150 to 1000 N/m and 4 to 18 N s/m.

References:
    Hasser and Cutkosky (2002), System identification of the human hand grasping a haptic knob, Symposium on Haptic
    Interfaces for Virtual Environment and Teleoperator Systems. Fu and Cavusoglu (2012), Human-arm-and-hand-dynamic
    model with variability analyses for a stylus-based haptic interface, IEEE Transactions on Systems, Man, and
    Cybernetics B 42(6). Speich, Shao and Goldfarb (2005), Modeling the human hand as it interacts with a
    telemanipulation system, Mechatronics 15. van Beek, Bergmann Tiest, Mugge and Kappers (2015), Haptic perception
    of force magnitude and its relation to postural arm dynamics in 3D, Scientific Reports 5:18004. Hajian and Howe
    (1997), Identification of the mechanical impedance at the human finger tip, Journal of Biomechanical Engineering
    119(1). Kuchenbecker, Park and Niemeyer (2003), Characterizing the human wrist for improved haptic interaction,
    ASME International Mechanical Engineering Congress.
"""


F = TypeVar("F")


class HeldForce(Generic[F]):
    """A force that is held from one `render` to the next.

    It begins to act a delay after it was rendered, and ends where the watchdog's time has passed since it began.

    Args:
        none: No force.
        delay: Time from rendering until it acts [s], not negative.
        watchdog: [s]; 0 for none.
    """

    __slots__ = ("_delay_ns", "_due", "_ends_ns", "_force", "_none", "_watchdog_ns")

    def __init__(self, none: F, delay: float, watchdog: float) -> None:
        self._none = self._force = none
        self._delay_ns = round(delay * 1e9)
        self._watchdog_ns = round(watchdog * 1e9) if watchdog > 0.0 else 0
        self._ends_ns = 0
        self._due: deque[tuple[int, F]] = deque()

    def render(self, force: F, now_ns: int) -> None:
        """Give this force from a delay after now [ns] on."""
        begins = now_ns + self._delay_ns
        if self._due and self._due[-1][0] >= begins:
            self._due.pop()
        self._due.append((begins, force))

    def over(self, begin_ns: int, end_ns: int) -> Iterator[tuple[float, F]]:
        """The forces between two times that never go back: each with how long it acts [s]."""
        due, time_ns = self._due, begin_ns
        while time_ns < end_ns:
            while due and due[0][0] <= time_ns:
                begins, self._force = due.popleft()
                self._ends_ns = begins + self._watchdog_ns
            acts = not self._watchdog_ns or time_ns < self._ends_ns
            until_ns = min(end_ns, due[0][0]) if due else end_ns
            if acts and self._watchdog_ns:
                until_ns = min(until_ns, self._ends_ns)
            yield (until_ns - time_ns) * 1e-9, self._force if acts else self._none
            time_ns = until_ns


LONGEST_GAP = 1.0  # Upper limit to which a gap between two ticks is cut [s]: what lasts longer is no late tick


class Held:
    """A device of one axis or three, held by a hand that wants something and may hold the clutch.

    Args:
        intention: What the hand wants, an operator that feels nothing itself.
        specification: The device, the same along each axis.
        clutch: Intervals with the clutch held: (start, end) in seconds since the first `read`, start included, end not.

    Attributes:
        intention_device: The operator whose intention this hand has.

    Raises:
        SettingError: An intention that feels something itself, or a time of the clutch that is negative or ends before
            it starts.
    """

    name: ClassVar[str]
    closed_loop = True

    def __init__(self, intention: Any, specification: DeviceSpecification, clutch: Sequence[tuple[float, float]]):
        if intention.closed_loop:
            raise SettingError("intention", intention.name, "must be an operator that feels nothing itself (open loop)")
        for start, end in clutch:
            if not 0.0 <= start < end < math.inf:
                raise SettingError("clutch", (start, end), "must be 0 <= start < end, in seconds from the first tick")
        self.name = intention.name  # type: ignore[misc]  # of the class elsewhere; a hand has its operator's
        self.intention_device, self._specification, self._clutch = intention, specification, tuple(clutch)
        self._start_ns: int | None = None
        self._now_ns = 0

    @property
    def specification(self) -> DeviceSpecification:
        """The device that the hand holds."""
        return self._specification

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self._start_ns is None and bool(self.intention_device.fresh)

    @property
    def clutched(self) -> bool:
        """Whether the hand holds the clutch at the newest `read`, by its own times or as the intention says."""
        if self._clutch and self._start_ns is not None:
            time = (self._now_ns - self._start_ns) * 1e-9
            if any(start <= time < end for start, end in self._clutch):
                return True
        return bool(self.intention_device.clutched)

    def _counted(self, position: Any) -> float:
        """A position [m] as the encoder shows it, in whole counts."""
        count, value = self._specification.resolution, float(position[0])
        return count * math.floor(value / count + 0.5) if count > 0.0 else value


class Hand(Held, Device):
    r"""A hand with mass, damping and stiffness holds a device; the rendered force moves both.

    .. math::

        (m_h + m_d) \ddot x = k (x_d - x) + b (\dot x_d - \dot x) - b_d \dot x - F_C \operatorname{sign} \dot x - f

    x grows into the material. x_d is where the hand wants to be: what another device, open loop, gives, in a straight
    line from tick to tick. f is the rendered force, held from one `render` to the next (sample and hold), a delay of
    the device later, and no longer than its watchdog lets it (`HeldForce`); a positive one pushes the
    hand out. At rest the device sticks, without any motion at all, until what pulls exceeds F_C. Between starts, stops
    and ticks the motion is solved by its power series, to all digits.

    The first `read` finds the hand at rest at its intention. A gap between ticks of more than 1 s counts as 1 s, with
    the whole way of the intention in it: the hand is simulated late, never in jerks.

    Args:
        intention: What the hand wants, an open-loop operator; its own `render` is not called.
        grip: How the hand holds the device, for example one of `GRIPS`.
        specification: The device.
        clutch: Intervals with the clutch held: (start, end) in seconds since the first `read`, start included, end not.

    Raises: As of `Held`.
    """

    def __init__(
        self,
        intention: Device,
        grip: Grip,
        specification: DeviceSpecification,
        clutch: Sequence[tuple[float, float]] = (),
    ) -> None:
        super().__init__(intention, specification, clutch)
        self._held, self._move = grip.holds(specification)
        self._position = self._held["position"]
        self._aim = math.nan
        self._forces = HeldForce(0.0, specification.delay, specification.watchdog)

    @property
    def intention(self) -> float:
        """Where the hand wants to be [m], at the newest `read`; NaN before the first."""
        return self._aim

    @property
    def exact_position(self) -> float:
        """Where the hand is [m] at the newest `read`, not rounded; NaN before the first."""
        return math.nan if self._start_ns is None else float(self._position[0])

    @property
    def exact_velocity(self) -> float:
        """Its velocity [m/s]."""
        return math.nan if self._start_ns is None else float(self._held[0].velocity)

    def read(self, now_ns: int) -> float:
        """Position of the hand [m] as the encoder shows it, in whole counts."""
        aim = self.intention_device.read(now_ns)
        if self._start_ns is None:
            self._start_ns = self._now_ns = now_ns
            self._aim = self._position[0] = aim
        elif now_ns > self._now_ns:
            period = min((now_ns - self._now_ns) * 1e-9, LONGEST_GAP)
            speed = (aim - self._aim) / period
            for time, force in self._forces.over(now_ns - round(period * 1e9), now_ns):
                self._move(self._held, self._aim, speed, force, time)
                self._aim += speed * time
            self._aim, self._now_ns = aim, now_ns
        return self._counted(self._position)

    def render(self, force: float) -> float:
        """Hold a force [N] from a delay after the newest `read` on; returns what is given, at most the limit."""
        given = limit_force(force, self._specification.force_limit, pulls=self._specification.pulls)
        self._forces.render(given, self._now_ns)
        return given

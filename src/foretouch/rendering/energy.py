"""The energy account of a whole session, along a line and in space, and the force ceiling that keeps it in bounds."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Generic, Protocol, Self, TypeVar, runtime_checkable

from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector, add, dot, norm, scaled


@runtime_checkable
class RenderingDevice(Protocol):
    """Properties of the hand's device that rendering needs."""

    @property
    def resolution(self) -> float:
        """One count of the encoder [m]."""

    @property
    def delay(self) -> float:
        """Time from reading a position until the force computed from it acts [s]."""

    @property
    def watchdog(self) -> float:
        """Time after which the device ends a force that is not renewed [s]; 0 for never."""

    @property
    def damping(self) -> float:
        """Damping B [N s/m]."""

    @property
    def force_limit(self) -> float:
        """Largest force [N]."""

    @property
    def stiffness_by_encoder(self) -> float:
        """Stiffness that one count of the encoder allows [N/m], infinite without one."""

    def largest_stiffness(self, sample_period: float) -> float:
        """The stiffest spring that it renders passively at this period [s], by its damping and its encoder [N/m]."""


SMALLEST_COUNT = 1e-6
"""Least count of an encoder [m]."""

WAY_BACK = 1e-3
"""Fraction of the largest force that is not cut while half a count of the encoder pays for it: with it, an operator who
presses again builds the force up by doubling it in each step; ten times less takes some three steps more."""

FASTEST_HAND = 2.0
"""Largest speed of a hand on a handle [m/s]: motion beyond it in a tick is an encoder's fault and must not widen the
bound. Twice what a device may show by its conformance check."""

SAMPLE_PERIOD = 1e-3
"""Default period of a loop [s]."""


V = TypeVar("V")


class Ledger(ABC, Generic[V]):
    r"""Books the work of a force that is held from tick to tick, and limits the force that may be held.

    Debts are kept over contacts, surplus is forgiven at the loss of each: dissipation in one press pays for nothing in
    the next, and excess output is owed until it is paid. So the account is never above the work W of the whole session,
    the integral of force times motion:

    .. math::
        E_{k+1} &= E_k + \left(\delta f_{k-1} + (1 - \delta) f_k\right) (x_{k+1} - x_k), \quad \delta = d / T \\
        f_k &\le (1 + 2 \delta) F - \delta f_{k-1} + E_k / (D - \Delta / 2) \quad \text{while } E_k < 0 \\
        W_k &\ge E_k + L_k, \quad E_k \ge -(1 + 2 \delta) F D \quad \text{always}

    A force acts from the delay d after its position was read until d after the next one was; in a tick the hand is
    taken to move evenly, and with d = 0 the sum is the work itself. F is the largest force of the session so far, and D
    the longest motion of the hand in one tick of the nominal period T plus one count of the encoder, Delta.

    A tick that comes late, positions that are missing and steps that no hand makes count in E for T alone, evenly. The
    rest of their work is L, whose surplus is forgiven at once and whose debt is kept: it widens no bound, closes no
    ceiling and is reported beside them. In each tick without a position, too, the former force acts until d. A device's
    watchdog ends a force after its time, and none acts until the next one does.

    The bound is the effect of sampling and delay on a spring without loss: pressed and let go at speed v, it gives back
    K x v (T + 2 d) more than was put in. `docs/stability.md` has the proof.

    Args:
        resolution: One count of the encoder [m], not negative; less than a micrometre counts as one.
        sample_period: Period T, positive [s].
        delay: Delay d, 0 to T [s].
        watchdog: Time after which the device ends a force that is not renewed [s], T or more; 0 for no end.

    Attributes:
        energy: E [J].
        late_energy: L, never positive [J].
        force: Force f, held now [N].
        largest_force: F [N].
        largest_step: D [m].
    """

    __slots__ = (
        "_acted", "_before", "_count", "_delay", "_elapsed", "_ends", "_lasts", "_late", "_newest_step", "_period",
        "_position", "_share", "energy", "force", "largest_force", "largest_step", "late_energy",
    )  # fmt: skip

    axes: int
    nothing: V

    def __init__(
        self,
        resolution: float = 0.0,
        *,
        sample_period: float = SAMPLE_PERIOD,
        delay: float = 0.0,
        watchdog: float = 0.0,
    ) -> None:
        require("resolution", resolution, at_least=0.0)
        require("sample_period", sample_period, above=0.0)
        require("delay", delay, at_least=0.0, at_most=sample_period)
        require("watchdog", watchdog, at_least=0.0)
        self._count = max(resolution, SMALLEST_COUNT) * math.sqrt(self.axes)
        self._period = sample_period
        self._delay = self._lasts = delay  # time for which the former force acts in the coming tick
        self._share = delay / sample_period
        self._ends = delay + (watchdog or math.inf)  # of a force, after its tick began
        self._elapsed = 0.0
        self._newest_step = 0.0
        self._position: V | None = None
        self.force = self._acted = self._late = self._before = self.nothing
        self.energy = self.late_energy = 0.0
        self.largest_force = 0.0
        self.largest_step = self._count

    @classmethod
    def of(cls, device: RenderingDevice | None, sample_period: float = SAMPLE_PERIOD) -> Self:
        """The account of a device at this period [s]; None is a hand without a device."""
        if device is None:
            return cls(sample_period=sample_period)
        return cls(device.resolution, sample_period=sample_period, delay=device.delay, watchdog=device.watchdog)

    def close(self) -> None:
        """End the contact: forgive what the hand has put in beyond what it was given. A debt stays."""
        if self.energy > 0.0:
            self.energy = 0.0

    @property
    def bound(self) -> float:
        """(1 + 2 delta) F D [J]: the account is never further below zero."""
        return (1.0 + 2.0 * self._share) * self.largest_force * self.largest_step

    def bound_with(self, force: float) -> float:
        """The bound [J] as it will be once this force [N] has been held over a tick like the newest."""
        largest, step = self.largest_force, self.largest_step
        step = self._newest_step if self._newest_step > step else step
        return (1.0 + 2.0 * self._share) * (force if force > largest else largest) * step

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N], after the present one, which still acts for d."""
        held = self.size(self.force)
        if self._elapsed > 0.0:  # the position of the hand is unknown
            return held
        if self.energy >= 0.0:
            return math.inf
        largest, delta = self.largest_force, self._share
        reach = self.largest_step - 0.5 * self._count
        ceiling = (1.0 + 2.0 * delta) * largest - delta * held + self.energy / reach
        if ceiling >= WAY_BACK * largest:
            return ceiling
        left = (self.energy + self.bound) / self.largest_step - delta * held  # of the half count, as a force
        least = min(WAY_BACK * largest, left / (1.0 + delta))
        return max(ceiling, least, 0.0)

    def observe(self, position: V, period: float = 0.0) -> None:
        """Book the work of the held force up to the hand's present position.

        Args:
            position: Position of the hand [m]; one that is not finite is missing.
            period: Time since the previous tick [s]; an invalid one counts as the nominal one.
        """
        mixed, held = self.mixed, self.force
        if not self._elapsed > 0.0:
            self._acted = mixed(self._before, self._lasts / self._period, held, 1.0 - self._share)
        former, newest = self._pass(period)
        self._late = mixed(self._late, 1.0, mixed(self._before, former, held, newest), 1.0)
        self._before = held
        if not self.size(position) < math.inf:
            return
        before, self._position = self._position, position
        elapsed, self._elapsed = max(self._elapsed, self._period), 0.0
        late, self._late = self._late, self.nothing
        if before is None:
            return
        moved = mixed(position, 1.0, before, -1.0)
        distance, acted = self.size(moved), self.work(self._acted, moved)
        even, longest = self._period / elapsed, FASTEST_HAND * self._period
        part = even if not even * distance > longest else longest / distance  # of the motion, which E takes
        self.energy += part * acted
        owed = self.late_energy + ((even - part) * acted + 1.0 / elapsed * self.work(late, moved))
        self.late_energy = owed if owed < 0.0 else 0.0
        self._newest_step = step = part * distance + self._count
        if step > self.largest_step and self._acted != self.nothing:
            self.largest_step = step

    def _pass(self, period: float) -> tuple[float, float]:
        """Let a tick pass [s]: how long the former and the newest force acted beyond their nominal part [s]."""
        period = period if 0.0 < period < math.inf else self._period
        until = period if period < self._ends else self._ends
        if self._elapsed > 0.0:
            late = min(self._lasts, period), max(until - self._delay, 0.0)
        else:
            late = 0.0, max(until - self._period, 0.0)
        self._lasts = min(self._delay, self._ends - until)
        self._elapsed += period
        return late

    @staticmethod
    @abstractmethod
    def size(value: V, /) -> float:
        """Size of a force or a motion."""

    @staticmethod
    @abstractmethod
    def mixed(first: V, weight: float, second: V, other: float) -> V:
        """Weighted sum of two forces or positions."""

    @staticmethod
    @abstractmethod
    def work(force: V, moved: V) -> float:
        """Work of the hand on a force that it moved against."""


class EnergyAccount(Ledger[float]):
    """The account along a line: see `Ledger`; x grows into the material, and f pushes out.

    References:
        Hannaford and Ryu (2002), Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and
        Automation 18(1): observer and controller, whose damping is replaced here by a ceiling that needs no velocity.
        The bound is derived here.
    """

    __slots__ = ()
    axes, nothing = 1, 0.0
    size = staticmethod(abs)

    @staticmethod
    def mixed(first: float, weight: float, second: float, other: float) -> float:
        """Weighted sum."""
        return weight * first + other * second

    @staticmethod
    def work(force: float, moved: float) -> float:
        """Force times motion."""
        return force * moved

    def hold(self, force: float) -> None:
        """Hold this force from now on [N], 0 or more."""
        self.force = force
        if force > self.largest_force:
            self.largest_force = force


class SpatialEnergyAccount(Ledger[Vector]):
    r"""The hand's work on the rendered force, in all directions, and the ceiling that keeps it in bounds.

    As `EnergyAccount`, whose proof holds for vectors too: a tick takes the force times its step at most. D is the
    longest step and one count of the encoders in all three directions; force and motion count in space, the force as it
    pushes the hand. A force along the normal of a curved surface, held for a tick, turns late: in a hollow of radius R
    it gives out :math:`|f|\,|\Delta x|^2 / 2 R` a tick more than it takes. An account along the normal cannot see that;
    this does.
    """

    __slots__ = ()
    axes, nothing = 3, (0.0, 0.0, 0.0)
    size = staticmethod(norm)

    @staticmethod
    def mixed(first: Vector, weight: float, second: Vector, other: float) -> Vector:
        """Weighted sum."""
        return add(scaled(first, weight), scaled(second, other))

    @staticmethod
    def work(force: Vector, moved: Vector) -> float:
        """Negative inner product: the force pushes the hand."""
        return -dot(force, moved)

    def hold(self, force: Vector) -> Vector:
        """Hold a force [N] from now on, cut to the ceiling; returns the held force."""
        size = norm(force)
        if not size < math.inf:
            force, size = self.nothing, 0.0
        ceiling = self.ceiling
        if size > ceiling:
            force, size = self.mixed(force, ceiling / size, self.nothing, 0.0), ceiling
        self.force = force
        self.largest_force = max(self.largest_force, size)
        return force

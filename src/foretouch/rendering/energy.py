"""The energy account of a whole session, and the ceiling on force that keeps it in bounds.

With it stands what rendering has to know of a device and of any account of its energy.
"""

from __future__ import annotations

import math
from typing import Protocol, Self, runtime_checkable

from foretouch.errors.checks import require


class AccountedDevice(Protocol):
    """What an account has to know of the device that the hand holds."""

    @property
    def resolution(self) -> float:
        """One count of the encoder [m]."""

    @property
    def delay(self) -> float:
        """From reading a position until the force computed from it acts [s]."""

    @property
    def watchdog(self) -> float:
        """Time after which the device takes a force away by itself that nobody has renewed [s]; 0 for never."""


@runtime_checkable
class RenderingDevice(AccountedDevice, Protocol):
    """What rendering has to know of a device that the hand feels."""

    @property
    def damping(self) -> float:
        """B [N s/m]."""

    @property
    def force_limit(self) -> float:
        """[N]."""

    @property
    def stiffness_by_encoder(self) -> float:
        """What one count of the encoder allows [N/m], infinite without one."""

    def largest_stiffness(self, sample_period: float) -> float:
        """The stiffest spring that it renders passively at this period [s], by its damping and its encoder [N/m]."""


class RenderingAccount(Protocol):
    """What rendering has to know of the energy: `EnergyAccount`, or what it is in space (`NormalAccount`)."""

    @property
    def energy(self) -> float:
        """E [J]."""

    @property
    def late_energy(self) -> float:
        """L [J]."""

    @property
    def bound(self) -> float:
        """Of E [J]."""

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""

    def bound_with(self, force: float) -> float:
        """The bound [J] once this force [N] has been held."""

    def close(self) -> None:
        """Contact is lost."""

    def observe(self, position: float, period: float) -> None:
        """Book the work up to where the hand is now [m], this time [s] after the tick before."""

    def hold(self, force: float) -> None:
        """From now on this force acts [N]."""


SMALLEST_COUNT = 1e-6
"""[m]."""

WAY_BACK = 1e-3
"""Part of the largest force that is not cut, as long as half a count of the encoder pays for it: with it, whoever
presses again builds the force up anew, doubling it in each step; ten times less takes some three steps more."""

FASTEST_HAND = 2.0
"""No hand that holds a handle is faster [m/s]: what a position goes beyond that in a tick is no motion but an encoder's
fault, and not to widen the bound. Twice what a device may show by its conformance check."""

SAMPLE_PERIOD = 1e-3
"""Period of a loop where nothing else is said [s]."""


class Ledger:
    r"""What is booked of a force that is held from tick to tick, and how much more of it may be held.

    Debts are kept over contacts, surplus is forgiven at the loss of each: what was dissipated in one press pays for
    nothing in the next, and what was given out too much is owed until it is paid. So the account is never above the
    work W of the whole session, the integral of force times motion:

    .. math::
        E_{k+1} &= E_k + \left(\delta f_{k-1} + (1 - \delta) f_k\right) (x_{k+1} - x_k), \quad \delta = d / T \\
        f_k &\le (1 + 2 \delta) F - \delta f_{k-1} + E_k / (D - \Delta / 2) \quad \text{while } E_k < 0 \\
        W_k &\ge E_k + L_k, \quad E_k \ge -(1 + 2 \delta) F D \quad \text{always}

    A force acts from the delay d after its position was read until d after the next one was; in a tick the hand is
    taken to move evenly, and with d = 0 the sum is the work itself. F is the largest force of the session so far, and D
    the farthest that the hand went in one tick of the nominal period T and one count of the encoder, Delta, more.

    A tick that comes late, positions that are missing and steps that no hand makes count in E for T alone, evenly. The
    rest of their work is L, whose surplus is forgiven at once and whose debt is kept: it widens no bound and closes no
    ceiling, and is told beside them. In each tick without a position, too, the former force acts until d. A device's
    watchdog ends a force when it has acted for so long, and nothing acts until the next one does.

    The bound is what sampling and delay make of a spring that takes nothing: pressed and let go at speed v, it gives
    back K x v (T + 2 d) more than was put in. `docs/stability.md` has the proof.

    Args:
        resolution: One count of the encoder [m], not negative; less than a micrometre counts as one.
        sample_period: T, positive [s].
        delay: d, 0 to T [s].
        watchdog: Time for which the device gives a force that nobody renews [s], T or more; 0 for no end.

    Attributes:
        energy: E [J].
        late_energy: L, never positive [J].
        largest_force: F [N].
        largest_step: D [m].
    """

    __slots__ = (
        "_count",
        "_delay",
        "_elapsed",
        "_ends",
        "_lasts",
        "_newest_step",
        "_period",
        "_share",
        "energy",
        "largest_force",
        "largest_step",
        "late_energy",
    )

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
        self._count = max(resolution, SMALLEST_COUNT)
        self._period = sample_period
        self._delay = self._lasts = delay  # the former force acts for so long in the tick that is to pass
        self._share = delay / sample_period
        self._ends = delay + (watchdog or math.inf)  # of a force, after its tick began
        self._elapsed = 0.0
        self._newest_step = 0.0
        self.energy = self.late_energy = 0.0
        self.largest_force = 0.0
        self.largest_step = self._count

    @classmethod
    def of(cls, device: AccountedDevice | None, sample_period: float = SAMPLE_PERIOD) -> Self:
        """The account of a device at this period [s]; of none, of a hand without a device."""
        if device is None:
            return cls(sample_period=sample_period)
        return cls(device.resolution, sample_period=sample_period, delay=device.delay, watchdog=device.watchdog)

    def close(self) -> None:
        """Contact is lost: forgive what the hand has put in beyond what it was given. A debt stays."""
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

    def _ceiling(self, held: float) -> float:
        """Largest force that may be held now [N], after this one, which still acts for d [N]."""
        if self._elapsed > 0.0:  # nobody knows where the hand is
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

    def _pass(self, period: float) -> tuple[float, float]:
        """Let a tick pass that took this time [s].

        Returns:
            For how long the former force and the newest acted in it beyond what the nominal tick has of them [s].
        """
        period = period if 0.0 < period < math.inf else self._period
        until = period if period < self._ends else self._ends
        if self._elapsed > 0.0:
            late = min(self._lasts, period), max(until - self._delay, 0.0)
        else:
            late = 0.0, max(until - self._period, 0.0)
        self._lasts = min(self._delay, self._ends - until)
        self._elapsed += period
        return late

    def _arrive(self, distance: float) -> tuple[float, float, float]:
        """At a new position, so far from the one before [m]: the parts of that way by which each force is booked.

        Returns:
            For the nominal force, in E and in L [-], and for what acted beyond the nominal period, in L [1/s].
        """
        elapsed, self._elapsed = max(self._elapsed, self._period), 0.0
        even, longest = self._period / elapsed, FASTEST_HAND * self._period
        part = even if not even * distance > longest else longest / distance
        return part, even - part, 1.0 / elapsed

    def _book(self, work: float, late: float, step: float, *, pressed: bool) -> None:
        """Book a nominal step [m], its work and the late one [J]."""
        self.energy += work
        owed = self.late_energy + late
        self.late_energy = owed if owed < 0.0 else 0.0
        self._newest_step = step = step + self._count
        if pressed and step > self.largest_step:
            self.largest_step = step


class EnergyAccount(Ledger):
    """The account along a line: see `Ledger`; x grows into the material, and f pushes out.

    Args:
        resolution: See `Ledger`, as for the others.
        sample_period: T [s].
        delay: d [s].
        watchdog: [s].

    Attributes:
        force: f, held now [N].

    References:
        Hannaford and Ryu (2002), Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and
        Automation 18(1): observer and controller, whose damping is replaced here by a ceiling that needs no velocity.
        The bound is derived here.
    """

    __slots__ = ("_acted", "_before", "_late", "_position", "force")

    def __init__(
        self,
        resolution: float = 0.0,
        *,
        sample_period: float = SAMPLE_PERIOD,
        delay: float = 0.0,
        watchdog: float = 0.0,
    ) -> None:
        super().__init__(resolution, sample_period=sample_period, delay=delay, watchdog=watchdog)
        self._position = math.nan
        self._acted = self._late = self._before = 0.0
        self.force = 0.0

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""
        return self._ceiling(self.force)

    def observe(self, position: float, period: float = 0.0) -> None:
        """Book the work of the held force up to where the hand is now.

        Args:
            position: [m]; one that is no number is missing.
            period: Since the tick before [s]; what is none counts as the nominal one.
        """
        before, held = self._before, self.force
        if not self._elapsed > 0.0:
            self._acted = self._lasts / self._period * before + (1.0 - self._share) * held
        former, newest = self._pass(period)
        self._late += former * before + newest * held
        self._before = held
        if not math.isfinite(position):
            return
        moved, self._position = position - self._position, position
        part, beyond, rate = self._arrive(abs(moved))
        acted, late, self._late = self._acted * moved, self._late * moved, 0.0
        if not math.isnan(moved):  # the first
            self._book(part * acted, beyond * acted + rate * late, part * abs(moved), pressed=self._acted > 0.0)

    def hold(self, force: float) -> None:
        """From now on this force acts [N], 0 or more."""
        self.force = force
        if force > self.largest_force:
            self.largest_force = force

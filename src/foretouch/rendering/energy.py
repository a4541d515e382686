"""The energy account of a whole session, along a line and in space, and the force ceiling that keeps it in bounds."""

from __future__ import annotations

import math
from typing import Annotated, Any, Protocol, Self, TypeAlias, runtime_checkable

from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import dot, norm


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

    @property
    def pulls(self) -> bool:
        """Whether it can draw the hand in; else no force below zero is rendered."""

    def largest_stiffness(self, sample_period: float) -> float:
        """The stiffest spring that it renders passively at this period [s], by its damping and its encoder [N/m]."""


SMALLEST_COUNT = 1e-6  # Least count of an encoder [m]

WAY_BACK = 1e-3
"""Fraction of the largest force that is not cut while half a count of the encoder pays for it: with it, an operator who
presses again builds the force up by doubling it in each step; ten times less takes some three steps more."""

FASTEST_HAND = 2.0
"""Largest speed of a hand on a handle [m/s]: motion beyond it in a tick is an encoder's fault and must not widen the
bound. Twice what a device may show by its conformance check."""

SAMPLE_PERIOD = 1e-3
"""Default period of a loop [s]."""


Numbers3: TypeAlias = Annotated[NDArray[Any], float, 3]


class Account(Record):
    """State of an account, in space; along a line the first of three numbers is all of it."""

    count: float  # of the encoders, Delta [m]
    period: float  # T [s]
    delay: float  # d [s]
    ends: float  # time from its tick on after which a force ends [s]
    lasts: float  # time for which the former force acts in the coming tick [s]
    elapsed: float  # time since the newest position [s], 0 with one
    newest_step: float  # D of the newest tick [m]
    largest_step: float  # D [m]
    position: Numbers3  # the newest [m], NaN before the first
    force: Numbers3  # f, as it pushes the hand, held now [N]
    before: Numbers3  # force held in the tick before [N]
    acted: Numbers3  # mean force that counts in E [N]
    late: Numbers3  # force beyond it times time [N s]
    energy: float  # E [J]
    late_energy: float  # L [J]
    largest_force: float  # F [N]


@compiled
def bound_of(account: Account) -> float:
    """(1 + 2 delta) F D [J]."""
    return float((1.0 + 2.0 * (account.delay / account.period)) * account.largest_force * account.largest_step)


@compiled
def bound_with(account: Account, force: float) -> float:
    """See `Ledger.bound_with`."""
    factor, step = 1.0 + 2.0 * (account.delay / account.period), max(account.newest_step, account.largest_step)
    return float(factor * max(force, account.largest_force) * step)


@compiled
def ceiling_of(account: Account) -> float:
    """Largest force that may be held now [N], after the present one, which still acts for d."""
    held = norm((account.force[0], account.force[1], account.force[2]))
    if account.elapsed > 0.0:  # the position of the hand is unknown
        return held
    if account.energy >= 0.0:
        return math.inf
    largest, delta = account.largest_force, account.delay / account.period
    reach = account.largest_step - 0.5 * account.count
    ceiling = (1.0 + 2.0 * delta) * largest - delta * held + account.energy / reach
    if ceiling >= WAY_BACK * largest:
        return ceiling
    left = (account.energy + bound_of(account)) / account.largest_step - delta * held  # of the half count, as a force
    least = min(WAY_BACK * largest, left / (1.0 + delta))
    return max(ceiling, least, 0.0)


@compiled
def _pass(account: Account, period: float) -> tuple[float, float]:
    """Let a tick pass [s]: how long the former and the newest force acted beyond their nominal part [s]."""
    period = period if 0.0 < period < math.inf else account.period
    until = min(period, account.ends)
    if account.elapsed > 0.0:
        former, newest = min(account.lasts, period), max(until - account.delay, 0.0)
    else:
        former, newest = 0.0, max(until - account.period, 0.0)
    account.lasts = min(account.delay, account.ends - until)
    account.elapsed += period
    return former, newest


@compiled
def observe(account: Account, x: float, y: float, z: float, period: float) -> None:
    """Book the work of the held force up to the hand's present position [m], this time [s] after the last tick."""
    if not account.elapsed > 0.0:
        first, second = account.lasts / account.period, 1.0 - account.delay / account.period
        for axis in range(3):
            account.acted[axis] = first * account.before[axis] + second * account.force[axis]
    former, newest = _pass(account, period)
    for axis in range(3):
        account.late[axis] += former * account.before[axis] + newest * account.force[axis]
        account.before[axis] = account.force[axis]
    if not norm((x, y, z)) < math.inf:
        return
    position, acted, late = account.position, account.acted, account.late
    moved = (x - position[0], y - position[1], z - position[2])
    position[0], position[1], position[2] = x, y, z
    elapsed, account.elapsed = max(account.elapsed, account.period), 0.0
    distance = norm(moved)
    if distance < math.inf:  # there was a position before
        even, longest = account.period / elapsed, FASTEST_HAND * account.period
        part = even if not even * distance > longest else longest / distance  # of the motion, which E takes
        work = -dot((acted[0], acted[1], acted[2]), moved)
        account.energy += part * work
        beyond = 1.0 / elapsed * -dot((late[0], late[1], late[2]), moved)
        account.late_energy = min(account.late_energy + ((even - part) * work + beyond), 0.0)
        account.newest_step = part * distance + account.count
        if acted[0] != 0.0 or acted[1] != 0.0 or acted[2] != 0.0:
            account.largest_step = max(account.largest_step, account.newest_step)
    late[0] = late[1] = late[2] = 0.0


@compiled
def hold(account: Account, x: float, y: float, z: float) -> None:
    """Hold a force [N] from now on, as it pushes the hand."""
    account.force[0], account.force[1], account.force[2] = x, y, z
    account.largest_force = max(account.largest_force, norm((x, y, z)))


@compiled
def hold_within(account: Account, force: Vector) -> Vector:
    """Hold a force [N], cut to the ceiling, and none that is not finite; returns the held force."""
    size, ceiling = norm(force), ceiling_of(account)
    if not size < math.inf:
        force = (0.0, 0.0, 0.0)
    elif size > ceiling:
        part = ceiling / size
        force = (force[0] * part, force[1] * part, force[2] * part)
    hold(account, force[0], force[1], force[2])
    return force


@compiled
def close(account: Account) -> None:
    """See `Ledger.close`."""
    account.energy = min(account.energy, 0.0)


_observe = Kernel(observe, "(Account, f8, f8, f8, f8)")
_hold = Kernel(hold, "(Account, f8, f8, f8)")
_hold_within = Kernel(hold_within, "(Account, UniTuple(f8, 3))")
_close = Kernel(close, "(Account,)")
_bound = Kernel(bound_of, "(Account,)")
_bound_with = Kernel(bound_with, "(Account, f8)")
_ceiling = Kernel(ceiling_of, "(Account,)")


class Ledger(Held):
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
        largest_force: F [N].
        largest_step: D [m].
    """

    __slots__ = ()

    axes: int
    energy: float
    late_energy: float
    largest_force: float
    largest_step: float

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
        count = max(resolution, SMALLEST_COUNT) * math.sqrt(self.axes)
        made = Account.new(
            count=count,
            period=sample_period,
            delay=delay,
            ends=delay + (watchdog or math.inf),
            lasts=delay,
            position=math.nan,
            largest_step=count,
        )
        super().__init__(made)

    @classmethod
    def of(cls, device: RenderingDevice | None, sample_period: float = SAMPLE_PERIOD) -> Self:
        """The account of a device at this period [s]; None is a hand without a device."""
        if device is None:
            return cls(sample_period=sample_period)
        return cls(device.resolution, sample_period=sample_period, delay=device.delay, watchdog=device.watchdog)

    @property
    def bound(self) -> float:
        """(1 + 2 delta) F D [J]: the account is never further below zero."""
        return _bound.entry(self.records[0])

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N], after the present one, which still acts for d."""
        return _ceiling.entry(self.records[0])

    def bound_with(self, force: float) -> float:
        """The bound [J] as it will be once this force [N] has been held over a tick like the newest."""
        return _bound_with.entry(self.records[0], force)

    def hold_force(self, force: Vector) -> None:
        """Hold a force from now on [N], as it pushes the hand; nothing is cut."""
        _hold.entry(self.records[0], *force)

    def close(self) -> None:
        """End the contact: forgive what the hand has put in beyond what it was given. A debt stays."""
        _close.entry(self.records[0])


class EnergyAccount(Ledger):
    """The account along a line: see `Ledger`; x grows into the material, and f pushes out.

    References:
        Hannaford and Ryu (2002), Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and
        Automation 18(1): observer and controller, whose damping is replaced here by a ceiling that needs no velocity.
        The bound is derived here.
    """

    __slots__ = ()
    axes = 1

    @property
    def force(self) -> float:
        """Force f, held now [N]."""
        return -float(self.records["force"][0, 0])

    def observe(self, position: float, period: float = 0.0) -> None:
        """Book the work of the held force up to the hand's present position.

        Args:
            position: Position of the hand [m]; one that is not finite is missing.
            period: Time since the previous tick [s]; an invalid one counts as the nominal one.
        """
        _observe.entry(self.records[0], position, 0.0, 0.0, period)

    def hold(self, force: float) -> None:
        """Hold this force from now on [N], below 0 where it draws the hand in."""
        self.hold_force((-force, 0.0, 0.0))


class SpatialEnergyAccount(Ledger):
    r"""The hand's work on the rendered force, in all directions, and the ceiling that keeps it in bounds.

    As `EnergyAccount`, whose proof holds for vectors too: a tick takes the force times its step at most. D is the
    longest step and one count of the encoders in all three directions; force and motion count in space, the force as it
    pushes the hand. A force along the normal of a curved surface, held for a tick, turns late: in a hollow of radius R
    it gives out :math:`|f|\,|\Delta x|^2 / 2 R` a tick more than it takes. An account along the normal cannot see that;
    this does.
    """

    __slots__ = ()
    axes = 3

    @property
    def force(self) -> Vector:
        """Force held now [N]."""
        ((x, y, z),) = self.records["force"].tolist()
        return x, y, z

    def observe(self, position: Vector, period: float = 0.0) -> None:
        """Book the work of the held force up to the hand's present position, as `EnergyAccount.observe` does."""
        _observe.entry(self.records[0], *position, period)

    def hold(self, force: Vector) -> Vector:
        """Hold a force [N] from now on, cut to the ceiling; returns the held force."""
        return _hold_within.entry(self.records[0], force)

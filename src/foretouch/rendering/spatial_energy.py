"""The energy account of a session in three dimensions."""

from __future__ import annotations

import math
from typing import TypeAlias

from foretouch.rendering.energy import SAMPLE_PERIOD, Ledger

Vector: TypeAlias = tuple[float, float, float]

NOTHING: Vector = (0.0, 0.0, 0.0)


class SpatialEnergyAccount(Ledger):
    r"""The hand's work on the rendered force, in all directions, and the ceiling that keeps it in bounds.

    As `EnergyAccount`, whose proof holds for vectors too: a tick takes the force times its step at most. D is the
    longest step and one count of the encoders in all three directions; force and motion count in space, the force as it
    pushes the hand. A force along the normal of a curved surface, held for a tick, turns late: in a hollow of radius R
    it gives out :math:`|f|\,|\Delta x|^2 / 2 R` a tick more than it takes. An account along the normal cannot see that;
    this does.

    Args:
        resolution: One count of each encoder [m], and the others as for `Ledger`.
        sample_period: Period T [s].
        delay: Delay d [s].
        watchdog: Watchdog time of the device [s].

    Attributes:
        force: Force f, held now [N].
        cut: Whether the ceiling has cut the newest force.
    """

    __slots__ = ("_acted", "_before", "_late", "_place", "cut", "force")

    def __init__(
        self,
        resolution: float = 0.0,
        *,
        sample_period: float = SAMPLE_PERIOD,
        delay: float = 0.0,
        watchdog: float = 0.0,
    ) -> None:
        super().__init__(resolution, sample_period=sample_period, delay=delay, watchdog=watchdog)
        self._count *= math.sqrt(3.0)
        self.largest_step = self._count
        self._place: Vector | None = None
        self._acted = self._late = self._before = NOTHING
        self.force: Vector = NOTHING
        self.cut = False

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""
        return self._ceiling(_size(self.force))

    def observe(self, place: Vector, period: float = 0.0) -> None:
        """Book the work of the held force up to the hand's present position.

        Args:
            place: Position of the hand [m]; one that is not finite is missing.
            period: Time since the previous tick [s]; an invalid one counts as the nominal one.
        """
        if not self._elapsed > 0.0:
            self._acted = _mixed(self._before, self._lasts / self._period, self.force, 1.0 - self._share)
        former, newest = self._pass(period)
        self._late = _mixed(self._late, 1.0, _mixed(self._before, former, self.force, newest), 1.0)
        self._before = self.force
        if not all(map(math.isfinite, place)):
            return
        before, self._place = self._place, place
        moved = NOTHING if before is None else _mixed(place, 1.0, before, -1.0)
        distance = _size(moved)
        part, beyond, rate = self._arrive(distance)
        acted, late, self._late = -_dot(self._acted, moved), -_dot(self._late, moved), NOTHING
        if before is not None:
            pressed = self._acted != NOTHING
            self._book(part * acted, beyond * acted + rate * late, part * distance, pressed=pressed)

    def hold(self, force: Vector) -> Vector:
        """Hold a force [N] from now on, cut to the ceiling; returns the held force."""
        size = _size(force)
        if not size < math.inf:
            force, size = NOTHING, 0.0
        ceiling = self.ceiling
        self.cut = size > ceiling
        if self.cut:
            force, size = _mixed(force, ceiling / size), ceiling
        self.force = force
        self.largest_force = max(self.largest_force, size)
        return force


class NormalAccount:
    """The account in space as seen by a renderer along the normal: there is one account, and it is in space.

    The caller that moves the hand in space books and holds there; so friction pays for a stiffer material that the hand
    slides onto, as pressing does along a line.

    Args:
        whole: The account in space.
    """

    __slots__ = ("_whole",)

    def __init__(self, whole: SpatialEnergyAccount) -> None:
        self._whole = whole

    @property
    def energy(self) -> float:
        """Energy E [J]."""
        return self._whole.energy

    @property
    def late_energy(self) -> float:
        """Late energy L [J]."""
        return self._whole.late_energy

    @property
    def bound(self) -> float:
        """Bound of E [J]."""
        return self._whole.bound

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""
        return self._whole.ceiling

    def bound_with(self, force: float) -> float:
        """See `Ledger.bound_with`."""
        return self._whole.bound_with(force)

    def close(self) -> None:
        """End the contact."""
        self._whole.close()

    def observe(self, position: float, period: float = 0.0) -> None:
        """Do nothing: it is booked in space."""

    def hold(self, force: float) -> None:
        """Do nothing: it is held in space."""


def _mixed(first: Vector, weight: float, second: Vector = NOTHING, other: float = 0.0) -> Vector:
    """Weighted sum of two vectors."""
    return (
        weight * first[0] + other * second[0],
        weight * first[1] + other * second[1],
        weight * first[2] + other * second[2],
    )


def _dot(first: Vector, second: Vector) -> float:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def _size(vector: Vector) -> float:
    return math.sqrt(_dot(vector, vector))

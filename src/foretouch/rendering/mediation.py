"""New models let in without a jerk, and only as far as energy pays for them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled

LARGEST_STEP = 0.08
"""Largest change of force by models in one tick [N]; people do not feel 0.1 N."""

RELEASE_TIME = 0.01  # Time constant in which the offset is removed [s]

GIVEN_BACK = 0.75
"""Fraction of the work put in by a press that it may get back although the account is beyond its bound."""

SMALLEST_OFFSET = 1e-6  # Offset below which it counts as zero [N]


class MediationState(Record):
    """State of a `Mediation`."""

    offset: float  # o [N]
    force: float  # m [N]
    step: float  # [N]
    surplus: float  # [N]
    held_back: bool
    lowest: float = math.inf  # least E of this contact [J]
    pull: float  # what pulls, as it is let in beside m: 0 or less [N]


@compiled
def mediate(
    mediation: MediationState,
    wanted: float,
    jump: float,
    period: float,
    leaving: bool,
    surplus: float,
    energy: float,
    bound: float,
    work: float,
    way: float,
) -> float:
    """See `Mediation.update`; W [J] and x [m] are of the offset less `jump` and `surplus`."""
    before = mediation.offset
    offset = before - jump - surplus
    mediation.surplus = surplus
    release = 0.0
    if offset != 0.0:
        release = abs(offset) * -math.expm1(-(period if period > 0.0 else 0.0) / RELEASE_TIME)
        release = min(release, LARGEST_STEP)
    change = -release if offset > 0.0 else release
    held_back = False
    mediation.lowest = lowest = min(mediation.lowest, energy)
    if wanted > 0.0:
        left = energy - work
        beyond = work - max(energy + bound, GIVEN_BACK * (energy - lowest))
        if beyond > 0.0 and way > 0.0:
            change = min(change, 0.0, -min(beyond / way, LARGEST_STEP))
            held_back = True
        elif offset < 0.0:
            paid = left / way if left > 0.0 and way > 0.0 and not leaving else 0.0
            held_back = paid < release
            change = paid if held_back else release
    mediation.held_back = held_back
    offset = offset + change if held_back or abs(offset) >= SMALLEST_OFFSET else 0.0
    mediation.offset = max(offset, -wanted)
    force = max(wanted + mediation.offset, 0.0)
    mediation.force = force
    without = wanted - jump - surplus + before  # without a new model and a change of offset
    mediation.step = force - without if without > 0.0 else force
    return force


@compiled
def wind_down(mediation: MediationState, rendered: float) -> None:
    """See `Mediation.wind_down`."""
    cut = mediation.force - rendered
    if mediation.offset > 0.0 and cut > 0.0:
        mediation.offset -= min(mediation.offset, cut)


_mediate = Kernel(mediate, "(MediationState, f8, f8, f8, b1, f8, f8, f8, f8, f8)")
_wind_down = Kernel(wind_down, "(MediationState, f8)")


class Mediation(Held):
    r"""Continuity first, then the change, as fast as energy allows.

    The force that is rendered is

    .. math:: m_k = \max(0,\; F_k + o_k)

    with F the force of the newest model. A model that would change the force by J in the tick in which it comes is met
    by an offset of -J, so that m goes on from where it was; then the offset goes back to zero,

    .. math:: |o_{k+1} - o_k| \le \min\left(S,\; (1 - e^{-T/\tau}) |o_k|\right)

    with S = 0.08 N and tau = 10 ms. An offset above zero, where the new model is the weaker one, always does. One below
    zero is raised only where that is paid for. With E the work that the hand has put in, less its debt from before, and
    W the work that the model, with its offset, would give back from here, E - W was dissipated so far: the tank of
    Franken et al., filled by the model's own dissipation and by the operator's work, emptied by models that store more
    than those before them. Raising the offset by d makes the material give back up to d x more until contact ends, x
    being that distance, so

    .. math:: d \le (E_k - W_k) / x

    and where more than B, a fraction of the account's bound, would come back beyond the work put in, the offset is
    lowered until it would not,

    .. math:: d = -\min(S, (W_k - E_k - B_k) / x)

    rather than that the force ends while leaving contact. Where E alone is beyond B, as after a press that gave out too
    much, no offset would bring E - W back, and with a force of zero the debt could not be paid. So W may always be
    three quarters of the work put in by this press,

    .. math:: W_k \le \max(E_k + B_k,\; 0.75\, (E_k - \min_{j \le k} E_j))

    the minimum being that of this contact: the hand feels the model, weaker, and the rest of its work pays the debt.
    Leaving pays as well: where F + o would be negative, the offset follows F, so that an operator who presses again
    from there feels the new model from zero on.

    A hand that leaves is not pushed: growth of the force meanwhile, beyond what the device carries, is put into the
    offset too, and no offset is raised before the hand stays or comes back. And an offset above zero is at most its
    rendered part (`wind_down`): where the limits or the energy cut the force, it does not wait to come back.

    Attributes:
        offset: Offset o [N].
        force: Rendered force m [N].
        step: Part of the newest change of m that is due to models, not motion [N]: at most S, in either direction.
        surplus: Part of the newest growth of F that was put into the offset, because the hand was leaving [N].
        held_back: Whether energy kept the offset from being raised in the newest tick, or lowered it.

    Args:
        mediations: Array of one `MediationState` that this one takes, part of another record; None for one of its own.

    References:
        Franken, Stramigioli, Misra, Secchi, Macchelli (2011), Bilateral telemanipulation with time delays: a two-layer
        approach combining passivity and transparency, IEEE Transactions on Robotics 27(4): the tank. Passivity of
        changing models: Ferraguti, Secchi, Fantuzzi (2013), A tank-based approach to impedance control with variable
        stiffness, ICRA.
    """

    __slots__ = ()

    offset: float
    force: float
    step: float
    surplus: float
    held_back: bool

    def __init__(self, *, mediations: NDArray[np.void] | None = None) -> None:
        super().__init__(MediationState.new() if mediations is None else mediations)

    def part(self, energy: float) -> None:
        """End the contact at this E [J]: the work of the next press counts from here."""
        self.lowest = energy

    def update(
        self,
        wanted: float,
        jump: float,
        period: float,
        *,
        leaving: bool = False,
        surplus: float = 0.0,
        energy: float,
        bound: float,
        leaving_work: Callable[[float], tuple[float, float]],
    ) -> float:
        """One tick.

        Args:
            wanted: Force F of the newest model [N], 0 or more.
            jump: J, F less that of the former model [N]; 0 where no model came.
            period: Period T [s].
            leaving: Whether the hand moves outwards.
            surplus: Growth of F that such a hand is not to feel [N], 0 or more.
            energy: Energy E of the account [J].
            bound: Bound B [J].
            leaving_work: Function that gives W [J] and x [m] for an offset [N]; called only in contact.

        Returns:
            The rendered force m [N].
        """
        work, way = leaving_work(self.offset - jump - surplus) if wanted > 0.0 else (0.0, 0.0)
        return _mediate.entry(self.records[0], wanted, jump, period, leaving, surplus, energy, bound, work, way)

    def wind_down(self, rendered: float) -> None:
        """Reduce an offset above zero to its rendered part; the force was cut to this one [N]."""
        _wind_down.entry(self.records[0], rendered)

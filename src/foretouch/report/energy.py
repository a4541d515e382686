"""The energy account of a session: whether the hand was given more than it gave, contact by contact."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.rendering.energy import SMALLEST_COUNT
from foretouch.rendering.renderer import FARTHEST, PHANTOM

__all__ = ["ROUNDING", "Account", "energy_account", "energy_figures", "exact_energy", "has_account"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rows = NDArray[np.void]

ROUNDING = 1e-9
"""What sums of floating-point numbers may be wrong by [J]."""


SAME = 1e-9
"""Products of the same numbers differ by no more than this share: forces that fade pass through every size."""


class Account(NamedTuple):
    """The account of energy in every tick of the leader.

    Attributes:
        energy: E: what the hand has put into the rendered force since this contact began [J], shape (n,).
        bound: F D [J]: E may be so far below zero, shape (n,).
    """

    energy: Array
    bound: Array


def has_account(leader: Rows) -> bool:
    """Whether somebody kept the account: some bound was stated, or no force had time to work."""
    return bool(leader.size) and bool((leader["energy_bound"] > 0.0).any() or not leader["rendered_force"][:-1].any())


def energy_account(leader: Rows, resolution: float | None = 0.0) -> Account:
    r"""The account of a session, summed up again from the forces and positions that were recorded.

    .. math:: E_{k+1} = E_k + f_k (x_{k+1} - x_k), \quad E_k \ge -F_k D_k

    with the rendered force f, the largest one F of this contact so far, and D, the farthest that the hand x went in one
    tick under a force, and one encoder count. From the leader's own columns comes only where contacts begin: where
    nothing was carried over and no more than 0.05 N was rendered. After rows that were lost, energy goes on from what
    the leader said there, and its bound is believed until the next contact.

    Args:
        leader: Rows of `SessionLog.leader`.
        resolution: One count of the encoder [m]; less than a micrometre counts as one. None where nobody knows it: then
            every bound is the leader's.
    """
    ticks = _ticks(leader, resolution)
    told, bound = leader["energy_bound"].tolist(), np.zeros(leader.size)
    largest = farthest = 0.0
    believed = False
    columns = (ticks.force.tolist(), ticks.reach.tolist(), ticks.begins.tolist(), ticks.lost.tolist())
    for row, (force, reach, begins, lost) in enumerate(zip(*columns, strict=True)):
        believed = resolution is None or lost or (believed and not begins)
        largest, farthest = (force, reach) if begins else (max(largest, force), max(farthest, reach))
        bound[row] = told[row] if believed else largest * farthest
    return Account(_summed(leader, ticks, ticks.work), bound)


def energy_figures(leader: Rows, resolution: float | None = 0.0) -> dict[str, Any]:
    """The certificate of a session, over all ticks in contact; where nobody kept an account every figure is None.

    Args:
        leader: Rows of `SessionLog.leader`.
        resolution: One count of the encoder [m], None where nobody knows it.

    Returns:
        ``certificate_holds``: by `energy_account` no tick had E + F D below -1e-9 J, and the leader said the same.
        ``energy_agrees``: whether it did, within 1e-9 J. ``net_energy_J``: the smallest E, 0 where it was never
        negative. ``energy_bound_J``: F D of that tick, or the largest where E was never negative. ``energy_margin_J``:
        the smallest E + F D. ``energy_used_percent``: the largest share of its bound that E took.
        ``net_energy_exact_J``: the smallest of `exact_energy`, None on a device. ``largest_energy_cut_N``: how much
        further the rendered force fell in one tick than the mediated force, at most, and never more than it fell: what
        the ceiling of energy cut.
    """
    names = ("energy_bound_J", "energy_margin_J", "energy_used_percent", "net_energy_exact_J", "largest_energy_cut_N")
    if not has_account(leader):
        return dict.fromkeys(("certificate_holds", "energy_agrees", "net_energy_J", *names))
    energy, bound = energy_account(leader, resolution)
    agrees = all(
        bool((np.abs(found - told) <= ROUNDING).all())
        for found, told in ((energy, leader["energy"]), (bound, leader["energy_bound"]))
    )
    others = {"net_energy_exact_J": _exact(leader, resolution), "largest_energy_cut_N": _largest_cut(leader)}
    known = ~((bound == 0.0) & (energy >= 0.0))  # what is given out without any bound is beyond it
    if not known.any():
        nothing = dict.fromkeys(names, 0.0)
        return {"certificate_holds": agrees, "energy_agrees": agrees, "net_energy_J": 0.0, **nothing, **others}
    energy, bound = energy[known], bound[known]
    lowest = int(energy.argmin()) if not energy.min() >= 0.0 else int(bound.argmax())
    margin = float((energy + bound).min())  # of a number that is none it is none
    return {
        "certificate_holds": bool(margin >= -ROUNDING) and agrees,
        "energy_agrees": agrees,
        "net_energy_J": _number(min(float(energy[lowest]), 0.0)),
        "energy_bound_J": _number(float(bound[lowest])),
        "energy_margin_J": _number(0.0 if -ROUNDING <= margin < 0.0 else margin),
        "energy_used_percent": _number(100.0 * max(0.0, float((-energy / np.where(bound > 0.0, bound, np.inf)).max()))),
        **others,
    }


def exact_energy(leader: Rows, resolution: float | None = 0.0) -> Array:
    r"""The same account with the positions of the simulated hand, which no encoder has rounded [J].

    With e the rounding, half a count c at most, both differ by

    .. math:: \Big|\sum_k f_k (e_{k+1} - e_k)\Big| \le \frac{c}{2} \Big(f_0 + f_n + \sum_k |f_k - f_{k-1}|\Big)

    so that a force that goes up and down often can take more than the encoder shows: friction and damping of the device
    are what pays for that, as they do for the rest of what sampling costs.

    Args:
        leader: Rows of `SessionLog.leader`.
        resolution: One count of the encoder [m], None where nobody knows it.

    Returns:
        E [J], shape (n,); NaN where the hand's own position is not known.
    """
    ticks, place = _ticks(leader, resolution), leader["exact_hand_position"]
    step = _step(place)
    work = np.where(np.isfinite(step), ticks.force * step, 0.0)
    return np.where(np.isfinite(place), _summed(leader, ticks, work), np.nan)


class _Ticks(NamedTuple):
    """What the account is made of, tick by tick; columns of shape (n,)."""

    force: Array
    """Held until now [N]."""
    reach: Array
    """How far the hand went under it, and one count [m]."""
    work: Array
    """What it took [J]."""
    begins: Flags
    """Whether a contact begins."""
    lost: Flags
    """Whether the row before is missing."""


def _ticks(leader: Rows, resolution: float | None) -> _Ticks:
    force = np.concatenate((np.zeros(min(1, leader.size)), leader["rendered_force"][:-1]))
    step, count = _step(_shown(leader)), max(resolution or 0.0, SMALLEST_COUNT)
    with np.errstate(invalid="ignore"):
        work, reach = force * step, np.where(force > 0.0, np.abs(step), 0.0) + count
        fresh = np.abs(leader["energy"] - work) <= SAME * np.abs(work)
        if resolution is not None:
            fresh &= np.abs(leader["energy_bound"] - force * reach) <= SAME * force * reach
    lost = np.diff(leader["sequence"], prepend=leader["sequence"][:1] - 1) != 1
    lost |= np.diff(leader["epoch"], prepend=leader["epoch"][:1]) != 0  # another process keeps an account of its own
    begins = fresh & (force <= PHANTOM) & ~lost
    lost[:1] = ~begins[:1]
    return _Ticks(force, reach, work, begins, lost)


def _summed(leader: Rows, ticks: _Ticks, work: Array) -> Array:
    """Sum the work of every contact; after a gap on from what the leader said."""
    base = np.where(ticks.lost, leader["energy"], work)
    total = np.cumsum(np.where(ticks.lost, 0.0, work))
    newest = np.maximum.accumulate(np.where(ticks.begins | ticks.lost, np.arange(total.size), 0))
    return np.asarray(base[newest] + (total - total[newest]))


def _shown(leader: Rows) -> Array:
    """Where the encoder showed the hand; where it showed nothing that a hand can be at, the place before."""
    place = leader["hand_position"]
    good = np.abs(place) <= FARTHEST
    if not good.any():
        return np.zeros(place.size)
    newest = np.maximum.accumulate(np.where(good, np.arange(place.size), 0))
    return np.asarray(place[np.where(good[newest], newest, good.argmax())])


def _step(place: Array) -> Array:
    """Way since the tick before [m]."""
    return np.diff(place, prepend=place[:1])


def _exact(leader: Rows, resolution: float | None) -> float | None:
    energy = exact_energy(leader, resolution)
    known = energy[np.isfinite(energy)]
    return min(float(known.min()), 0.0) if known.size else None


def _largest_cut(leader: Rows) -> float:
    """How much further the rendered force fell in one tick than the mediated force, and below it, at most [N].

    Where the mediated force rose meanwhile, the hand was spared no more than what it felt before.
    """
    rendered, mediated = leader["rendered_force"], leader["mediated_force"]
    fell = -np.diff(rendered)
    cut = fell + np.minimum(np.diff(mediated), 0.0)
    counted = (np.diff(leader["sequence"]) == 1) & (fell > 0.0) & (rendered < mediated)[1:] & np.isfinite(cut)
    return max(float(cut[counted].max()), 0.0) if counted.any() else 0.0


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None

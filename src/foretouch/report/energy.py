"""The energy account of a session: whether the hand was given more than it gave, contact by contact."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ROUNDING", "energy_figures", "exact_energy", "has_account"]

Array = NDArray[np.float64]
Rows = NDArray[np.void]

ROUNDING = 1e-9
"""What sums of floating-point numbers may be wrong by [J]."""


def has_account(leader: Rows) -> bool:
    """Whether somebody kept the account: some bound was stated, or no force had time to work."""
    return bool(leader.size) and bool((leader["energy_bound"] > 0.0).any() or not leader["rendered_force"][:-1].any())


def energy_figures(leader: Rows) -> dict[str, Any]:
    r"""The certificate of a session, over all ticks in contact, those with a bound.

    .. math::
        E_{k+1} = E_k + f_k (x_{k+1} - x_k), \quad E_k \ge -F_k D_k

    E is what the hand has put into the rendered force f since this contact began, F and D are the largest force and the
    largest step of it so far (`foretouch.rendering.EnergyAccount`). All of them are as the leader said; where nobody
    kept an account every figure is None.

    Args:
        leader: Rows of `SessionLog.leader`.

    Returns:
        ``certificate_holds``: no tick had E + F D below -1e-9 J. ``net_energy_J``: the smallest E, 0 where it was never
        negative. ``energy_bound_J``: F D of that tick, or the largest where E was never negative. ``energy_margin_J``:
        the smallest E + F D. ``energy_used_percent``: the largest share of its bound that E took.
        ``net_energy_exact_J``: the smallest of `exact_energy`, None on a device.
    """
    names = ("energy_bound_J", "energy_margin_J", "energy_used_percent", "net_energy_exact_J")
    if not has_account(leader):
        return {"certificate_holds": None, "net_energy_J": None, **dict.fromkeys(names)}
    energy, bound = leader["energy"], leader["energy_bound"]
    known = (bound > 0.0) | (energy < 0.0)  # what is given out without any bound is beyond it
    if not known.any():
        return {"certificate_holds": True, "net_energy_J": 0.0, **dict.fromkeys(names, 0.0), **_exact(leader)}
    energy, bound = energy[known], bound[known]
    lowest = int(energy.argmin()) if energy.min() < 0.0 else int(bound.argmax())
    margin = float((energy + bound).min())  # of a number that is none it is none
    return {
        "certificate_holds": bool(margin >= -ROUNDING),
        "net_energy_J": _number(min(float(energy[lowest]), 0.0)),
        "energy_bound_J": _number(float(bound[lowest])),
        "energy_margin_J": _number(0.0 if -ROUNDING <= margin < 0.0 else margin),
        "energy_used_percent": _number(100.0 * max(float((-energy / np.where(bound > 0.0, bound, np.inf)).max()), 0.0)),
        **_exact(leader),
    }


def exact_energy(leader: Rows) -> Array:
    r"""The same account with the positions of the simulated hand, which no encoder has rounded [J].

    Contacts begin where they did for the leader's own account. With e the rounding, half a count c at most, both differ
    by

    .. math:: \Big|\sum_k f_k (e_{k+1} - e_k)\Big| \le \frac{c}{2} \Big(f_0 + f_n + \sum_k |f_k - f_{k-1}|\Big)

    so that a force that goes up and down often can take more than the encoder shows: friction and damping of the device
    are what pays for that, as they do for the rest of what sampling costs.

    Args:
        leader: Rows of `SessionLog.leader`.

    Returns:
        E [J], shape (n,); NaN where the hand's own position is not known.
    """
    force, energy = leader["rendered_force"], leader["energy"]

    def booked(position: Array) -> Array:
        """Work since the row before."""
        return np.concatenate((np.zeros(min(1, force.size)), force[:-1] * np.diff(position)))

    exact = leader["exact_hand_position"]
    follows = np.diff(leader["sequence"], prepend=leader["sequence"][:1]) == 1
    shown = np.where(follows, booked(leader["hand_position"]), np.diff(energy, prepend=0.0))
    work = np.where(follows, booked(exact), shown)
    begins = np.abs(energy - shown) <= 1e-15  # nothing was carried over
    total = np.cumsum(np.where(np.isfinite(work), work, 0.0))
    before = np.concatenate((np.zeros(min(1, total.size)), total[:-1]))
    newest = np.maximum.accumulate(np.where(begins, np.arange(total.size), 0))
    return np.where(np.isfinite(exact), total - before[newest], np.nan)


def _exact(leader: Rows) -> dict[str, float | None]:
    energy = exact_energy(leader)
    known = energy[np.isfinite(energy)]
    return {"net_energy_exact_J": min(float(known.min()), 0.0) if known.size else None}


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None

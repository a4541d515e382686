"""The energy account of a hand in three dimensions, summed up again from what was recorded."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.rendering.energy import SMALLEST_COUNT
from foretouch.report.energy import ROUNDING, Account
from foretouch.report.scene_rows import SceneRows, vectors

__all__ = ["spatial_account", "spatial_energy_figures"]

Array = NDArray[np.float64]


def spatial_account(rows: SceneRows, *, position_scale: float, resolution: float | None) -> Account:
    r"""The account in all directions, from the recorded forces and places of the hand.

    .. math:: E_{k+1} = E_k - f_k \cdot (x_{k+1} - x_k), \quad E_k \ge -F_k D_k

    as `foretouch.rendering.SpatialEnergyAccount` keeps it: F is the largest force of this contact, D its longest step
    and one count of the encoders. A contact ends where nothing is rendered along the normal. After rows that were lost
    the leader's own numbers are believed until the next contact.

    Args:
        rows: Of one stretch.
        position_scale: Follower's motion for the hand's.
        resolution: One count of the device [m]; None where nobody knows it: then the bound is the leader's.
    """
    place, force = vectors(rows.hand, "hand") / position_scale, vectors(rows.hand, "force")
    sizes = np.linalg.norm(force, axis=1).tolist()
    steps = np.diff(place, axis=0, prepend=place[:1])
    steps[~np.isfinite(steps)] = 0.0
    held = np.vstack([np.zeros((1, 3)), force])[: len(force)]
    works = (-np.einsum("ij,ij->i", held, steps)).tolist()
    count = math.sqrt(3.0) * max(resolution or 0.0, SMALLEST_COUNT)
    reaches = (np.linalg.norm(steps, axis=1) + count).tolist()
    lost = (np.diff(rows.hand["sequence"], prepend=0) != 1).tolist()  # a leader counts from 1
    closed = (rows.leader["rendered_force"] <= 0.0).tolist()
    told = rows.hand["energy"].tolist(), rows.hand["energy_bound"].tolist()
    energy, bound = np.zeros(len(sizes)), np.zeros(len(sizes))
    sum_, largest, farthest, before, believed = 0.0, 0.0, count, 0.0, False
    for row, size in enumerate(sizes):
        believed = believed or lost[row]
        sum_ += works[row]
        if before > 0.0:
            farthest = max(farthest, reaches[row])
        if closed[row]:
            sum_, largest, farthest, believed = 0.0, 0.0, count, False
        if lost[row]:
            sum_ = told[0][row]
        largest, before = max(largest, size), size
        energy[row] = sum_
        bound[row] = told[1][row] if believed or resolution is None else largest * farthest
    return Account(energy, bound)


def spatial_energy_figures(rows: SceneRows, account: Account) -> dict[str, Any]:
    """Whether the account kept its bound, and whether the leader said the same.

    Returns:
        ``net_energy_J``: the smallest E, 0 where it was never negative; ``energy_margin_J``: the smallest E + F D;
        ``energy_bound_J``: F D of that tick; ``energy_agrees``: within 1e-9 J; ``certificate_holds``: both.
    """
    energy, bound = account
    told = (energy, rows.hand["energy"]), (bound, rows.hand["energy_bound"])
    agrees = all(bool((np.abs(found - said) <= ROUNDING).all()) for found, said in told)
    under_force = ~((bound == 0.0) & (energy >= 0.0))
    if not under_force.any():
        nothing = dict.fromkeys(("net_energy_J", "energy_margin_J", "energy_bound_J"), 0.0)
        return {**nothing, "energy_agrees": agrees, "certificate_holds": agrees}
    energy, bound = energy[under_force], bound[under_force]
    lowest = int(energy.argmin()) if not energy.min() >= 0.0 else int(bound.argmax())
    margin = float((energy + bound).min())
    return {
        "net_energy_J": min(float(energy[lowest]), 0.0),
        "energy_margin_J": 0.0 if -ROUNDING <= margin < 0.0 else margin,
        "energy_bound_J": float(bound[lowest]),
        "energy_agrees": agrees,
        "certificate_holds": agrees and bool(margin >= -ROUNDING),
    }

"""The energy account of a hand in three dimensions, summed up again from what was recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.report.booked import BookedDevice, book
from foretouch.report.energy import ROUNDING, Account, lost_rows, summed_account
from foretouch.report.scene_rows import SceneRows, vectors

__all__ = ["spatial_account", "spatial_energy_figures"]

Array = NDArray[np.float64]


def spatial_account(rows: SceneRows, *, position_scale: float, device: BookedDevice | None) -> Account:
    """The account in all directions, from the recorded forces and places of the hand.

    As `foretouch.rendering.SpatialEnergyAccount` keeps it. Where hand and robot are not coupled, the place of the hand
    in the world says nothing of its motion: there, and where rows were lost, the leader is believed.

    Args:
        rows: Of one stretch.
        position_scale: Follower's motion for the hand's.
        device: The hand's; None where nobody knows it: then all of it is the leader's.
    """
    told = rows.hand
    if device is None:
        return Account(*(told[name].copy() for name in ("energy", "energy_bound", "late_energy")))
    place, force = vectors(told, "hand") / position_scale, vectors(told, "force")
    place[~np.isfinite(rows.leader["hand_position"])] = np.nan
    coupled = rows.leader["engaged"]
    lost = lost_rows(told, np.asarray(np.isfinite(place).all(axis=1)))
    lost |= ~coupled | ~np.concatenate((coupled[:1], coupled[:-1]))
    booked = book(force, place, 1e-9 * rows.leader["period_ns"], device)
    return summed_account(told, booked, np.linalg.norm(force, axis=1), rows.leader["rendered_force"], lost, device)


def spatial_energy_figures(rows: SceneRows, account: Account) -> dict[str, Any]:
    """Whether the account kept its bound, and whether the leader said the same.

    Returns:
        ``net_energy_J``: the smallest E, 0 where it was never negative; ``energy_margin_J``: its smallest distance from
        the bound; ``energy_bound_J``: the bound in that tick; ``late_energy_J``: the smallest L; ``energy_agrees``:
        within 1e-9 J; ``certificate_holds``: both.
    """
    energy, bound, late = account
    hand = rows.hand
    told = (energy, hand["energy"]), (bound, hand["energy_bound"]), (late, hand["late_energy"])
    late_energy = min(float(late.min()), 0.0) if late.size else 0.0
    agrees = all(bool((np.abs(found - said) <= ROUNDING).all()) for found, said in told)
    under_force = ~((bound == 0.0) & (energy >= 0.0))
    if not under_force.any():
        nothing = dict.fromkeys(("net_energy_J", "energy_margin_J", "energy_bound_J"), 0.0)
        return {**nothing, "late_energy_J": late_energy, "energy_agrees": agrees, "certificate_holds": agrees}
    energy, bound = energy[under_force], bound[under_force]
    lowest = int(energy.argmin()) if not energy.min() >= 0.0 else int(bound.argmax())
    margin = float((energy + bound).min())
    return {
        "net_energy_J": min(float(energy[lowest]), 0.0),
        "energy_margin_J": 0.0 if -ROUNDING <= margin < 0.0 else margin,
        "energy_bound_J": float(bound[lowest]),
        "late_energy_J": late_energy,
        "energy_agrees": agrees,
        "certificate_holds": agrees and bool(margin >= -ROUNDING),
    }

"""The figures of one session that a sweep asks for."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog, encode
from foretouch.report import CONTACT_FLOOR, Pairs, pair
from foretouch.session import SAMPLE_PERIOD, SessionSettings

__all__ = ["digest", "measure"]

Array = NDArray[np.float64]

SHORTEST_CONTACT = 0.2
"""Less contact than this [s] says nothing about how it feels."""

ROUNDING = 1e-9
"""What sums of floating-point numbers may be wrong by [J]."""


def measure(log: SessionLog, settings: SessionSettings) -> dict[str, Any]:
    """All measured figures of `Outcome`, by name."""
    pairs = pair(log)
    oscillating = _oscillates(log.leader)
    energy = _energy(log.leader)
    finite = bool(np.isfinite(log.leader["rendered_force"]).all() and np.isfinite(log.follower["exact_force"]).all())
    margin = energy["energy_margin_J"]
    return {
        "stable": finite and not oscillating and (margin is None or margin >= 0.0),
        "oscillating": oscillating,
        **energy,
        "largest_jump_N": _largest(np.abs(log.leader["update_step"])),
        **_transparency(log, pairs, settings),
        "models_per_s": np.unique(log.leader["model_sequence"][log.leader["model_sequence"] > 0]).size
        / (log.leader.size * SAMPLE_PERIOD),
        "largest_hand_force_N": _largest(log.leader["rendered_force"]),
        "largest_robot_force_N": _largest(log.follower["exact_force"]),
        "guarded_contacts": int(np.count_nonzero(np.diff(log.follower["guarded"].astype(np.int8), prepend=0) > 0)),
        "guarded_s": float(log.follower["guarded"].sum()) * SAMPLE_PERIOD,
        "device_bound_percent": _bound_by_device(log.leader),
        "digest": digest(log),
    }


def digest(log: SessionLog) -> str:
    """SHA-256 of all ticks of both sides and all models; real computing times, which differ on repeat, are left out."""
    sum_ = hashlib.sha256()
    for rows in (log.leader, log.follower):
        for name in rows.dtype.names or ():
            if name != "compute_ns":
                sum_.update(np.ascontiguousarray(rows[name]).tobytes())
    for model in log.models:
        sum_.update(encode(model))
    return sum_.hexdigest()


def _largest(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def _energy(leader: NDArray[np.void]) -> dict[str, float | None]:
    """The certificate: energy of each contact against its bound."""
    energy, bound = leader["energy"], leader["energy_bound"]
    known = bound > 0.0
    if not known.any():
        return dict.fromkeys(("net_energy_J", "energy_bound_J", "energy_margin_J", "energy_share"))
    energy, bound = energy[known], bound[known]
    lowest = int(energy.argmin())
    margin = float((energy + bound).min())
    return {
        "net_energy_J": min(float(energy[lowest]), 0.0),
        "energy_bound_J": float(bound[lowest]),
        "energy_margin_J": 0.0 if -ROUNDING < margin < 0.0 else margin,
        "energy_share": min(float((energy / bound).min()), 0.0),
    }


def _transparency(log: SessionLog, pairs: Pairs, settings: SessionSettings) -> dict[str, float | None]:
    """How it felt, against how it was: rows in contact, coupled before and after, nothing held back."""
    leader, follower = pairs.leader, pairs.follower
    rows = (follower["exact_force"] > CONTACT_FLOOR) & leader["engaged"] & ~follower["guarded"]
    contact = float(rows.sum()) * SAMPLE_PERIOD
    if contact < SHORTEST_CONTACT:
        return {"error_percent": None, "felt_stiffness_percent": None, "contact_s": contact, "age_s": None}
    leader, follower = leader[rows], follower[rows]
    felt, true = leader["rendered_force"] / settings.force_scale, follower["exact_force"]
    wrong, size = (float(np.sqrt(np.mean(values**2))) for values in (felt - true, true))
    stiffness = _slope(leader["hand_position"] * settings.position_scale, felt)
    true_stiffness = _slope(follower["position"], true)
    return {
        "error_percent": 100.0 * wrong / size,
        "felt_stiffness_percent": 100.0 * stiffness / true_stiffness if true_stiffness > 0.0 else None,
        "contact_s": contact,
        "age_s": _age(log, leader, settings.baseline != "none"),
    }


def _slope(position: Array, force: Array) -> float:
    """Of the straight line of least squares [N/m]; 0 where nothing moves."""
    apart = position - position.mean()
    square = float(apart @ apart)
    return float(apart @ force) / square if square > 0.0 else 0.0


def _age(log: SessionLog, leader: NDArray[np.void], delayed: bool) -> float | None:
    """Median age of what was rendered from: the models, or of a baseline the telemetry; leader ticks are commands."""
    if delayed:
        sources, newest = log.follower[["sequence", "command_sequence"]], leader["telemetry_sequence"]
        numbers, commands = sources["sequence"], sources["command_sequence"]
    else:
        newest = leader["model_sequence"]
        numbers = np.array([model.sequence for model in log.models], dtype=np.int64)
        commands = np.array([model.command_sequence for model in log.models], dtype=np.int64)
    place = np.searchsorted(numbers, newest)
    known = (newest > 0) & (place < numbers.size)
    if not known.any():
        return None
    return float(np.median(leader["sequence"][known] - commands[place[known]])) * SAMPLE_PERIOD


def _bound_by_device(leader: NDArray[np.void]) -> float | None:
    contact = leader["rendered_force"] > CONTACT_FLOOR
    return float(100.0 * np.mean(leader["rendered_share"][contact] < 1.0)) if contact.any() else None


SWING = 5e-4
"""Smallest swing of the hand that counts [m]."""


def _oscillates(leader: NDArray[np.void]) -> bool:
    """Whether the hand turns more often than it wants to: by more than 2 turns and a tenth."""
    hand, intended = leader["exact_hand_position"], leader["intended_position"]
    known = np.isfinite(hand) & np.isfinite(intended)
    turns, meant = _turns(hand[known]), _turns(intended[known])
    return turns > meant + 2 + 0.1 * meant


def _turns(position: Array) -> int:
    """Turning points that lie at least one swing apart."""
    count, direction = 0, 0
    low = high = float(position[0]) if position.size else 0.0
    for here in position.tolist():
        low, high = min(low, here), max(high, here)
        if direction >= 0 and here < high - SWING:
            count, direction, low = count + (direction > 0), -1, here
        elif direction <= 0 and here > low + SWING:
            count, direction, high = count + (direction < 0), 1, here
    return count

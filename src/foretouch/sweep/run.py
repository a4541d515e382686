"""One session of a sweep, from its case to its row and the figures in it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog, Status, encode
from foretouch.quantities import Rows
from foretouch.report import CONTACT_FLOOR, hand_figures, pair, update_jumps
from foretouch.session import SAMPLE_PERIOD, SessionSettings, simulate
from foretouch.sweep.cases import Case
from foretouch.sweep.outcome import Outcome

Array = NDArray[np.float64]

_ENERGY = ("net_energy_J", "energy_bound_J", "energy_margin_J", "energy_used_percent", "net_energy_exact_J")

SHORTEST_CONTACT = 0.2
"""Less contact than this [s] says nothing about how it feels."""

SHORTEST_WAY = 2e-3
"""Nor does a press tell a stiffness in which hand or probe go less far than this [m]."""


def measure(log: SessionLog, settings: SessionSettings) -> dict[str, Any]:
    """All measured figures of `Outcome`, by name; most are those of the session's report."""
    figures = hand_figures(log)
    hand = figures["hand"]
    models = log.leader["model_sequence"]
    return {
        **{name: figures[name] for name in ("stable", *_ENERGY, "guarded_contacts", "guarded_s")},
        "oscillating": bool(hand["oscillation"]["oscillates"]),
        "forces_finite": hand["forces_finite"],
        "largest_jump_N": update_jumps(log.leader)["largest_update_jump_N"] if settings.baseline == "none" else None,
        **_transparency(log, settings),
        "models_per_s": np.unique(models[models > 0]).size / (models.size * SAMPLE_PERIOD),
        "largest_hand_force_N": hand["peak_force_hand_N"],
        "largest_robot_force_N": hand["peak_force_robot_N"],
        **_faults(log.follower[log.follower["command_sequence"] > 0]),
        "depth_lost_mm": hand["depth_lost_mm"],
        "time_lost_s": hand["time_lost_s"],
        "device_bound_percent": hand["device_bound_percent"],
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


def _transparency(log: SessionLog, settings: SessionSettings) -> dict[str, float | None]:
    """How it felt, against how it was: rows in contact, coupled before and after, nothing held back."""
    pairs = pair(log)
    leader, follower = pairs.leader, pairs.follower
    rows = (follower["exact_force"] > CONTACT_FLOOR) & leader["engaged"] & (follower["status"] == Status.FOLLOWING)
    contact = float(rows.sum()) * SAMPLE_PERIOD
    phantom = _phantom(leader, follower, settings)
    if contact < SHORTEST_CONTACT:
        return {"contact_s": contact, "largest_phantom_N": phantom}
    leader, follower = leader[rows], follower[rows]
    felt, true = leader["rendered_force"] / settings.force_scale, follower["exact_force"]
    presses = np.split(np.arange(rows.sum()), np.flatnonzero(np.diff(np.flatnonzero(rows)) > 1) + 1)
    hand, probe = leader["hand_position"] * settings.position_scale, follower["position"]
    return {
        "contact_s": contact,
        "largest_phantom_N": phantom,
        "error_percent": 100.0 * _rms(felt - true) / _rms(true),
        "prediction_error_percent": 100.0 * _rms(leader["predicted_force"] - true) / _rms(true),
        "felt_stiffness_percent": felt_stiffness([(hand[p], felt[p], probe[p], true[p]) for p in presses]),
        "age_s": _age(log, leader, settings.baseline != "none"),
    }


def _faults(follower: Rows) -> dict[str, Any]:
    """For how long the robot did not follow the commands that there were, and how often sensors were not believed."""
    held = ~np.isin(follower["status"], (Status.FOLLOWING, Status.GUARDED))
    return {"held_s": float(held.sum()) * SAMPLE_PERIOD, "disbelieved_ticks": int((follower["validity"] > 0).sum())}


def _phantom(leader: Rows, follower: Rows, settings: SessionSettings) -> float | None:
    """The largest force that was felt where there was nothing, at equal command."""
    rows = (follower["exact_force"] <= 0.0) & leader["engaged"] & (follower["status"] == Status.FOLLOWING)
    felt = leader["rendered_force"][rows] / settings.force_scale
    return float(felt.max()) if felt.size else None


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def felt_stiffness(presses: Sequence[tuple[Array, ...]]) -> float | None:
    """Slope of the felt force as a share of the true one's [%], median of the presses that tell it; None without any.

    Each press by itself: between two of them, hand and probe may have been brought together otherwise.

    Args:
        presses: Position of the hand and felt force, position of the probe and true force, of each.
    """
    shares = [
        100.0 * _slope(hand, felt) / _slope(probe, true)
        for hand, felt, probe, true in presses
        if hand.size * SAMPLE_PERIOD >= SHORTEST_CONTACT
        and min(np.ptp(hand), np.ptp(probe)) >= SHORTEST_WAY
        and _slope(probe, true) > 0.0
    ]
    return float(np.median(shares)) if shares else None


def _slope(position: Array, force: Array) -> float:
    """Of the straight line of least squares [N/m]; 0 where nothing moves."""
    apart = position - position.mean()
    square = float(apart @ apart)
    return float(apart @ force) / square if square > 0.0 else 0.0


def _age(log: SessionLog, leader: Rows, delayed: bool) -> float | None:
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


def log_of(case: Case) -> tuple[SessionLog, float]:
    """Run the session: what was said in it, and the real time that it took [s]."""
    settings = case.settings()
    session = simulate(settings, duration=case.duration, say=lambda _: None)
    return session.log, session.elapsed


def run_case(case: Case) -> Outcome:
    """Run the session and measure it; one that fails, however, is a row that says why."""
    try:
        log, elapsed = log_of(case)
        figures = measure(log, case.settings())
    except Exception as error:  # a sweep goes on, whatever one session meets
        return failed(case, f"{type(error).__name__}: {error}")
    return Outcome(**_facts(case), **figures, elapsed_s=elapsed)


def failed(case: Case, reason: str) -> Outcome:
    """The row of a session that gave no result."""
    return Outcome(**_facts(case), error=" ".join(reason.split()))


def _facts(case: Case) -> dict[str, Any]:
    return {
        "number": case.number,
        "baseline": case.baseline,
        "command": case.command,
        "duration_s": case.duration,
        "network": case.network,
        "round_trip_s": case.round_trip,
        "options": case.options,
    }

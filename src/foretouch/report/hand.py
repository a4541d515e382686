"""The hand in the loop: what it was given, what it was spared, and where it was against where it wanted to be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import Rows
from foretouch.report.booked import booked_device
from foretouch.report.energy import energy_figures
from foretouch.report.free_hand import free_hand
from foretouch.report.guarded import guarded_figures
from foretouch.report.pairs import Pairs, not_scored, pair
from foretouch.report.swings import oscillation

__all__ = [
    "AS_IT_COMES",
    "FELT",
    "NO_BASELINE",
    "NO_GRIP",
    "OPEN_LOOP",
    "apart",
    "contact_force",
    "hand_figures",
    "largest",
    "loop_sentence",
    "number_of",
    "renders_models",
    "setting",
]

Array = NDArray[np.float64]

NO_GRIP = NO_BASELINE = "none"

AS_IT_COMES = "delayed"
"""The baseline that renders the delayed force itself."""

OPEN_LOOP = "open loop: the force does not move the hand"
OWN_HAND = "closed loop: a hand of its own holds the device {} and feels the force"

FELT = 0.05
"""Rendered force from which on a tick counts as contact at the hand [N]."""

PHANTOM = 0.3
"""Force from which on it is told that a hand felt what the robot did not touch [N] ..."""
PHANTOM_TICKS = 50
"""... for more than so many commands in a row: the edge of a contact is never quite where it was."""


def hand_figures(log: SessionLog, pairs: Pairs | None = None) -> dict[str, Any]:
    """Stability, energy and the hand, as `session_report` puts them among its own.

    A session is stable if

    1. the certificate of energy holds in every tick (`energy_figures`),
    2. every rendered and every contact force is a finite number, and
    3. the hand does not oscillate (`oscillation`), compared with what it would do without any force (`free_hand`);
       where it is not known what the hand means to do, as in an open loop, this is not asked.

    A baseline renders no model: what a device could not carry of one and what the ceiling of energy cut is None there.

    Args:
        log: One stretch of a session (`SessionLog.stretches`).
        pairs: Its rows at equal command; None to pair them here.

    Returns:
        ``stable`` (None where nobody kept an account of energy, as in recordings of old, and for a baseline in an open
        loop, where nobody holds what could be unstable), the figures of the energy, ``guarded_contacts``,
        ``guarded_s``, ``engaged_percent`` and the object ``hand``.
    """
    leader, models = log.leader, renders_models(log.settings)
    grip = setting(log.settings, "grip", NO_GRIP)
    energy = energy_figures(leader, booked_device(log.settings))
    guarded, swings = guarded_figures(log), oscillation(leader, free_hand(log))
    finite, holds = _finite(log), energy.pop("certificate_holds")
    own = {name: energy.pop(name) for name in ("energy_agrees", "largest_energy_cut_N")}
    if not models:
        own["largest_energy_cut_N"] = None
    unasked = holds is None or (grip == NO_GRIP and not models)
    return {
        "stable": None if unasked else bool(holds and finite and not swings["oscillates"]),
        **energy,
        "guarded_contacts": guarded.pop("guarded_contacts"),
        "guarded_s": guarded.pop("guarded_s"),
        "engaged_percent": 100.0 * float(leader["engaged"].mean()) if leader.size else None,
        "hand": {
            "grip": grip,
            "certificate_holds": holds,
            **own,
            "forces_finite": finite,
            "peak_force_hand_N": largest(leader["rendered_force"]),
            "peak_force_robot_N": largest(contact_force(log)),
            "peak_force_guarded_N": largest(contact_force(log)[log.follower["guarded"]]),
            **guarded,
            "largest_index_mm": _in_mm(largest(np.abs(apart(log)))),
            "largest_phantom_N": _largest_phantom(pair(log) if pairs is None else pairs),
            **_device_bound(log),
            **_given_way(leader),
            "oscillation": swings,
        },
    }


def setting(settings: Mapping[str, str], name: str, otherwise: str) -> str:
    """A setting of a session as text; sessions of old do not have all."""
    return settings.get(name) or otherwise


def renders_models(settings: Mapping[str, str]) -> bool:
    """Whether models were rendered, and not a delayed force as by the baselines."""
    return setting(settings, "baseline", NO_BASELINE) == NO_BASELINE


def number_of(settings: Mapping[str, str], name: str, otherwise: float) -> float:
    """A positive number among the settings of a session; what is none counts as not said."""
    try:
        value = float(settings.get(name, otherwise))
    except ValueError:
        return otherwise
    return value if 0.0 < value < math.inf else otherwise


def loop_sentence(settings: Mapping[str, str]) -> str:
    """Whether the force moves a hand, whose, and which device it holds."""
    grip = setting(settings, "grip", NO_GRIP)
    if settings.get("replay") == "open loop":
        return OPEN_LOOP
    if grip == NO_GRIP:
        return (
            OWN_HAND.format(setting(settings, "operator", "a device")) if settings.get("felt") == "yes" else OPEN_LOOP
        )
    mass, damping, friction, resolution = (
        number_of(settings, f"device_{name}", 0.0) for name in ("mass", "damping", "friction", "resolution")
    )
    return (
        f"closed loop: a hand with a {grip} grip holds a device of {mass:g} kg, {damping:g} N s/m, "
        f"{friction:g} N of friction and {1e6 * resolution:g} um a count"
    )


def apart(log: SessionLog) -> Array:
    r"""How far the proxy has been taken back from the hand, in the follower's lengths [m], shape (n,).

    .. math:: i_k - i_0, \quad i = p\,x - y

    with the position scale p, the hand x and the proxy y; the reference i_0 is where hand and proxy were coupled, anew
    each time that the clutch is let go. It holds what was indexed away at first touch, and what yielded because the
    device could not carry the model. NaN where they are not coupled.
    """
    leader = log.leader
    scale = number_of(log.settings, "position_scale", 1.0)
    between = scale * leader["hand_position"] - leader["position"]
    coupled = leader["engaged"] & np.isfinite(between)
    begins = coupled & ~np.concatenate((np.zeros(min(1, coupled.size), dtype=np.bool_), coupled[:-1]))
    newest = np.maximum.accumulate(np.where(begins, np.arange(coupled.size), 0))
    return np.where(coupled, between - between[newest], np.nan)


def _finite(log: SessionLog) -> bool:
    """Whether all forces are numbers: those for the hand and, where they are known, those at the probe."""
    exact = log.follower["exact_force"]
    wrong = np.isinf(exact) | (np.isnan(exact) & ~np.isnan(exact).all())  # on a robot it is known nowhere
    return bool(np.isfinite(log.leader["rendered_force"]).all() and not wrong.any())


def contact_force(log: SessionLog) -> Array:
    """Force between probe and material in all ticks [N]: the simulator's where it is known, else the sensor's."""
    exact = log.follower["exact_force"]
    return np.asarray(exact if np.isfinite(exact).any() else log.follower["force"])


def _largest_phantom(pairs: Pairs) -> float | None:
    """The largest force that the hand felt for a while where the robot touched nothing, at equal command [N]."""
    leader, follower = pairs.leader, pairs.follower
    felt = leader["rendered_force"]
    wrong = ~follower["in_contact"] & ~not_scored(pairs) & (felt > PHANTOM)
    edges = np.flatnonzero(np.diff(wrong, prepend=False, append=False))
    runs = (felt[start:end] for start, end in zip(edges[::2], edges[1::2], strict=True) if end - start > PHANTOM_TICKS)
    return max((float(run.max()) for run in runs), default=0.0) if felt.size else None


def _device_bound(log: SessionLog) -> dict[str, float | None]:
    """How much of the contact by the model the device could not carry in full, and the least share that it could."""
    leader, force_scale = log.leader, number_of(log.settings, "force_scale", 1.0)
    share = leader["rendered_share"][leader["engaged"] & (force_scale * leader["predicted_force"] > FELT)]
    if not share.size or not renders_models(log.settings):
        return {"device_bound_percent": None, "smallest_rendered_share": None}
    return {
        "device_bound_percent": 100.0 * float(np.mean(share < 1.0)),
        "smallest_rendered_share": float(share.min()),
    }


def _given_way(leader: Rows) -> dict[str, float | None]:
    """How far the hand was from where it meant to be, RMS: in contact by the force, in the air by its own lag."""
    away = leader["intended_position"] - leader["exact_hand_position"]
    known, felt = np.isfinite(away), leader["rendered_force"] > FELT
    return {
        "given_way_mm": _in_mm(_rms(away[known & felt])),
        "given_way_in_air_mm": _in_mm(_rms(away[known & ~felt])),
    }


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def largest(values: Array) -> float | None:
    """The largest finite value, None where there is none."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def _in_mm(length: float | None) -> float | None:
    return None if length is None else 1e3 * length

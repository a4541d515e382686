"""What is special about a recording and bears on its prediction, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.force_calibration import TOUCH
from foretouch.report.forces import Forces
from foretouch.report.scores import STATUSES, Scores, lowest_mean

__all__ = ["remarks"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

APART = 0.1
"""Touches that are nearer to each other than this [s] are one."""

BEGINNING = 0.02
"""What is in contact for so long from the first sample on [s] begins in contact."""

GAP = 10.0
"""A time between two samples that is so many times the usual one is a gap ..."""
SHORTEST_GAP = 0.02
"""... from this length on [s]."""

SLOWEST = 0.008
"""With more time between two samples than this [s] a recording is slow: an impact lasts about as long."""

OUTERMOST = 0.15
"""Drift is looked for in this outermost share of the range of positions ..."""
FEWEST_SAMPLES = 50
"""... where there are at least so many samples ..."""
SPAN_SHARE = 0.5
"""... over at least this share of the recording's length."""
CLEAR = 3.0
"""Drift over the recording is told where it is so many times what remains beside it."""


def remarks(forces: Forces, scores: Scores, delay: float, score_from: float | None = None) -> tuple[str, ...]:
    """Sentences on what is special about a recording: none for most.

    Among them: what the status means where it is not ``ok``; a recording that begins in contact, touches only once,
    whose probe never moves, whose force drifts in free air, that has gaps in time or is sampled slowly.

    Args:
        forces: Of the recording.
        scores: What `score` gave of them, all samples among them.
        delay: Of the forces [s].
        score_from: Where scoring was to begin [s after the first sample], where that is known.
    """
    return tuple(_said(forces, scores, delay, score_from))


def _said(forces: Forces, scores: Scores, delay: float, score_from: float | None) -> Iterator[str]:
    time = forces.time - (forces.time[0] if forces.time.size else 0.0)
    if scores.status != "ok":
        yield f"{scores.status}: {_meaning(scores.status, time, forces.skipped is None, score_from)}."
    if time.size > 1:
        yield from _of_time(time)
        if not np.ptp(forces.position) > 0.0:
            yield "The probe never moves: how the force depends on depth and velocity cannot be learnt."
    if scores.status == "no_contact" and -lowest_mean(time, -scores.measured_force, TOUCH) > forces.contact_floor:
        yield "It touches outside of the scoring window only: --score-from and --score-to choose another one."
    if scores.status in ("ok", "prediction_not_finite") and scores.in_contact.any():
        drift = list(_of_drift(time, forces.position, scores))
        yield from drift or _of_touches(time, scores.in_contact, delay)  # what drifts cannot tell when it touches


def _meaning(status: str, time: Array, all_count: bool, score_from: float | None) -> str:
    """What a status means for this recording."""
    if status == "nothing_to_score" and score_from is not None and time.size and time[-1] < score_from:
        return f"the recording ends after {time[-1]:.3g} s, before --score-from {score_from:g}"
    if status == "nothing_to_score" and all_count:
        return "no sample lies in the window"
    return STATUSES[status]


def _of_time(time: Array) -> Iterator[str]:
    periods = np.diff(time)
    usual = float(np.median(periods))
    gaps = periods[periods > max(GAP * usual, SHORTEST_GAP)]
    if gaps.size:
        many = "a gap" if gaps.size == 1 else f"{gaps.size} gaps"
        yield f"Time has {many}, up to {gaps.max():.2f} s long: what the material felt meanwhile is not known."
    if usual > SLOWEST:
        yield f"It has {1.0 / usual:.0f} samples a second: what is over between two of them, as an impact, is not seen."


def _of_touches(time: Array, in_contact: Flags, delay: float) -> Iterator[str]:
    touched = time[in_contact]
    breaks = np.flatnonzero(np.diff(touched) > APART)
    begin = float(touched[0])
    apart = time[~in_contact & (time > BEGINNING)]
    if in_contact[time <= BEGINNING].mean() > 0.5 and apart.size:
        left = float(apart[0])
        yield (
            f"It begins in contact: surface and zero of the force can only be told from {left:.2f} s on, when the "
            "probe first leaves it, and what is predicted before is uncertain."
        )
    elif not breaks.size:
        unknown = 100.0 * float(np.mean(touched < begin + delay))
        yield (
            f"It touches once, from {begin:.2f} to {touched[-1]:.2f} s: what is felt is known {delay:g} s later, and "
            f"{unknown:.0f} % of the contact is over by then."
        )


def _of_drift(time: Array, position: Array, scores: Scores) -> Iterator[str]:
    """Where the probe is furthest out the force should depend on position at most."""
    outside = position < position.min() + OUTERMOST * np.ptp(position)
    if outside.sum() < FEWEST_SAMPLES or np.ptp(time[outside]) < SPAN_SHARE * time[-1]:
        return
    columns = np.column_stack((time[outside] - time[outside].mean(), position[outside], np.ones(int(outside.sum()))))
    force = scores.measured_force[outside]
    found = np.linalg.lstsq(columns / np.abs(columns).max(axis=0), force, rcond=None)[0] / np.abs(columns).max(axis=0)
    drift = float(found[0]) * float(time[-1])
    with np.errstate(over="ignore"):
        left = float(np.sqrt(np.mean(np.square(force - columns @ found))))
    if abs(drift) > max(scores.threshold_N or 0.0, CLEAR * left):
        yield (
            f"The force in free air drifts by {found[0]:+.2g} N/s: its zero is that of one moment, and what drifts "
            "away from it counts as error."
        )

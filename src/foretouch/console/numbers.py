"""The numbers beside the plot of forces, from what is shown."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from foretouch.console.force_panel import Numbers
from foretouch.console.plots import SECONDS
from foretouch.console.watched import Watched
from foretouch.console.window import NAN, Window
from foretouch.session.settings import SIMULATED

__all__ = ["numbers_of"]

NAMES = ("material", "model", "estimator")
"""Settings that stand in the panel."""


def numbers_of(
    shown: Watched, window: Window, other: Watched | None, *, status: str, warnings: tuple[str, ...]
) -> Numbers:
    """The numbers of a moment.

    Args:
        shown: The session, or a recording.
        window: Of its last seconds.
        other: A second run of that recording, None where there is none.
        status: One line: what the session is doing.
        warnings: What stands above all.
    """
    leader = shown.leader
    known = np.flatnonzero(np.isfinite(window.true))
    true, age = (window.true[known[-1]], -window.time[known[-1]]) if len(known) else (NAN, NAN)
    away = float(np.mean(window.away) * np.ptp(window.time)) if len(window.time) else 0.0
    again, errors = None, (NAN, NAN)
    if other is not None and other.leader is not None:
        again = (other.leader.predicted_force, other.leader.delayed_force)
        second = other.window(SECONDS)
        errors = (second.prediction_error, second.delayed_error)
    return Numbers(
        predicted=NAN if leader is None or math.isnan(leader.position) else leader.predicted_force,
        delayed=NAN if leader is None else leader.delayed_force,
        true=float(true),
        true_age=float(age),
        rendered=NAN if leader is None else leader.rendered_force,
        depth=shown.depth,
        prediction_error=window.prediction_error,
        delayed_error=window.delayed_error,
        status=status,
        names=" · ".join(_names(shown.settings)),
        deviation=NAN if leader is None else leader.standard_deviation,
        hand_ahead=shown.hand_ahead,
        warnings=warnings,
        again=again,
        again_errors=errors,
        away=away,
    )


def _names(settings: Mapping[str, str]) -> list[str]:
    """What is pressed, and by what it is learnt; a robot of another package has a material of its own."""
    robot = settings.get("robot", SIMULATED)
    own = [] if robot == SIMULATED else [f"robot {robot}"]
    return own + [settings[name] for name in NAMES if name in settings and not (own and name == "material")]

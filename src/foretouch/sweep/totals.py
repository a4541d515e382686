"""What became of all sessions of a sweep, in numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from foretouch.sweep.outcome import Outcome

__all__ = ["of", "totals"]


def of(rows: Iterable[Outcome], baseline: str) -> list[Outcome]:
    """The rows of ours (``"none"``), or of a baseline."""
    return [row for row in rows if row.baseline == baseline]


def totals(rows: Sequence[Outcome]) -> dict[str, Any]:
    """What became of these sessions, ready for JSON; None where there is nothing to measure.

    The largest energy surplus is the most that a session gave out beyond its bound [J], 0 where none did.
    """
    ran = [row for row in rows if not row.error]
    return {
        "sessions": len(rows),
        "failed": len(rows) - len(ran),
        "unstable": sum(not row.stable for row in ran),
        "oscillating": sum(bool(row.oscillating) for row in ran),
        "bound_broken": sum(row.energy_margin_J is not None and row.energy_margin_J < 0.0 for row in ran),
        "largest_energy_surplus_J": _surplus(_extreme(ran, "energy_margin_J", min)),
        "largest_jump_N": _extreme(ran, "largest_jump_N", max),
        "median_error_percent": _median(ran, "error_percent"),
        "median_prediction_error_percent": _median(ran, "prediction_error_percent"),
        "median_felt_stiffness_percent": _median(ran, "felt_stiffness_percent"),
        "largest_phantom_N": _extreme(ran, "largest_phantom_N", max),
        "median_phantom_N": _median(ran, "largest_phantom_N"),
        "largest_hand_force_N": _extreme(ran, "largest_hand_force_N", max),
        "largest_robot_force_N": _extreme(ran, "largest_robot_force_N", max),
        "held_s": sum(row.held_s or 0.0 for row in ran),
        "false_alarms": sum(bool(row.disbelieved_ticks) for row in ran),
        "median_device_bound_percent": _median(ran, "device_bound_percent"),
        "guarded_contacts": sum(row.guarded_contacts or 0 for row in ran),
        "median_depth_lost_mm": _median(ran, "depth_lost_mm"),
        "median_time_lost_s": _median(ran, "time_lost_s"),
        "simulated_s": sum(row.duration_s for row in ran),
        "elapsed_s": sum(row.elapsed_s for row in ran),
    }


def _values(rows: Sequence[Outcome], name: str) -> list[float]:
    return [value for value in (getattr(row, name) for row in rows) if value is not None and math.isfinite(value)]


def _extreme(rows: Sequence[Outcome], name: str, choose: Callable[..., float]) -> float | None:
    return choose(_values(rows, name), default=None)


def _median(rows: Sequence[Outcome], name: str) -> float | None:
    values = _values(rows, name)
    return float(np.median(values)) if values else None


def _surplus(margin: float | None) -> float | None:
    return None if margin is None else max(0.0, -margin)

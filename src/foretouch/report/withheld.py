"""How long a hand was not given the force that a model gave, and why."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import Rows
from foretouch.rendering.limits import LARGEST_FORCE
from foretouch.rendering.withheld import LEAST_FORCE, LEAST_SHARE, LEAST_TICKS, OWED, UNPAID

FIGURES = ("withheld_percent", "longest_withheld_s", "longest_withheld_at_s", "withheld_because")


def withheld_figures(leader: Rows, force_scale: float) -> dict[str, Any]:
    """The ticks in which force was withheld: see `foretouch.rendering.withheld`.

    Only ticks count in which hand and robot are coupled, the hand is seen and the model gives 0.5 N or more. Of these,
    stretches of 500 and more in a row with less than half of the model's force are withheld; a stretch may go over
    several presses.

    Args:
        leader: Rows of `SessionLog.leader`.
        force_scale: Hand's force for the model's.

    Returns:
        ``withheld_percent``: their share of the ticks that count. ``longest_withheld_s``: from the first to the last
        tick of the longest stretch, and ``longest_withheld_at_s``: when it began after the first tick; None where there
        is none. ``withheld_because``: why, in most of that stretch. All None where no tick counts.
    """
    due = np.minimum(force_scale * leader["predicted_force"], LARGEST_FORCE)
    counted = leader["engaged"] & np.isfinite(leader["hand_position"]) & (due >= LEAST_FORCE)
    rows = leader[counted]
    if not rows.size:
        return dict.fromkeys(FIGURES)
    stretches = _stretches(rows["rendered_force"] < LEAST_SHARE * due[counted])
    if not stretches:
        return dict(zip(FIGURES, (0.0, None, None, None), strict=True))
    time = rows["time_ns"] * 1e-9
    begin, end = max(stretches, key=lambda stretch: float(time[stretch[1] - 1] - time[stretch[0]]))
    share = 100.0 * sum(end - begin for begin, end in stretches) / rows.size
    owed = float(np.mean(rows["energy"][begin:end] < 0.0)) > 0.5
    return {
        "withheld_percent": share,
        "longest_withheld_s": float(time[end - 1] - time[begin]),
        "longest_withheld_at_s": float(time[begin]) - float(leader["time_ns"][0]) * 1e-9,
        "withheld_because": OWED if owed else UNPAID,
    }


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of what is true for so many rows that it counts."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)).tolist()
    return [(begin, end) for begin, end in zip(edges[::2], edges[1::2], strict=True) if end - begin >= LEAST_TICKS]

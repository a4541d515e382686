"""The time that a plot shows: forces, energy and delay of the last seconds, in as many points as can be seen."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
NAN = math.nan
CONTACT_FLOOR = 0.05
"""True force [N] above which a sample counts for the errors shown."""
LARGEST_GAP = 50
"""Commands in a row without a true force that a line may bridge."""


class Window(NamedTuple):
    """Forces, energy and delays over the leader's time; all arrays have one length.

    Attributes:
        time: Seconds before the newest leader tick, not positive, increasing.
        predicted: Force of the model at the hand's motion [N]; NaN while hand and robot are apart.
        delayed: Force of the newest telemetry that had arrived [N].
        true: Force that the follower's sensor measured when it applied this very command [N]; NaN where not yet known.
        prediction_error: RMSE of `predicted` over the samples in contact while the robot followed, in % of the RMS of
            the true force there; NaN with none. It is taken over all ticks, not over the points returned.
        delayed_error: RMSE of `delayed`, likewise.
        deviation: Standard deviation of `predicted` [N]; NaN where the model carries no uncertainty.
        rendered: Force rendered to the hand after the clamps [N].
        energy: Work of the hand against the rendered force: debts are kept, surplus is forgiven after a contact [J].
        energy_bound: Largest energy that it may have given out [J].
        late_energy: Energy lost beside it in late ticks and missing positions, never positive [J].
        round_trip: Age of the hand's motion that the newest telemetry answers [s]; NaN before the first.
        away: Whether the robot was not where the command said: it held its position, or was on its way back.
        rendered_error: RMSE of `rendered`, like `prediction_error`; meaningful only where forces are not scaled.
    """

    time: Array
    predicted: Array
    delayed: Array
    true: Array
    prediction_error: float
    delayed_error: float
    deviation: Array
    rendered: Array
    energy: Array
    energy_bound: Array
    late_energy: Array
    round_trip: Array
    away: NDArray[np.bool_]
    rendered_error: float = NAN


def empty_window() -> Window:
    """Window of a session without messages."""
    none = np.empty(0)
    return Window(none, none, none, none, NAN, NAN, none, none, none, none, none, none, np.empty(0, np.bool_))


def window_of(sequence: NDArray[np.int64], columns: Array, now: float, seconds: float, points: int) -> Window:
    """The seconds before a moment, thinned for drawing.

    Args:
        sequence: Sequence of the leader's ticks, increasing, shape (n,).
        columns: Leader time [s], predicted, delayed force, deviation, rendered force [N], energy, its bound, late
            energy [J], round trip [s], true force [N] and whether the robot was away then (1 or 0), shape (n, 11).
        now: The moment, on the leader's time [s].
        seconds: Length of the window [s].
        points: Largest number of points.
    """
    time = columns[:, 0] - now
    inside = (time >= -seconds) & (time <= 0.0)
    sequence, columns, time = sequence[inside], columns[inside], time[inside]
    if len(sequence) == 0:
        return empty_window()
    true = columns[:, 9]
    away = (columns[:, 10] > 0.0) | _never_applied(sequence, true)
    contact = (true > CONTACT_FLOOR) & np.isfinite(columns[:, 1]) & ~away
    prediction_error, delayed_error, rendered_error = (
        _error(columns[contact, column], true[contact]) for column in (1, 2, 4)
    )
    stride = 1 << max(0, math.ceil(math.log2(len(sequence) / points)))  # a power of two: it seldom changes
    shown = sequence % stride == 0
    true = _bridged(sequence, true)[shown]
    drawn = columns[shown].T
    return Window(
        time[shown], drawn[1], drawn[2], true, prediction_error, delayed_error, drawn[3], drawn[4], drawn[5], drawn[6],
        drawn[7], drawn[8], away[shown], rendered_error,
    )  # fmt: skip


def _error(force: Array, true: Array) -> float:
    """RMSE in % of the true force's RMS; NaN without samples."""
    if len(true) == 0:
        return NAN
    return float(100.0 * np.sqrt(np.mean((force - true) ** 2) / np.mean(true**2)))


def _never_applied(sequence: NDArray[np.int64], true: Array) -> NDArray[np.bool_]:
    """Which commands lie in a gap that no line bridges: the robot went on, and never took them."""
    here, before = _neighbours(true)
    wide: NDArray[np.bool_] = np.isnan(true) & (here > before) & (sequence[here] - sequence[before] > LARGEST_GAP)
    return wide


def _neighbours(true: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Of each sample the next that is known, and the last before that; the same twice at the ends and with none."""
    known = np.flatnonzero(np.isfinite(true))
    if len(known) == 0:
        return np.zeros(len(true), np.int64), np.zeros(len(true), np.int64)
    after = np.searchsorted(known, np.arange(len(true)))
    inside = (after > 0) & (after < len(known))
    here = known[np.minimum(after, len(known) - 1)]
    return here, np.where(inside, known[np.maximum(after - 1, 0)], here)


def _bridged(sequence: NDArray[np.int64], true: Array) -> Array:
    """The true force with straight lines over commands that were never applied, where only a few are missing."""
    known = np.isfinite(true)
    if not known.any():
        return true
    here, before = _neighbours(true)
    between = (here > before) & (sequence[here] - sequence[before] <= LARGEST_GAP)
    bridged: Array = np.interp(sequence, sequence[known], true[known])
    return np.where(np.isfinite(true), true, np.where(between, bridged, NAN))

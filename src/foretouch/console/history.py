"""The last seconds of a session, as a console needs them: stored in a step, read as arrays."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import LeaderState, Telemetry

__all__ = ["CONTACT_FLOOR", "History", "Window"]

CONTACT_FLOOR = 0.05
"""True force [N] above which a sample counts for the errors shown."""
LARGEST_GAP = 50
"""Commands in a row without a true force that a line may bridge."""


class Window(NamedTuple):
    """Forces on the leader's time.

    Attributes:
        time: Seconds before the newest leader tick, negative, increasing.
        predicted: Force of the model at the hand's motion [N]; NaN while hand and robot are apart.
        delayed: Force of the newest telemetry that had arrived [N].
        true: Force that the follower's sensor measured when it applied this very command [N]; NaN where not yet known.
        prediction_error: RMSE of `predicted` over the samples in contact, in % of the RMS of the true force there; NaN
            with none. It is taken over all ticks, not over the points returned.
        delayed_error: The same of `delayed`.
        deviation: Standard deviation of `predicted` [N]; NaN where the model carries no doubt.
    """

    time: NDArray[np.float64]
    predicted: NDArray[np.float64]
    delayed: NDArray[np.float64]
    true: NDArray[np.float64]
    prediction_error: float
    delayed_error: float
    deviation: NDArray[np.float64]


class History:
    """Ring buffers, addressed by sequence number, so that storing a message costs the same however many came before.

    One thread stores, another reads. A reader may meet a row that is being written; sequence numbers tell rows of an
    older lap from those of this one, and a picture shows one such sample for one frame at worst.

    Args:
        length: Ticks that are kept.
    """

    def __init__(self, length: int = 8192) -> None:
        self._length = length
        self._newest = 0
        self._sequence = np.zeros(length, np.int64)
        self._rows = np.full((length, 4), np.nan)  # leader time [s], predicted and delayed force, deviation [N]
        self._true_sequence = np.zeros(length, np.int64)
        self._true = np.full(length, np.nan)
        self._position_sequence = np.zeros(length, np.int64)
        self._position = np.full(length, np.nan)
        self._applied = 0

    def add_leader(self, state: LeaderState) -> None:
        """Store one leader tick."""
        row = state.sequence % self._length
        predicted = state.predicted_force if math.isfinite(state.position) else math.nan  # of no motion there is none
        self._rows[row] = (state.time_ns * 1e-9, predicted, state.delayed_force, state.standard_deviation)
        self._sequence[row] = state.sequence
        self._newest = state.sequence

    def add_telemetry(self, telemetry: Telemetry, *, applies: bool = True) -> None:
        """Store one follower tick; of the ticks that applied one command, the first counts.

        Args:
            telemetry: Of the tick.
            applies: Whether what it applied was a command of the leader that is stored here.
        """
        row = telemetry.sequence % self._length
        self._position[row] = telemetry.position
        self._position_sequence[row] = telemetry.sequence
        applied = telemetry.command_sequence
        if applies and applied != self._applied and applied > 0:
            self._applied = applied
            row = applied % self._length
            self._true[row] = telemetry.force
            self._true_sequence[row] = applied

    def follower_position(self, telemetry_sequence: int) -> float:
        """Position [m] in one telemetry, NaN where it is not here."""
        row = telemetry_sequence % self._length
        known = telemetry_sequence > 0 and self._position_sequence[row] == telemetry_sequence
        return float(self._position[row]) if known else float("nan")

    def window(self, seconds: float = 6.0, points: int = 400) -> Window:
        """The newest `seconds` in at most `points` points, always the same ticks while they stay in the window."""
        newest = self._newest
        sequence = np.arange(max(1, newest - self._length + 2), newest + 1)
        sequence = sequence[self._sequence[sequence % self._length] == sequence]
        rows = self._rows[sequence % self._length]
        if len(sequence) == 0:
            none = np.empty(0)
            return Window(none, none, none, none, float("nan"), float("nan"), none)
        time = rows[:, 0] - rows[-1, 0]
        inside = (time >= -seconds) & (time <= 0.0)
        sequence, rows, time = sequence[inside], rows[inside], time[inside]
        known = self._true_sequence[sequence % self._length] == sequence
        true = np.where(known, self._true[sequence % self._length], np.nan)
        contact = (true > CONTACT_FLOOR) & np.isfinite(rows[:, 1])
        prediction_error, delayed_error = (_error(rows[contact, column], true[contact]) for column in (1, 2))
        stride = 1 << max(0, math.ceil(math.log2(len(sequence) / points)))  # a power of two: it seldom changes
        shown = sequence % stride == 0
        true = _bridged(sequence, true)[shown]
        drawn = rows[shown]
        return Window(time[shown], drawn[:, 1], drawn[:, 2], true, prediction_error, delayed_error, drawn[:, 3])


def _error(force: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    """RMSE in % of the true force's RMS; NaN without samples."""
    if len(true) == 0:
        return float("nan")
    return float(100.0 * np.sqrt(np.mean((force - true) ** 2) / np.mean(true**2)))


def _bridged(sequence: NDArray[np.int64], true: NDArray[np.float64]) -> NDArray[np.float64]:
    """The true force with straight lines over commands that were never applied, where only a few are missing."""
    known = np.flatnonzero(np.isfinite(true))
    if len(known) == 0:
        return true
    after = np.searchsorted(known, np.arange(len(true)))
    here = known[np.minimum(after, len(known) - 1)]
    before = known[np.maximum(after - 1, 0)]
    between = (after > 0) & (after < len(known)) & (sequence[here] - sequence[before] <= LARGEST_GAP)
    bridged: NDArray[np.float64] = np.interp(sequence, sequence[known], true[known])
    return np.where(np.isfinite(true), true, np.where(between, bridged, np.nan))

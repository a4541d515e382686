"""The last seconds of a session, as a console needs them: stored in a step, read as arrays."""

from __future__ import annotations

import math

import numpy as np

from foretouch.console.window import NAN, Array, Window, empty_window, window_of
from foretouch.messages import WITH_THE_COMMANDS, LeaderState, Telemetry

__all__ = ["History"]

COLUMNS = 9
"""Leader time [s], predicted, delayed force, deviation, rendered force [N], energy, bound, late [J], telemetry."""


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
        self._rows = np.full((length, COLUMNS), np.nan)
        self._true_sequence = np.zeros(length, np.int64)
        self._true = np.full(length, np.nan)
        self._away = np.zeros(length)  # whether the robot then did something else than follow
        self._position_sequence = np.zeros(length, np.int64)
        self._position = np.full(length, np.nan)
        self._applied_in = np.zeros(length, np.int64)  # the command that one telemetry answers, 0 for none of ours
        self._applied = 0

    def add_leader(self, state: LeaderState) -> None:
        """Store one leader tick."""
        row = state.sequence % self._length
        predicted = state.predicted_force if math.isfinite(state.position) else math.nan  # of no motion there is none
        self._rows[row] = (
            state.time_ns * 1e-9,
            predicted,
            state.delayed_force,
            state.standard_deviation,
            state.rendered_force,
            state.energy,
            state.energy_bound,
            state.late_energy,
            state.telemetry_sequence,
        )
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
        self._applied_in[row] = telemetry.command_sequence if applies else 0
        self._position_sequence[row] = telemetry.sequence
        applied = telemetry.command_sequence
        if applies and applied != self._applied and applied > 0:
            self._applied = applied
            row = applied % self._length
            self._true[row] = telemetry.force
            self._away[row] = telemetry.status not in WITH_THE_COMMANDS
            self._true_sequence[row] = applied

    def follower_position(self, telemetry_sequence: int) -> float:
        """Position [m] in one telemetry, NaN where it is not here."""
        row = telemetry_sequence % self._length
        known = telemetry_sequence > 0 and self._position_sequence[row] == telemetry_sequence
        return float(self._position[row]) if known else float("nan")

    def window(self, seconds: float = 6.0, points: int = 400, newest: int = 0) -> Window:
        """The newest `seconds` in at most `points` points, always the same ticks while they stay in the window.

        Args:
            seconds: How far back.
            points: At most so many.
            newest: Sequence of the leader's tick at which the window ends; 0 for the newest that is here.
        """
        newest = newest or self._newest
        sequence = np.arange(max(1, newest - self._length + 2), newest + 1)
        sequence = sequence[self._sequence[sequence % self._length] == sequence]
        if len(sequence) == 0:
            return empty_window()
        rows = self._rows[sequence % self._length]
        known = self._true_sequence[sequence % self._length] == sequence
        true = np.where(known, self._true[sequence % self._length], NAN)
        away = np.where(known, self._away[sequence % self._length], 0.0)
        columns = np.column_stack([rows[:, :-1], self._round_trips(rows), true, away])
        return window_of(sequence, columns, float(rows[-1, 0]), seconds, points)

    def _round_trips(self, rows: Array) -> Array:
        """How old the motion is that the newest telemetry at each tick answers [s]; NaN where it is not here."""
        telemetry = rows[:, -1].astype(np.int64)
        place = telemetry % self._length
        applied = np.where(self._position_sequence[place] == telemetry, self._applied_in[place], 0)
        here = (applied > 0) & (self._sequence[applied % self._length] == applied)
        trips: Array = np.where(here, rows[:, 0] - self._rows[applied % self._length, 0], NAN)
        return trips

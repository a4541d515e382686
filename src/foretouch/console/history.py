"""The last seconds of a session, stored in a step and read as a window of points; what is lost, how late loops are."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.recfunctions import repack_fields
from numpy.typing import NDArray

from foretouch.messages import (
    CHANNELS,
    FOLLOWER_DTYPE,
    LEADER_DTYPE,
    WITH_THE_COMMANDS,
    LeaderState,
    Telemetry,
    split_texts,
)
from foretouch.quantities import Rows

Array = NDArray[np.float64]
NAN = math.nan
CONTACT_FLOOR = 0.05
"""True force [N] above which a sample counts for the errors shown."""
LARGEST_GAP = 50  # Commands in a row without a true force that a line may bridge
KNOWN = ("delayed_force", "standard_deviation", "rendered_force", "energy", "energy_bound", "late_energy")
"""Columns of a leader's tick that stay as they are."""
LEADER = ("sequence", "time_ns", "position", "predicted_force", "telemetry_sequence", "epoch", "compute_ns", *KNOWN)
FOLLOWER = (
    *("sequence", "time_ns", "position", "command_sequence", "force", "status", "epoch", "run"),
    *("sensor_force", "exact_force", "model_sequence"),
)
"""Fields of both sides' ticks that are kept."""


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
        away: Whether the robot was not at its commanded position: it held its position, or was on its way back.
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
    """The seconds before a moment on the leader's time [s], of `columns_of`, thinned to a number of points."""
    time = columns[:, 0] - now
    inside = (time >= -seconds) & (time <= 0.0)
    sequence, columns, time = sequence[inside], columns[inside], time[inside]
    if len(sequence) == 0:
        return empty_window()
    bridged, never_applied = _bridged(sequence, columns[:, 9])
    true, away = columns[:, 9], (columns[:, 10] > 0.0) | never_applied
    contact = (true > CONTACT_FLOOR) & np.isfinite(columns[:, 1]) & ~away
    prediction_error, delayed_error, rendered_error = (
        _error(columns[contact, column], true[contact]) for column in (1, 2, 4)
    )
    stride = 1 << max(0, math.ceil(math.log2(len(sequence) / points)))  # a power of two: it seldom changes
    shown = sequence % stride == 0
    drawn = columns[shown].T
    return Window(
        time[shown], drawn[1], drawn[2], bridged[shown], prediction_error, delayed_error, drawn[3], drawn[4],
        drawn[5], drawn[6], drawn[7], drawn[8], away[shown], rendered_error,
    )  # fmt: skip


def _error(force: Array, true: Array) -> float:
    if len(true) == 0:
        return NAN
    return float(100.0 * np.sqrt(np.mean((force - true) ** 2) / np.mean(true**2)))


def _bridged(sequence: NDArray[np.int64], true: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The true force with straight lines over commands that were never applied, where only a few are missing.

    It also marks the commands in a gap that no line bridges: the robot went on, and never took them.
    """
    finite = np.isfinite(true)
    known = np.flatnonzero(finite)
    if len(known) == 0:
        return true, np.zeros(len(true), np.bool_)
    after = np.searchsorted(known, np.arange(len(true)))
    between = ~finite & (after > 0) & (after < len(known))
    here, before = known[np.minimum(after, len(known) - 1)], known[np.maximum(after - 1, 0)]
    near = sequence[here] - sequence[before] <= LARGEST_GAP
    lines: Array = np.interp(sequence, sequence[known], true[known])
    return np.where(between & near, lines, np.where(finite, true, NAN)), between & ~near


OVER, KEPT, MOST = 2.5, 10.0, 1024
"""Time over which a percentage of lost messages is taken and for which it is kept [s], and the number of counters kept
per side; each side sends them twice a second."""
COUNTERS = {"follower": ("commands_lost", CHANNELS["command"].rate), "leader": ("telemetry_lost", 1000.0)}
"""By the side that counts: the counter, and the messages a second of which it counts the lost ones."""
LATE_NS, LOOKS = 1_500_000, 6
"""A tick is late if it begins more than this after the one before [ns]; percentages are over this many looks."""
LATE = 5.0  # Fraction of late ticks from which a machine is reported as late [%]; a quiet one has about 1 %
GIVE_WAY, TAKE_BACK = 0.6, 1.15
"""Factors on the picture rate at a look while the loops are late, and while they are not."""
SLOWEST, FASTEST = 4.0, 30.0
"""Pictures a second. Fewer than the slowest, and the page could not tell a slow console from one that is gone."""


class LossTrace(NamedTuple):
    """Losses of commands there, of telemetry back [%], over seconds before now.

    `sent` are the bytes a second that leader and follower send over a thin link now; NaN where they send all messages.
    """

    time: Array
    there: Array
    back: Array
    sent: tuple[float, float] = (NAN, NAN)


def _append(counts: deque[tuple[float, int]], now: float, count: int) -> None:
    """Append a counter, and drop what is too old, or of a process that began anew."""
    if counts and count < counts[-1][1]:
        counts.clear()
    counts.append((now, count))
    while len(counts) > 2 and counts[0][0] < now - OVER:
        counts.popleft()


class Losses:
    """Counters of both sides as they come, and the fractions computed from them; one thread stores, another reads."""

    def __init__(self) -> None:
        self._counts: dict[str, deque[tuple[float, int]]] = {role: deque(maxlen=MOST) for role in COUNTERS}
        self._shares: deque[tuple[float, float, float]] = deque(maxlen=MOST)
        self._newest = dict.fromkeys(COUNTERS, NAN)
        self._bytes: dict[str, deque[tuple[float, int]]] = {role: deque(maxlen=MOST) for role in COUNTERS}
        self._sent = dict.fromkeys(COUNTERS, NAN)

    def _take_bytes(self, role: str, count: int, now: float) -> None:
        """Store the bytes that a side has sent over a thin link."""
        counts = self._bytes[role]
        _append(counts, now, count)
        since, before = counts[0]
        self._sent[role] = (count - before) / (now - since) if now > since else NAN

    def take(self, role: str, texts: Mapping[str, str], now: float) -> None:
        """Store the counters in the texts of a side's `Hello`, received at a time [s]."""
        if role not in COUNTERS:
            return
        name, rate = COUNTERS[role]
        told = split_texts(texts)[1]
        if (sent := told.get(f"{role}_thin_bytes")) is not None:
            self._take_bytes(role, sent, now)
        counts, count = self._counts[role], told.get(name)
        if count is None:
            return
        _append(counts, now, count)
        since, before = counts[0]
        if now > since:
            self._newest[role] = min(100.0 * (count - before) / (rate * (now - since)), 100.0)
            self._shares.append((now, self._newest["follower"], self._newest["leader"]))
        while self._shares and self._shares[0][0] < now - KEPT:
            self._shares.popleft()

    def trace(self, now: float, seconds: float) -> LossTrace:
        """The last seconds."""
        rows = np.array([row for row in tuple(self._shares) if row[0] >= now - seconds]).reshape(-1, 3)
        return LossTrace(rows[:, 0] - now, rows[:, 1], rows[:, 2], (self._sent["leader"], self._sent["follower"]))


class Lateness:
    """Lateness of the ticks of both sides, and the number of pictures per second that leaves them their processor.

    Drawing on the machine of the loops takes processor time from them; while they are late, fewer pictures are drawn.
    One thread calls `take`, another `look`.

    Attributes:
        late: Fraction of late ticks over the last looks [%], by side.
        pictures: Number of pictures to draw per second.
    """

    def __init__(self) -> None:
        self._counted = {"leader": [0, 0], "follower": [0, 0]}
        self._looks: deque[dict[str, tuple[int, int]]] = deque(maxlen=LOOKS)
        self.late: Mapping[str, float] = {}
        self.pictures = FASTEST / 2

    def take(self, side: str, period_ns: int) -> None:
        """Count a tick of a side, given the time since the beginning of the one before [ns]."""
        counted = self._counted[side]
        counted[0] += 1
        counted[1] += period_ns > LATE_NS

    def look(self) -> None:
        """Update the fractions and the number of pictures; to be called about twice a second."""
        now = {side: (ticks, late) for side, (ticks, late) in self._counted.items()}
        if self._looks:
            newest = _shares(self._looks[-1], now)
            if newest:
                factor = GIVE_WAY if max(newest.values()) > LATE else TAKE_BACK
                self.pictures = min(max(self.pictures * factor, SLOWEST), FASTEST)
            self.late = _shares(self._looks[0], now)
        self._looks.append(now)


def _shares(before: Mapping[str, tuple[int, int]], now: Mapping[str, tuple[int, int]]) -> dict[str, float]:
    """Fraction of late ticks [%] between two counts, for each side that made any."""
    made = {side: (now[side][0] - before[side][0], now[side][1] - before[side][1]) for side in now}
    return {side: 100.0 * late / ticks for side, (ticks, late) in made.items() if ticks}


_of_leader, _of_follower = attrgetter(*LEADER), attrgetter(*FOLLOWER)


class History:
    """Ring buffers, addressed by sequence number, so that storing a message costs the same however many came before.

    One thread stores, another reads. A reader may meet a row that is being written; sequence numbers tell rows of an
    older lap from those of this one, and a picture shows one such sample for one frame at worst.
    """

    def __init__(self, length: int = 8192) -> None:
        self._leader = np.zeros(length, repack_fields(LEADER_DTYPE[[*LEADER]]))
        self._follower = np.zeros(length, repack_fields(FOLLOWER_DTYPE[[*FOLLOWER]]))
        self._length = length
        self._newest = self._newest_telemetry = 0

    def add_leader(self, state: LeaderState) -> None:
        """Store one leader tick."""
        self._leader[state.sequence % self._length] = _of_leader(state)
        self._newest = state.sequence

    def add_telemetry(self, telemetry: Telemetry) -> None:
        """Store a follower tick."""
        self._follower[telemetry.sequence % self._length] = _of_follower(telemetry)
        self._newest_telemetry = telemetry.sequence

    def follower_position(self, telemetry_sequence: int) -> float:
        """Position [m] in one telemetry, NaN where it is not here."""
        row = self._follower[telemetry_sequence % self._length]
        known = telemetry_sequence > 0 and row["sequence"] == telemetry_sequence
        return float(row["position"]) if known else NAN

    def rows(self, newest: int = 0) -> tuple[Rows, Rows]:
        """Ticks of the leader up to its newest, or another, and of the follower, the oldest first."""
        newest = newest or self._newest
        sequence = np.arange(max(1, newest - self._length + 2), newest + 1)
        here = self._leader["sequence"][sequence % self._length] == sequence
        oldest_first = (np.arange(self._length) + self._newest_telemetry + 1) % self._length
        there = oldest_first[self._follower["sequence"][oldest_first] > 0]
        return _taken(self._leader, sequence[here] % self._length), _taken(self._follower, there)

    def window(self, seconds: float = 6.0, points: int = 400, newest: int = 0) -> Window:
        """The seconds before the leader's newest tick, or another, always the same ticks while they stay within."""
        leader, follower = self.rows(newest)
        if not len(leader):
            return empty_window()
        columns = columns_of(leader, follower, "force")
        return window_of(leader["sequence"], columns, float(columns[-1, 0]), seconds, points)


def _taken(rows: Rows, where: NDArray[Any]) -> Rows:
    """Some of the rows, whose fields are of 8 bytes each: as plain numbers they are copied ten times as fast."""
    return rows.view(np.int64).reshape(len(rows), -1)[where].view(rows.dtype)[:, 0]


def columns_of(leader: Rows, follower: Rows, force: str) -> Array:
    """Figures of a window for each tick of one leader's process, shape (n, 11).

    Leader time [s], predicted, delayed force, deviation, rendered force [N], energy, its bound, late energy [J], round
    trip [s], true force [N], a column of the follower, and whether the robot was away then (1 or 0). Rows are those of
    a `SessionLog`, the leader's by sequence, the follower's by process and sequence; of several for one command the
    first counts.
    """
    seconds = leader["time_ns"] * 1e-9
    predicted = np.where(np.isfinite(leader["position"]), leader["predicted_force"], NAN)  # of no motion there is none
    true, trips, away = np.full(leader.size, NAN), np.full(leader.size, NAN), np.zeros(leader.size)
    ours = (follower["epoch"] == 0) | (follower["epoch"] == leader["epoch"][-1])
    commands = np.where(ours, follower["command_sequence"], 0)
    applied, given = np.flatnonzero(commands), commands[commands > 0]
    if given.size:
        first = np.minimum(np.searchsorted(given, leader["sequence"]), given.size - 1)
        known = given[first] == leader["sequence"]
        at = applied[first[known]]
        true[known] = follower[force][at]
        away[known] = ~np.isin(follower["status"][at], WITH_THE_COMMANDS)
    # Age of the motion that the newest telemetry at each tick answers.
    answers = commands[follower["run"] == follower["run"][-1:]]
    if answers.size:
        sequence = follower["sequence"][-answers.size :]
        row = np.searchsorted(sequence, leader["telemetry_sequence"], side="right") - 1
        at = np.minimum(np.searchsorted(leader["sequence"], answers[row]), leader.size - 1)
        here = (row >= 0) & (leader["telemetry_sequence"] > 0) & (leader["sequence"][at] == answers[row])
        trips[here] = (seconds - seconds[at])[here]
    rest = (leader[name] for name in KNOWN)
    columns: Array = np.column_stack([seconds, predicted, *rest, trips, true, away])
    return columns

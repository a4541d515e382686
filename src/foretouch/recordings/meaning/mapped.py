"""A recording out of an opened table or bag, by a map.

Of two topics of a bag: which clock is taken, and how positions come to the times of forces.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural, was_or_were
from foretouch.quantities import Recording
from foretouch.recordings.meaning.guess import LEAST_RATE
from foretouch.recordings.meaning.mapping import FORCES, LENGTHS, TIMES, Mapping, to_si
from foretouch.recordings.source import Bag, Series, Table

Array = NDArray[np.float64]

DEEPER_WITH_LESS_FORCE = -0.5
"""Correlation of position and force below which positions look as if they shrank with depth."""
LOOKED_AT = 100_000  # number of samples that tell whether signs look wrong
LEAST_CHANGE = 1e-9  # change, over the largest value, below which signs are not commented on


def read_mapped(source: Table | Bag, mapping: Mapping) -> tuple[Recording, list[str]]:
    """The recording, and sentences on how its samples came to one time."""
    recording, notes = (_of_table(source, mapping), []) if isinstance(source, Table) else _of_bag(source, mapping)
    return recording, [*notes, *_uncertainties(recording)]


def _of_table(table: Table, mapping: Mapping) -> Recording:
    if not mapping.position.column:
        raise RecordingError(table.path, f"is a table ({table.format}): its map takes column, not topic and field")
    time, velocity = mapping.time, mapping.velocity
    if bool(time.column) == bool(time.rate):
        raise RecordingError(table.path, "its map takes [time] column, or rate where no column has the time")
    wanted = [mapping.position.column, mapping.force.column, *([velocity.column] if velocity else [])]
    names = list(dict.fromkeys([*([time.column] if time.column else []), *wanted]))
    columns = table.read(names)
    lengths = {name: column.size for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise RecordingError(table.path, f"columns of unequal length: {text}; take those of one measurement")
    position, force = columns[mapping.position.column], columns[mapping.force.column]
    seconds = np.arange(position.size) / time.rate if time.rate else columns[time.column] / TIMES[time.unit]
    speed = None if velocity is None else to_si(columns[velocity.column], mapping.position, LENGTHS)
    try:
        return Recording(
            seconds,
            to_si(position, mapping.position, LENGTHS),
            to_si(force, mapping.force, FORCES),
            speed,
            name=str(table.path),
            contact_floor=mapping.contact_floor,
            first_row=table.first_row,
        )
    except RecordingError as error:
        if error.row is None:
            raise
        row = table.row_of(error.row - table.first_row)
        problem = str(error).removeprefix(f"{table.path}, row {error.row}: ")
        raise RecordingError(table.path, problem, row=row) from None


def _of_bag(bag: Bag, mapping: Mapping) -> tuple[Recording, list[str]]:
    position, force, time = mapping.position, mapping.force, mapping.time
    if not position.topic:
        raise RecordingError(bag.path, f"is a bag ({bag.format}): its map takes topic and field, not column")
    if time.column or time.rate:
        raise RecordingError(bag.path, "is a bag, whose messages have their times: its map takes [time] stamp only")
    extra = [mapping.velocity.field] if mapping.velocity else []
    together = position.topic == force.topic
    wanted = [position.field, *extra, *([force.field] if together else [])]
    series = [bag.read(position.topic, list(dict.fromkeys(wanted)))]
    if not together:
        series.append(bag.read(force.topic, [force.field]))
    for one in series:
        _require_finite(bag, one)
    notes = [
        f"{plural(one.left_out, 'message')} of {one.topic} without these fields {was_or_were(one.left_out)} left out"
        for one in series
        if one.left_out
    ]
    times, text = clock_of(bag.path, series, time.stamp)
    notes += text
    ordered = []
    for one, at in zip(series, times, strict=True):
        own = {f"{one.topic} {name}": column for name, column in one.values.items()}
        ordered_times, ordered_columns, text = in_time(one.topic, at, own)
        ordered.append((ordered_times, ordered_columns))
        notes += text
    at_force, columns = ordered[0]
    notes += _too_rare(position.topic, at_force)
    if not together:
        at_force, columns, text = at_force_times(bag.path, mapping.join, *ordered[0], *ordered[1])
        notes += text
    since = at_force - (at_force[:1] if time.start == "first" else 0)
    speed = None if not extra else to_si(columns[f"{position.topic} {extra[0]}"], position, LENGTHS)
    recording = Recording(
        since / 1e9,
        to_si(columns[f"{position.topic} {position.field}"], position, LENGTHS),
        to_si(columns[f"{force.topic} {force.field}"], force, FORCES),
        speed,
        name=str(bag.path),
        contact_floor=mapping.contact_floor,
    )
    return recording, notes


def _too_rare(topic: str, times: NDArray[np.int64]) -> list[str]:
    """A sentence where positions come so rarely that a press lies between two of them."""
    rate = 1e9 / float(np.median(np.diff(times))) if times.size > 1 else 0.0
    if rate >= LEAST_RATE:
        return []
    return [f"positions of {topic} come {rate:.3g} times a second: a press that is felt needs {LEAST_RATE:g} or more"]


def _require_finite(bag: Bag, series: Series) -> None:
    for name, values in series.values.items():
        for message in np.flatnonzero(~np.isfinite(values))[:1]:
            what = f"{series.topic}: {name} of message {message + 1} is {values[message]}"
            raise RecordingError(bag.path, f"{what}: every value must be finite")


def falls_with_depth(recording: Recording) -> bool:
    """Whether the force falls where the probe is deeper: the sign of one of them is wrong, as it seems."""
    return _together(*_seen(recording)) < DEEPER_WITH_LESS_FORCE


def _uncertainties(recording: Recording) -> list[str]:
    """A sentence where signs look wrong: what presses is deeper, and its force positive."""
    position, force = _seen(recording)
    if _still(position) or _still(force):
        return []
    notes, turned = [], force.min() < 0.0 and -force.min() > 2.0 * force.max()
    if turned:
        notes.append("forces are mostly negative: under load, [force] sign = -1, or --flip-force, turns them")
    if _together(position, -force if turned else force) < DEEPER_WITH_LESS_FORCE:
        notes.append("positions shrink as the force grows: [position] sign = -1, or --flip, turns them")
    return notes


def _seen(recording: Recording) -> tuple[Array, Array]:
    """Positions and forces over their largest: of an hour's samples, not all need be looked at."""
    few = slice(None, None, 1 + len(recording) // LOOKED_AT)
    position, force = recording.position[few], recording.force[few]  # the largest may be too large to be squared
    return position / (np.abs(position).max() or 1.0), force / (np.abs(force).max() or 1.0)


def _still(values: Array) -> bool:
    return float(np.ptp(values)) < LEAST_CHANGE


def _together(position: Array, force: Array) -> float:
    """Correlation of position and force, 0 where one of them does not change."""
    return 0.0 if _still(position) or _still(force) else float(np.corrcoef(position, force)[0, 1])


Times = NDArray[np.int64]

CLOCKS_AGREE: Final = 0.05
"""Header stamps of two topics are taken for one clock while their distances from log time differ by less [s]; networks
and recorders alone make some milliseconds."""

LEAST_SAID: Final = 2e-3  # smaller distances [s] are what networks make
LARGEST_GAP: Final = 0.1  # forces within a longer time without a position [s] are left out (or than ten of its periods)


class Clocks(NamedTuple):
    """How far the header stamps of topics lie from log time."""

    topics: tuple[str, ...]  # names
    medians: tuple[float, ...]  # median of log time less stamp, for each [s]
    spread: float  # largest range of the middle half of that, over the topics [s]
    jitter: float  # largest range of the middle nine tenths [s]
    period: float  # sample period of the less frequent topic [s]

    @property
    def apart(self) -> float:
        """Distance of the medians [s]."""
        return max(self.medians) - min(self.medians)

    @property
    def differ(self) -> bool:
        """Whether that is more than the spread of its own estimate, one sample, and what networks make."""
        return len(self.topics) > 1 and self.apart > max(LEAST_SAID, self.spread, self.period)

    @property
    def text(self) -> str:
        """The medians, for people."""
        each = (f"{_seconds(median)} for {topic}" for topic, median in zip(self.topics, self.medians, strict=True))
        return f"log time less stamp is {' and '.join(each)}, medians"


def clocks_of(series: list[Series]) -> Clocks | None:
    """The distances of the stamps of each series from log time, None where one has no stamps."""
    stamps = [one.stamp_ns for one in series if one.stamp_ns is not None]
    if not stamps or len(stamps) < len(series):
        return None
    late = [(one.log_ns - stamp) / 1e9 for one, stamp in zip(series, stamps, strict=True)]
    steps = [float(np.median(np.abs(np.diff(stamp)))) / 1e9 for stamp in stamps if stamp.size > 1]
    return Clocks(
        tuple(one.topic for one in series),
        tuple(float(np.median(one)) for one in late),
        max(float(np.subtract(*np.percentile(one, (75, 25)))) for one in late),
        max(float(np.subtract(*np.percentile(one, (95, 5)))) for one in late),
        max(steps, default=0.0),
    )


def clock_of(source: object, series: list[Series], asked: str) -> tuple[list[Times], list[str]]:
    """The times of each series, all by one clock, and sentences on which one and why.

    Header stamps are when a sensor measured; log time is later by what network and recorder took, and differently late
    from message to message. So stamps are taken, as long as those of all topics are on one clock: that is so where they
    lie equally far from log time. Where they do not, either clocks differ or one topic takes longer to the recorder,
    and the file does not say which: within `CLOCKS_AGREE` stamps are taken as they are, and the distance is noted.
    """
    log = [one.log_ns for one in series]
    if asked == "log":
        return log, ["log time is taken, as the map says"]
    stamps = [one.stamp_ns for one in series if one.stamp_ns is not None]
    clocks = clocks_of(series)
    if clocks is None:
        bare = next(one.topic for one in series if one.stamp_ns is None)
        if asked != "auto":
            problem = f'messages of {bare} carry no stamp: [time] stamp = "log" takes the recorder\'s time'
            raise RecordingError(source, problem)
        others = " for both" if len(series) > 1 else ""
        return log, [f"messages of {bare} carry no stamp: log time is taken{others}"]
    if asked == "aligned":
        return _aligned(stamps, clocks)
    if len(series) > 1 and clocks.apart > CLOCKS_AGREE:
        names = " and ".join(clocks.topics)
        problem = f"header stamps of {names} are on two clocks {_seconds(clocks.apart)} apart ({clocks.text})"
        if asked == "header":
            return stamps, [f"{problem}; stamps are taken all the same, as the map says"]
        how = f"log time is taken for both, which jitters by {_seconds(clocks.jitter)}"
        return log, [f'{problem}; {how}; [time] stamp = "aligned" takes stamps, less that distance']
    if asked == "auto" and clocks.differ:
        problem = f"{clocks.text}: two clocks {_seconds(clocks.apart)} apart, or one topic that is that much later"
        remedy = '[time] stamp = "aligned" takes them less that distance'
        return stamps, [f"{problem}; header stamps are taken as they are, {remedy}"]
    notes = []
    if max(map(abs, clocks.medians)) > CLOCKS_AGREE:
        notes = [f"header stamps and log time are {_seconds(clocks.medians[0])} apart; header stamps are taken"]
    return stamps, notes


def _aligned(stamps: list[Times], clocks: Clocks) -> tuple[list[Times], list[str]]:
    """Stamps, the first series moved so that its median distance from log time is that of the last."""
    if len(stamps) < 2:
        return stamps, []
    shift = clocks.medians[0] - clocks.medians[-1]
    text = f"stamps of {clocks.topics[0]} are moved by {_seconds(shift)} (spread {_seconds(clocks.spread)})"
    return [stamps[0] + round(shift * 1e9), *stamps[1:]], [f"{text}, as the map says: {clocks.text}"]


def in_time(topic: str, times: Times, columns: dict[str, Array]) -> tuple[Times, dict[str, Array], list[str]]:
    """The samples in the order of their times, one for each time, and a sentence where some had to go."""
    step = np.diff(times)
    if (step > 0).all():
        return times, columns, []
    order = np.argsort(times, kind="stable")
    times = times[order]
    first = np.concatenate(([True], np.diff(times) > 0))
    columns = {name: column[order][first] for name, column in columns.items()}
    turned, double = int((step < 0).sum()), int((~first).sum())
    sentences = [f"{plural(turned, 'message')} out of order, put back into it"] if turned else []
    sentences += [f"{plural(double, 'message')} with the time of the one before, left out"] if double else []
    return times[first], columns, [f"{topic}: {' and '.join(sentences)}"]


def at_force_times(
    source: object,
    method: str,
    position_ns: Times,
    position: dict[str, Array],
    force_ns: Times,
    force: dict[str, Array],
) -> tuple[Times, dict[str, Array], list[str]]:
    r"""Samples at the times of the forces [ns], increasing, shape (n,): their columns, and sentences on how.

    ``interpolate`` takes the line between the two positions around,

    .. math:: x(t) = x_i + (x_{i+1} - x_i) (t - t_i) / (t_{i+1} - t_i)

    which errs by the square of the period of positions, and looks less than one such period ahead. ``hold`` takes the
    last position before, which a causal system has too; it lags by half a period on average, which looks like damping.
    """
    if np.array_equal(position_ns, force_ns):
        return force_ns, position | force, []
    before = np.searchsorted(position_ns, force_ns, side="right") - 1
    inside = (before >= 0) & (force_ns <= position_ns[-1])
    if inside.sum() < 2:
        spans = " and ".join(f"{at[0] / 1e9:.3f} to {at[-1] / 1e9:.3f} s" for at in (position_ns, force_ns))
        remedy = 'if their stamps are on two clocks, give [time] stamp = "aligned" or "log"'
        raise RecordingError(source, f"positions and forces have no time in common ({spans}): {remedy}")
    gaps = np.diff(position_ns)
    longest = max(int(LARGEST_GAP * 1e9), 10 * int(np.median(gaps)))
    after = np.minimum(before + 1, position_ns.size - 1)
    wide = position_ns[after] - position_ns[np.maximum(before, 0)] > longest
    hole = inside & wide & (position_ns[before] != force_ns)
    kept = inside & ~hole
    times = force_ns[kept]
    if method == "hold":
        joined = {name: column[before[kept]] for name, column in position.items()}
    else:
        at, known = (times - position_ns[0]) / 1e9, (position_ns - position_ns[0]) / 1e9
        joined = {name: np.interp(at, known, column) for name, column in position.items()}
    rates = " and ".join(f"{1e9 / float(np.median(np.diff(at))):.5g}" for at in (position_ns, force_ns))
    ways = {
        "interpolate": "positions are interpolated to the times of forces, for holding the last one lags, which looks "
        'like damping (it looks ahead by less than one position; join = "hold" does not)',
        "hold": "the last position before each force is held, which is causal and lags by half a period of positions",
    }
    notes = [f"positions and forces come {rates} times a second: {ways[method]}"]
    if not inside.all():
        notes.append(f"{int((~inside).sum())} forces before the first or after the last position are left out")
    if hole.any():
        notes.append(
            f"{int(hole.sum())} forces in times of more than {longest / 1e9:.3g} s without a position are left out"
        )
    return times, joined | {name: column[kept] for name, column in force.items()}, notes


def _seconds(seconds: float) -> str:
    return f"{seconds:.6g} s" if abs(seconds) >= 1.0 else f"{1e3 * seconds:.4g} ms"

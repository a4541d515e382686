"""A recording out of an opened table or bag, by a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural, was_or_were
from foretouch.quantities import Recording
from foretouch.recordings.meaning.joining import at_force_times, clock_of, in_time
from foretouch.recordings.meaning.mapping import FORCES, LENGTHS, TIMES, Mapping, to_si
from foretouch.recordings.meaning.topic_choice import LEAST_RATE
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
        joined = at_force_times(bag.path, mapping.join, *ordered[0], *ordered[1])
        at_force, columns = joined.time_ns, joined.columns
        notes += joined.notes
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
        bad = ~np.isfinite(values)
        if bad.any():
            message = int(np.argmax(bad))
            problem = (
                f"{series.topic}: {name} of message {message + 1} is {values[message]}: every value must be finite"
            )
            raise RecordingError(bag.path, problem)


def _of_size_one(values: Array) -> Array:
    """Values over the largest of them, which may be too large to be squared."""
    largest = float(np.abs(values).max())
    return values / largest if largest > 0.0 else values


def falls_with_depth(recording: Recording) -> bool:
    """Whether the force falls where the probe is deeper: the sign of one of them is wrong, as it seems."""
    position, force = _seen(recording)
    return _together(position, force) < DEEPER_WITH_LESS_FORCE


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
    return _of_size_one(recording.position[few]), _of_size_one(recording.force[few])


def _still(values: Array) -> bool:
    return float(np.ptp(values)) < LEAST_CHANGE


def _together(position: Array, force: Array) -> float:
    """Correlation of position and force, 0 where one of them does not change."""
    return 0.0 if _still(position) or _still(force) else float(np.corrcoef(position, force)[0, 1])

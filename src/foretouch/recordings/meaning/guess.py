"""Guesses a map from names, units and message types; what cannot be guessed stays open and is reported."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import msgspec
import numpy as np

from foretouch.errors import RecordingError
from foretouch.recordings.meaning.mapping import (
    FORCES,
    LENGTHS,
    NEEDS_SCALE,
    TIMES,
    UNKNOWN,
    Mapping,
    Signal,
    TimeSource,
    Velocity,
    check_mapping,
    mapping_text,
    parse_mapping,
)
from foretouch.recordings.meaning.names import (
    BY_WORD,
    FORCE,
    POSITION,
    TIME,
    VELOCITY,
    Named,
    RecordingOptions,
    name_says,
    rank,
    robot_column,
)
from foretouch.recordings.source import Bag, Column, Table, Topic, listed

HELP = "`foretouch recordings inspect` writes what is known with --save FILE.toml: complete it, and give it with --map"

UNIT_OPTIONS = {"position": "--position-unit mm", "force": "--force-unit N"}
"""What says a unit that is not known, by example."""

_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?\s*\Z", re.IGNORECASE)

NAMED = 5  # number of candidates that are named in a sentence, or in a map that is to be completed


@dataclass(frozen=True)
class Guess:
    """A map as far as it can be guessed."""

    path: object  # path of the recording
    time: TimeSource = field(default_factory=TimeSource)  # times of its samples
    # position of the probe, None where no column fits, or several; its unit may be `UNKNOWN`
    position: Signal | None = None
    force: Signal | None = None  # force of the sensor, likewise
    velocity: Velocity | None = None  # velocity of the probe, where it is there
    problems: tuple[str, ...] = ()  # one sentence for each thing that is open
    notes: tuple[str, ...] = ()  # one sentence for each thing that should be known of what was guessed
    # what `position` and `force` might be, where there are several; the likeliest first
    candidates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    stated: Mapping | None = None  # the map that the file carries, which then is taken

    @property
    def open(self) -> tuple[str, ...]:
        """One sentence for each item that a map must still state; none where the guess is complete."""
        if self.stated is not None:
            return ()
        sentences = list(self.problems)
        for name, signal, units in (("position", self.position, LENGTHS), ("force", self.force, FORCES)):
            if signal is not None and signal.unit == UNKNOWN:
                sentences.append(f"the unit of {_called(name, signal)} is not known ({', '.join(units)})")
            elif signal is not None and signal.unit in NEEDS_SCALE:
                needed = NEEDS_SCALE[signal.unit]
                sentences.append(f"{_called(name, signal)} is in {signal.unit} and needs a scale, {needed}")
        return tuple(sentences)

    def mapping(self) -> Mapping:
        """The map, if nothing is open."""
        if self.stated is not None:
            return self.stated
        if self.open or self.position is None or self.force is None:
            raise RecordingError(self.path, self._what_to_do())
        return check_mapping(self.path, Mapping(self.position, self.force, self.time, self.velocity))

    def _what_to_do(self) -> str:
        signals = {"position": self.position, "force": self.force}
        unknown = [name for name, signal in signals.items() if signal is not None and signal.unit == UNKNOWN]
        if None in signals.values() or self.problems or len(unknown) < len(self.open):
            return f"{self.open[0]}; {HELP}"
        options = " and ".join(UNIT_OPTIONS[name] for name in unknown)
        return f"{'; '.join(self.open)}: give {options}, say; or {HELP}"

    def in_units(self, options: RecordingOptions) -> Guess:
        """The same with units where the file states none, and with positions or forces turned round."""
        position = self._with(self.position, "position", options.position_unit, options.flip)
        force = self._with(self.force, "force", options.force_unit, options.flip_force)
        stated = self.stated
        if stated is not None and position is not None and force is not None:
            stated = msgspec.structs.replace(stated, position=position, force=force)
        return replace(self, position=position, force=force, stated=stated)

    def _with(self, signal: Signal | None, name: str, unit: str | None, flip: bool) -> Signal | None:
        if signal is not None and flip:
            signal = msgspec.structs.replace(signal, sign=-1 if signal.sign == 1 else 1)
        if signal is None or unit is None:
            return signal
        if signal.unit not in (UNKNOWN, unit):
            problem = f"{_called(name, signal)} is in {signal.unit}: leave --{name}-unit out, or give a --map"
            raise RecordingError(self.path, problem)
        return msgspec.structs.replace(signal, unit=unit)

    def text(self) -> str:
        """The map as TOML to be completed: what is open stands as ``?`` or as a comment."""
        if self.stated is not None:
            return f"# stated by the file itself\n{mapping_text(self.stated)}"
        comments = ["# lines with # are remarks: fill in below what is open, and delete them"] if self.open else []
        comments += [f"# {note}" for note in self.notes]
        comments += [f"# open: {problem}" for problem in self.open]
        for name, candidates in self.candidates.items():
            if len(candidates) > 1:
                comments += [f"# {name} could be {candidate}" for candidate in candidates[:NAMED]]
            if len(candidates) > NAMED:
                comments.append(f"# and {len(candidates) - NAMED} more")
        blank = Signal(column=UNKNOWN) if self.time.column or self.time.rate else Signal(topic=UNKNOWN, field=UNKNOWN)
        mapping = Mapping(self.position or blank, self.force or blank, self.time, self.velocity)
        return "\n".join([*comments, mapping_text(mapping)])


def _called(quantity: str, signal: Signal) -> str:
    """A signal for people: its column alone where that is named like its quantity."""
    named = rank(quantity, name_says(signal.column))[0] >= BY_WORD
    return signal.place if named else f"the {quantity} {signal.place}"


def guess_mapping(source: Table | Bag) -> Guess:
    """Guess which column or field is time, position, force and velocity.

    A map that the file carries, as those of `convert_recording` do, is taken as it is. Else columns go by the words and
    units in their names, in several languages; topics by the type of their messages and by how often these come
    (`choose_topic`). Several that fit equally well are not chosen from.
    """
    if source.stated_map:
        stated = parse_mapping(f"{source.path}: the map in it", source.stated_map)
        return Guess(source.path, stated.time, stated.position, stated.force, stated.velocity, stated=stated)
    return _of_table(source) if isinstance(source, Table) else _of_bag(source)


def _of_table(table: Table) -> Guess:
    named = {column.name: name_says(column.name, column.unit) for column in table.columns}
    if named and all(_NUMBER.match(name) for name in named):
        problem = f"columns have no names but numbers ({listed(named)}): write a line above them that names them"
        return Guess(table.path, TimeSource(column=UNKNOWN), problems=(problem,))
    problems: list[str] = []
    candidates: dict[str, tuple[str, ...]] = {}
    values: dict[str, tuple[str, str]] = {}
    for quantity in (TIME, POSITION, FORCE):
        ranked = {column.name: _rank(quantity, column.name, named[column.name]) for column in table.columns}
        best = max((score for score, _ in ranked.values()), default=0.0)
        names = [name for name, (score, _) in ranked.items() if score == best and best > 0.0]
        if len(names) == 1:
            values[quantity] = names[0], ranked[names[0]][1]
            continue
        candidates[quantity] = tuple(names)
        there = listed(column.name for column in table.columns)
        several = f"several columns could be {quantity}: {listed(names)}"
        problems.append(several if names else f"no column is named like {quantity}; the columns are {there}")
    for quantity, (name, unit) in values.items():
        own = rank(quantity, name_says(name))[1]
        if own and unit != own:
            problems.append(f"column {name} is in {own} by its name, and in {unit} as the file states it elsewhere")
    time, unit = values.get(TIME, (UNKNOWN, "s"))
    if TIME in values and not unit:
        unit = "s"  # that of nearly all; a time in another unit has steps that `read_with_notes` looks at
        if named[time].unit:
            problems.append(f"the unit of time {time} is not known ({', '.join(TIMES)})")
    position, force = (
        Signal(column=values[name][0], unit=values[name][1] or UNKNOWN) if name in values else None
        for name in (POSITION, FORCE)
    )
    source, velocity = TimeSource(column=time, unit=unit), _velocity(table.columns, position)
    notes = _frame_notes(position, force)
    return Guess(table.path, source, position, force, velocity, tuple(problems), notes, candidates)


def _rank(quantity: str, column: str, named: Named) -> tuple[float, str]:
    """How well a column fits a quantity, by its words or because a robot's interface always names it so; its unit."""
    known = robot_column(column)
    if known is None:
        return rank(quantity, named)
    return (known.rank, known.unit) if known.quantity == quantity else (0.0, "")


def _frame_notes(*signals: Signal | None) -> tuple[str, ...]:
    """Of columns that robots name: what they are, and in which frame."""
    columns = [signal.column for signal in signals if signal is not None]
    return tuple(
        f"{column} is taken for {known.quantity}: {known.text}, z; "
        f"numbers {known.axes[0]} and {known.axes[1]} are x and y (--map takes them)"
        for column in columns
        if (known := robot_column(column)) is not None
    )


def _velocity(columns: tuple[Column, ...], position: Signal | None) -> Velocity | None:
    """The column of velocities, where there is one and its stated unit is the position's per second."""
    results = []
    for column in columns:
        named = name_says(column.name, column.unit)
        unit = named.unit.replace("_s", "/s")
        if position is not None and rank(VELOCITY, named)[0] > 0.0 and unit == f"{position.unit}/s":
            results.append(column.name)
    return Velocity(column=results[0]) if len(results) == 1 else None


def _of_bag(bag: Bag) -> Guess:
    if not any(topic.count for topic in bag.topics):
        return Guess(bag.path, problems=("holds no messages",))
    chosen = {quantity: choose_topic(bag, quantity) for quantity in (POSITION, FORCE)}
    problems = [problem for one in chosen.values() for problem in one.problems]
    notes = [note for one in chosen.values() for note in one.notes]
    for quantity, one in chosen.items():
        if one.signal is not None:
            notes += axis_note(bag, quantity, one.signal)
    candidates = {quantity: one.candidates for quantity, one in chosen.items()}
    position, force = (one.signal for one in chosen.values())
    return Guess(bag.path, TimeSource(), position, force, None, tuple(problems), tuple(notes), candidates)


# --- which topic of a bag: by the type of its messages, and by how often they come ------------------------------------

LEAST_RATE: Final = 20.0
"""What follows a press comes as often [1/s] or more; markers, stages and states of health come more rarely."""

FORCE_FIELDS: Final = {"geometry_msgs/msg/WrenchStamped": "wrench.force.z", "geometry_msgs/msg/Wrench": "force.z"}
"""Types of messages that hold a force in newtons, and its field along z."""

POSITION_FIELDS: Final = {
    "geometry_msgs/msg/PoseStamped": "pose.position.z",
    "geometry_msgs/msg/PointStamped": "point.z",
    "geometry_msgs/msg/TransformStamped": "transform.translation.z",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose.position.z",
    "nav_msgs/msg/Odometry": "pose.pose.position.z",
    "geometry_msgs/msg/Pose": "position.z",
    "geometry_msgs/msg/Point": "z",
}
"""Types of messages that hold a position in metres, and its field along z."""

JOINTS: Final = "sensor_msgs/msg/JointState"
PLAIN: Final = {f"std_msgs/msg/{kind}": "data" for kind in ("Float64", "Float32")}
_OF = {POSITION: (POSITION_FIELDS, "m"), FORCE: (FORCE_FIELDS, "N")}

LOOKED_INTO: Final = 8
"""Number of topics that are looked into, those of most messages first; of other joint states one joint is taken for
a candidate, and of other topics the rate over the whole bag for their rate."""

LARGEST_LOOK: Final = 2**25  # bytes of the first messages, which tell along which axis something moves


@dataclass(frozen=True)
class Candidate:
    """One field that could be the quantity."""

    signal: Signal  # topic, field and unit
    # 3 for a type of message with that quantity, 2 for a joint alone, 1 for a joint among others or a bare number whose
    # topic is named like the quantity; words in a name are no more than that
    standing: int
    count: int  # number of messages
    rate: float  # messages per second [1/s]

    @property
    def text(self) -> str:
        """Place and rate, for people."""
        return f"{self.signal.place} ({self.rate:.4g} a second)"


class Chosen(NamedTuple):
    """What came of it: the only signal that it can be, or what is open with all candidates; and notes."""

    signal: Signal | None
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    candidates: tuple[str, ...]


def choose_topic(bag: Bag, quantity: str) -> Chosen:
    """The one topic that can be a quantity.

    Of the topics that come `LEAST_RATE` times a second or more, those whose type of message fits best; of several none.
    Where no topic comes as often, the same of all; positions that come so rarely are refused, for a press lies between
    two of them.
    """
    results = sorted(_candidates(bag, quantity), key=lambda one: (-one.standing, -one.count))
    if not results:
        types = listed(f"{topic.name} ({topic.type_name})" for topic in bag.topics)
        return Chosen(None, (f"no topic has messages of a type with a {quantity}; its topics: {types}",), (), ())
    names = tuple(one.signal.place for one in results)
    fast = [one for one in results if one.rate >= LEAST_RATE]
    best = [one for one in fast or results if one.standing == (fast or results)[0].standing]
    if len(best) > 1:
        return Chosen(None, (f"several topics could be {quantity}: {_some([one.text for one in best])}",), (), names)
    (one,) = best
    problems, notes = [], []
    if not fast and quantity == POSITION:
        problems.append(
            f"position {one.signal.place} comes {one.rate:.3g} times a second: one that comes less often than "
            f"{LEAST_RATE:g} times is not guessed, for a press lies between two of its messages"
        )
    rivals = [other for other in results if other is not one and other.standing >= one.standing]
    if fast and rivals:
        notes.append(
            f"{quantity} is {one.text}, for no other topic of such messages comes {LEAST_RATE:g} times a second: "
            f"not {_some([other.signal.topic for other in rivals])}"
        )
    return Chosen(one.signal, tuple(problems), tuple(notes), names if problems else ())


def axis_note(bag: Bag, quantity: str, signal: Signal) -> tuple[str, ...]:
    """A sentence where a quantity moves more along another axis than along z, which is assumed."""
    stem, dot, axis = signal.field.rpartition(".")
    if axis != "z":
        return ()
    fields = {name: f"{stem}{dot}{name}" for name in "xyz"}
    try:
        series = bag.read(signal.topic, list(fields.values()), within=LARGEST_LOOK)
    except RecordingError:
        return ()  # the reader of the whole reports why
    moved = {name: float(np.ptp(series.values[field])) for name, field in fields.items()}
    most = max(moved, key=lambda name: moved[name])
    if not moved[most] > moved["z"]:  # so that NaN gives no sentence
        return ()
    unit = signal.unit
    text = f"it moves most along {most} ({_amount(moved[most], unit)} against {_amount(moved['z'], unit)})"
    return (f'{quantity}: z is assumed, but {text}; [{quantity}] field = "{fields[most]}" takes that',)


def _amount(value: float, unit: str) -> str:
    return f"{1e3 * value:.3g} mm" if unit == "m" and value < 1.0 else f"{value:.3g} {unit}"


def _candidates(bag: Bag, quantity: str) -> list[Candidate]:
    fields, unit = _OF[quantity]
    results: list[Candidate] = []
    joints = 0
    for topic in sorted((topic for topic in bag.topics if topic.count), key=lambda topic: -topic.count):
        standing = 1
        if topic.type_name in fields:
            signals, standing = [Signal(topic=topic.name, field=fields[topic.type_name], unit=unit)], 3
        elif topic.type_name == JOINTS and quantity == POSITION:
            joints += 1
            there = [Column("position[0]", "")] if joints > LOOKED_INTO else bag.fields(topic.name)
            names = [column.name for column in there if column.name.startswith("position[")]
            signals, standing = [Signal(topic=topic.name, field=name) for name in names], 2 if len(names) == 1 else 1
        elif topic.type_name in PLAIN and rank(quantity, name_says(topic.name))[0] >= BY_WORD:
            signals = [Signal(topic=topic.name, field=PLAIN[topic.type_name])]
        else:
            continue
        rate = _rate(bag, topic, len(results))
        results += [Candidate(signal, standing, topic.count, rate) for signal in signals]
    return results


def _rate(bag: Bag, topic: Topic, before: int) -> float:
    """Messages a second [1/s], over the whole bag, or over the topic's first ones, whichever is more.

    A topic may be there for a part of the bag's time only.
    """
    if topic.count < 2 or bag.duration <= 0.0:
        return 0.0
    rate = (topic.count - 1) / bag.duration
    known = rate >= LEAST_RATE or topic.count <= LEAST_RATE or before >= LOOKED_INTO
    return rate if known else max(rate, bag.first_rate(topic.name, int(LEAST_RATE) + 1))


def _some(texts: Sequence[str]) -> str:
    named = ", ".join(texts[:NAMED])
    more = len(texts) - NAMED
    return f"{named} and {more} more" if more > 0 else named

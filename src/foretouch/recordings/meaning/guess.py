"""Guesses a map from names, units and message types; what cannot be guessed stays open and is reported."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import msgspec

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
from foretouch.recordings.meaning.topic_choice import axis_note, choose_topic
from foretouch.recordings.source import Bag, Column, Table, listed

HELP = "`foretouch recordings inspect` writes what is known with --save FILE.toml: complete it, and give it with --map"

UNIT_OPTIONS = {"position": "--position-unit mm", "force": "--force-unit N"}
"""What says a unit that is not known, by example."""

_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?\s*\Z", re.IGNORECASE)

NAMED = 5  # number of candidates that are named in a map that is to be completed


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
    contact_floor: float = 0.05  # that of a map in the file
    stated: Mapping | None = None  # the map that the file carries, which then is taken

    @property
    def open(self) -> tuple[str, ...]:
        """One sentence for each item that a map must still state; none where the guess is complete."""
        sentences = list(self.problems) if self.stated is None else []
        for name, signal, units in (("position", self.position, LENGTHS), ("force", self.force, FORCES)):
            if self.stated is not None or signal is None:
                continue
            if signal.unit == UNKNOWN:
                sentences.append(f"the unit of {_called(name, signal)} is not known ({', '.join(units)})")
            elif signal.unit in NEEDS_SCALE:
                needed = NEEDS_SCALE[signal.unit]
                sentences.append(f"{_called(name, signal)} is in {signal.unit} and needs a scale, {needed}")
        return tuple(sentences)

    def mapping(self) -> Mapping:
        """The map, if nothing is open."""
        if self.stated is not None:
            return self.stated
        if self.open or self.position is None or self.force is None:
            raise RecordingError(self.path, self._what_to_do())
        mapping = Mapping(self.position, self.force, self.time, self.velocity, contact_floor=self.contact_floor)
        check_mapping(self.path, mapping)
        return mapping

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
        return Guess(
            source.path, stated.time, stated.position, stated.force, stated.velocity,
            contact_floor=stated.contact_floor, stated=stated,
        )  # fmt: skip
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
        stated = named[time].unit
        unit = "s"  # that of nearly all; a time in another unit has steps that `read_with_notes` looks at
        if stated:
            problems.append(f"the unit of time {time} is not known ({', '.join(TIMES)})")
    position, force = (
        Signal(column=values[name][0], unit=values[name][1] or UNKNOWN) if name in values else None
        for name in (POSITION, FORCE)
    )
    velocity, notes = _velocity(table.columns, position), _frame_notes(position, force)
    return Guess(
        table.path, TimeSource(column=time, unit=unit), position, force, velocity, tuple(problems), notes, candidates
    )  # fmt: skip


def _rank(quantity: str, column: str, named: Named) -> tuple[float, str]:
    """How well a column fits a quantity, by its words or because a robot's interface always names it so; its unit."""
    known = robot_column(column)
    if known is None:
        return rank(quantity, named)
    return (known.rank, known.unit) if known.quantity == quantity else (0.0, "")


def _frame_notes(*signals: Signal | None) -> tuple[str, ...]:
    """Of columns that robots name: what they are, and in which frame."""
    notes = []
    for signal in signals:
        known = None if signal is None else robot_column(signal.column)
        if signal is not None and known is not None:
            x, y, _ = known.axes
            position = f"{signal.column} is taken for {known.quantity}: {known.text}"
            notes.append(f"{position}, z; numbers {x} and {y} are x and y (--map takes them)")
    return tuple(notes)


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

"""Guesses a map from names, units and message types; what nothing tells stays open and is said."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import msgspec

from foretouch.errors import RecordingError
from foretouch.recordings.column_names import FORCE, POSITION, TIME, VELOCITY, name_says, rank
from foretouch.recordings.mapping import (
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
from foretouch.recordings.source import Bag, Column, Table, listed

__all__ = ["Guess", "guess_mapping"]

HELP = "`foretouch recordings inspect` writes what is known with --save FILE.toml: complete it, and give it with --map"

FORCE_FIELDS = {
    "geometry_msgs/msg/WrenchStamped": "wrench.force.z",
    "geometry_msgs/msg/Wrench": "force.z",
}
"""Types of messages that hold a force in newtons, and its field along z."""

POSITION_FIELDS = {
    "geometry_msgs/msg/PoseStamped": "pose.position.z",
    "geometry_msgs/msg/PointStamped": "point.z",
    "geometry_msgs/msg/TransformStamped": "transform.translation.z",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose.position.z",
    "nav_msgs/msg/Odometry": "pose.pose.position.z",
    "geometry_msgs/msg/Pose": "position.z",
    "geometry_msgs/msg/Point": "z",
}
"""Types of messages that hold a place in metres, and its field along z."""

JOINTS = "sensor_msgs/msg/JointState"
_NUMBER = re.compile(r"[-+]?[\d.,]+(e[-+]?\d+)?\s*\Z", re.IGNORECASE)

LOOKED_INTO = 8
"""Topics of joint states whose first message is looked into; of the others one joint is taken for a candidate."""
PLAIN = {f"std_msgs/msg/{kind}": "data" for kind in ("Float64", "Float32")}


@dataclass(frozen=True)
class Guess:
    """A map as far as it can be guessed.

    Attributes:
        path: Of the recording.
        time: Of its samples.
        position: Of the probe, None where nothing could be it, or several; its unit may be `UNKNOWN`.
        force: Of the sensor, likewise.
        velocity: Of the probe, where it is there.
        problems: One sentence for each thing that is open.
        candidates: What `position` and `force` might be, where there are several.
        contact_floor: Of a map that the file carries.
        stated: The map that the file carries, which then is taken.
    """

    path: object
    time: TimeSource = field(default_factory=TimeSource)
    position: Signal | None = None
    force: Signal | None = None
    velocity: Velocity | None = None
    problems: tuple[str, ...] = ()
    candidates: dict[str, tuple[str, ...]] = field(default_factory=dict)
    contact_floor: float = 0.05
    stated: Mapping | None = None

    @property
    def open(self) -> tuple[str, ...]:
        """One sentence for each thing that a map must still say; none where the guess is whole."""
        said = list(self.problems) if self.stated is None else []
        for name, signal, units in (("position", self.position, LENGTHS), ("force", self.force, FORCES)):
            if self.stated is not None or signal is None:
                continue
            if signal.unit == UNKNOWN:
                said.append(f"the unit of the {name} {signal.place} is not known ({', '.join(units)})")
            elif signal.unit in NEEDS_SCALE:
                said.append(f"{name} {signal.place} is in {signal.unit} and needs a scale, {NEEDS_SCALE[signal.unit]}")
        return tuple(said)

    def mapping(self) -> Mapping:
        """The map, if nothing is open.

        Raises:
            RecordingError: The first thing that is, and what to do.
        """
        if self.stated is not None:
            return self.stated
        if self.open or self.position is None or self.force is None:
            raise RecordingError(self.path, f"{self.open[0]}; {HELP}")
        mapping = Mapping(self.position, self.force, self.time, self.velocity, contact_floor=self.contact_floor)
        check_mapping(self.path, mapping)
        return mapping

    def in_units(self, position_unit: str, force_unit: str, flip: bool) -> Guess:
        """The same with units where the file states none, and with positions turned round.

        Args:
            position_unit: ``"m"`` says nothing, as it is the default of the option.
            force_unit: ``"N"`` says nothing.
            flip: Whether positions shrink with depth.

        Raises:
            RecordingError: The file states another unit.
        """
        position = self._with(self.position, "position", position_unit, "m")
        force = self._with(self.force, "force", force_unit, "N")
        if flip and position is not None:
            position = msgspec.structs.replace(position, sign=-1 if position.sign == 1 else 1)
        stated = self.stated
        if stated is not None and position is not None and force is not None:
            stated = msgspec.structs.replace(stated, position=position, force=force)
        return replace(self, position=position, force=force, stated=stated)

    def _with(self, signal: Signal | None, name: str, unit: str, unsaid: str) -> Signal | None:
        if signal is None or unit == unsaid:
            return signal
        if signal.unit not in (UNKNOWN, unit):
            problem = f"{name} {signal.place} is in {signal.unit}: leave --{name}-unit out, or give a --map"
            raise RecordingError(self.path, problem)
        return msgspec.structs.replace(signal, unit=unit)

    def text(self) -> str:
        """The map as TOML to be completed: what is open stands as ``?`` or as a comment."""
        if self.stated is not None:
            return f"# stated by the file itself\n{mapping_text(self.stated)}"
        comments = [f"# open: {problem}" for problem in self.open]
        for name, candidates in self.candidates.items():
            if len(candidates) > 1:
                comments += [f"# {name} could be {candidate}" for candidate in candidates[:20]]
        blank = Signal(column=UNKNOWN) if self.time.column or self.time.rate else Signal(topic=UNKNOWN, field=UNKNOWN)
        mapping = Mapping(self.position or blank, self.force or blank, self.time, self.velocity)
        return "\n".join([*comments, mapping_text(mapping)])


def guess_mapping(source: Table | Bag) -> Guess:
    """Guess which column or field is time, position, force and velocity.

    A map that the file carries, as those of `convert_recording` do, is taken as it is. Else columns go by the words and
    units in their names, in several languages; topics by the type of their messages, and then by words in their names.
    Several that fit equally well are not chosen from.

    Raises:
        RecordingError: The map that the file carries is none.
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
    found: dict[str, tuple[str, str]] = {}
    for quantity in (TIME, POSITION, FORCE):
        ranked = {column.name: rank(quantity, named[column.name]) for column in table.columns}
        best = max((score for score, _ in ranked.values()), default=0.0)
        names = [name for name, (score, _) in ranked.items() if score == best and best > 0.0]
        if len(names) == 1:
            found[quantity] = names[0], ranked[names[0]][1]
            continue
        candidates[quantity] = tuple(names)
        there = listed(column.name for column in table.columns)
        several = f"several columns could be {quantity}: {listed(names)}"
        problems.append(several if names else f"no column is named like {quantity}; the columns are {there}")
    for quantity, (name, unit) in found.items():
        own = rank(quantity, name_says(name))[1]
        if own and unit != own:
            problems.append(f"column {name} is in {own} by its name, and in {unit} as the file states it elsewhere")
    time, unit = found.get(TIME, (UNKNOWN, "s"))
    if TIME in found and not unit:
        stated = named[time].unit
        unit = "s"  # that of nearly all; a time in another unit has steps that `read_with_notes` looks at
        if stated:
            problems.append(f"the unit of time {time} is not known ({', '.join(TIMES)})")
    position, force = (
        Signal(column=found[name][0], unit=found[name][1] or UNKNOWN) if name in found else None
        for name in (POSITION, FORCE)
    )
    velocity = _velocity(table.columns, position)
    return Guess(table.path, TimeSource(column=time, unit=unit), position, force, velocity, tuple(problems), candidates)


def _velocity(columns: tuple[Column, ...], position: Signal | None) -> Velocity | None:
    """The column of velocities, where there is one and it says that it is in the position's unit a second."""
    found = []
    for column in columns:
        named = name_says(column.name, column.unit)
        unit = named.unit.replace("_s", "/s")
        if position is not None and rank(VELOCITY, named)[0] > 0.0 and unit == f"{position.unit}/s":
            found.append(column.name)
    return Velocity(column=found[0]) if len(found) == 1 else None


def _of_bag(bag: Bag) -> Guess:
    problems: list[str] = []
    candidates: dict[str, tuple[str, ...]] = {}
    chosen: dict[str, Signal | None] = {}
    if not any(topic.count for topic in bag.topics):
        return Guess(bag.path, problems=("holds no messages",))
    for quantity, fields, unit in ((POSITION, POSITION_FIELDS, "m"), (FORCE, FORCE_FIELDS, "N")):
        signals = _candidates(bag, quantity, fields, unit)
        best = max((score for score, _ in signals), default=0.0)
        first = [signal for score, signal in signals if score == best]
        chosen[quantity] = first[0] if len(first) == 1 else None
        candidates[quantity] = tuple(signal.place for _, signal in sorted(signals, key=lambda one: -one[0]))
        if len(first) > 1:
            there = listed(signal.place for signal in first)
            problems.append(f"several topics could be {quantity}: {there}")
        elif not first:
            problems.append(f"no topic has messages of a type with a {quantity}; its topics: {_types(bag)}")
    return Guess(bag.path, TimeSource(), chosen[POSITION], chosen[FORCE], None, tuple(problems), candidates)


def _candidates(bag: Bag, quantity: str, fields: dict[str, str], unit: str) -> list[tuple[float, Signal]]:
    found: list[tuple[float, Signal]] = []
    looked_at = 0
    for topic in bag.topics:
        if not topic.count:
            continue
        said = 1.0 if rank(quantity, name_says(topic.name))[0] > 0.0 else 0.0
        if topic.type_name in fields:
            stamped = 1.0 if topic.type_name.endswith("Stamped") else 0.0
            signal = Signal(topic=topic.name, field=fields[topic.type_name], unit=unit)
            found.append((4.0 + stamped + said, signal))
        elif topic.type_name == JOINTS and quantity == POSITION:
            looked_at += 1
            places = ["position[0]"]
            if looked_at <= LOOKED_INTO:
                places = [column.name for column in bag.fields(topic.name) if column.name.startswith("position[")]
            score = 3.0 if len(places) == 1 else 2.0
            found += [(score + said, Signal(topic=topic.name, field=place)) for place in places]
        elif topic.type_name in PLAIN and said:
            found.append((1.0, Signal(topic=topic.name, field=PLAIN[topic.type_name])))
    return found


def _types(bag: Bag) -> str:
    return listed(f"{topic.name} ({topic.type_name})" for topic in bag.topics)

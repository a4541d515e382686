"""Which column or message field is time, position and force, and in which unit: a small TOML file."""

from __future__ import annotations

import json
from os import PathLike
from typing import Final, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.files import decode_toml, read_toml
from foretouch.recordings.meaning.names import FORCE_UNITS, POSITION_UNITS
from foretouch.recordings.output import atomic_path

Array = NDArray[np.float64]

LENGTHS: Final = POSITION_UNITS | {"rad": 1.0, "deg": 180.0 / np.pi, "raw": 1.0}
"""How many of a unit make a metre; of an angle, a radian."""

FORCES: Final = FORCE_UNITS | {"Nm": 1.0, "raw": 1.0}  # How many of a unit make a newton; of a torque, a newton metre

TIMES: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "min": 1.0 / 60.0, "h": 1.0 / 3600.0}
"""How many of a unit make a second."""

NEEDS_SCALE: Final = {
    "rad": "metres for a radian, the length of the lever",
    "deg": "metres for a radian, the length of the lever",
    "Nm": "newtons for a newton metre, one over the length of the lever",
    "raw": "metres or newtons for one count or volt",
}
"""Units that are no length or force by themselves, and the meaning of their ``scale``."""

UNKNOWN: Final = "?"  # unit of a guess where the file does not state it; a map must state it

FORM: Final = "[time], [position] and [force] with column, or topic and field, and unit"


class TimeSource(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the time of a sample stands.

    Attributes:
        column: Of a table.
        unit: Of that column, one of `TIMES`.
        rate: Samples a second [1/s], where a table has no such column; 0 where it has one.
        stamp: Of a bag: ``"header"`` (when the sensor measured), ``"log"`` (when the recorder took it), ``"aligned"``
            (header stamps, those of positions moved so that both topics are equally far from log time), or ``"auto"``:
            header stamps as long as those of both topics are on one clock.
        start: ``"first"``: time counts from the first sample; ``"zero"``: it is the stamp itself in seconds.
    """

    column: str = ""
    unit: str = "s"
    rate: float = 0.0
    stamp: Literal["auto", "header", "log", "aligned"] = "auto"
    start: Literal["first", "zero"] = "first"


class Signal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    r"""Source of position or force in a file.

    .. math:: q = \text{sign} \cdot \text{scale} \cdot r / u

    with the value :math:`r` in the file and :math:`u` units to one of SI.

    Attributes:
        column: Column of a table.
        topic: Topic of a bag.
        field: Field of the topic's messages, such as ``wrench.force.z``, ``position[0]`` or ``position[elbow]``.
        unit: One of `LENGTHS` or `FORCES`.
        sign: -1 where positions shrink with depth, or forces are negative under compression.
        scale: Factor of the value in SI units; `NEEDS_SCALE` gives its meaning for angles, torques and counts.
    """

    column: str = ""
    topic: str = ""
    field: str = ""
    unit: str = UNKNOWN
    sign: Literal[1, -1] = 1
    scale: float = 1.0

    @property
    def place(self) -> str:
        """Column, or topic and field, for people."""
        return self.column or f"{self.topic} {self.field}"


class Velocity(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Source of a measured velocity, in the position's unit per second, with its sign and scale; same topic or table.

    Attributes:
        column: Column of a table.
        field: Field of the messages of the position's topic.
    """

    column: str = ""
    field: str = ""


class Mapping(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole map.

    Attributes:
        position: Position of the probe.
        force: Force of the sensor.
        time: Time of both.
        velocity: Velocity of the probe, or None: then it is estimated from the positions.
        join: How positions are resampled at the times of forces from another topic: ``"interpolate"`` between the
            two positions around, or ``"hold"`` the last one before.
        contact_floor: Smallest force [N] that counts as contact.
    """

    position: Signal
    force: Signal
    time: TimeSource = TimeSource()
    velocity: Velocity | None = None
    join: Literal["interpolate", "hold"] = "interpolate"
    contact_floor: float = 0.05


def read_mapping(path: str | PathLike[str]) -> Mapping:
    """A map from its TOML file; an unknown key is an error.

    Raises:
        RecordingError: The file cannot be read, is no such map, or a unit in it is not known or lacks its scale.
    """
    return check_mapping(path, read_toml(path, Mapping, "map", FORM))


def parse_mapping(source: object, text: bytes | str) -> Mapping:
    """A map from its text; errors name `source`."""
    return check_mapping(source, decode_toml(source, text, Mapping, "map", FORM))


def check_mapping(source: object, mapping: Mapping) -> Mapping:
    """The map, unless it has what the types of its fields cannot refuse."""
    _one_of(source, "time", mapping.time.unit, TIMES)
    for name, signal, units in (("position", mapping.position, LENGTHS), ("force", mapping.force, FORCES)):
        _one_of(source, name, signal.unit, units)
        if bool(signal.column) == bool(signal.topic) or bool(signal.topic) != bool(signal.field):
            raise RecordingError(source, f"[{name}] takes either column, or topic and field")
        if not (np.isfinite(signal.scale) and signal.scale > 0.0):
            raise RecordingError(source, f"[{name}] scale = {signal.scale:g}: must be finite and above 0; see sign")
        if signal.unit in NEEDS_SCALE and signal.scale == 1.0:
            meaning = NEEDS_SCALE[signal.unit]
            raise RecordingError(source, f"[{name}] is in {signal.unit} and needs scale = {meaning} (not exactly 1)")
    if bool(mapping.position.column) != bool(mapping.force.column):
        raise RecordingError(source, "[position] and [force] take both a column, or both a topic")
    if not (np.isfinite(mapping.time.rate) and mapping.time.rate >= 0.0):
        raise RecordingError(source, f"[time] rate = {mapping.time.rate:g}: must be finite and above 0")
    if not (np.isfinite(mapping.contact_floor) and mapping.contact_floor >= 0.0):
        raise RecordingError(source, f"contact_floor = {mapping.contact_floor:g}: must be finite and not below 0")
    return mapping


def _one_of(source: object, name: str, unit: str, units: dict[str, float]) -> None:
    if unit not in units:
        text = "is not said" if unit == UNKNOWN else f"{unit!r} is not known"
        raise RecordingError(source, f"[{name}] unit {text}: give one of {', '.join(units)}")


def to_si(values: Array, signal: Signal, units: dict[str, float]) -> Array:
    """The values of a signal in SI units; those that are in them already, bit by bit."""
    # a quotient is the correctly rounded value of 0.5 mm, a product with 1e-3 is not
    divisor = signal.sign * units[signal.unit]
    result = values if divisor == 1.0 else values / divisor
    return result if signal.scale == 1.0 else result * signal.scale


def write_mapping(path: str | PathLike[str], mapping: Mapping) -> None:
    """Write a map as TOML.

    Raises:
        RecordingError: The file cannot be written.
    """
    with atomic_path(path) as part:
        part.write_text(mapping_text(mapping), encoding="utf-8")


def mapping_text(mapping: Mapping) -> str:
    """A map as TOML; what has its default is left out, but for units."""
    default = Mapping(mapping.position, mapping.force)
    top = [
        f"{name} = {_literal(getattr(mapping, name))}"
        for name in ("join", "contact_floor")
        if getattr(mapping, name) != getattr(default, name)
    ]
    parts = ["\n".join(top)] if top else []
    for name in ("time", "position", "force", "velocity"):
        section = getattr(mapping, name)
        lines = [
            f"{key} = {_literal(value)}"
            for key, value in (msgspec.structs.asdict(section).items() if section else ())
            if value != getattr(type(section)(), key)
            or (key == "unit" and (name != "time" or (section.column and not section.rate)))
        ]
        if lines:
            parts.append("\n".join([f"[{name}]", *lines]))
    return "\n\n".join(parts) + "\n"


def _literal(value: object) -> str:
    """A TOML value; a JSON string is one but for DEL."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f") if isinstance(value, str) else repr(value)

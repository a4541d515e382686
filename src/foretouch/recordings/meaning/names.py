"""Quantity, unit and frame of a column by its name.

Words are those of several languages, as files have them; some common robots' interfaces name their columns always
alike. A table whose columns are named as here needs no map.
"""

from __future__ import annotations

import functools
import re
import unicodedata
from dataclasses import dataclass
from os import PathLike
from typing import Final, NamedTuple, TypedDict

from foretouch.errors import UnknownNameError
from foretouch.errors.checks import require_path, require_type

FORCE_CHANNELS = ("raw", "logged")
"""Forces of a published file: the raw bridge, and the torque that the experiment logged."""

TIME, POSITION, FORCE, VELOCITY = "time", "position", "force", "velocity"

PRESSED: Final = (
    "indentation indent penetration compression eindringung eindruck stauchung kompression enfoncement indentacion "
    "penetracion compresion indentazione penetrazione compressione indrukking indringing compressie indentacao "
    "penetracao compressao wglebienie penetracja kompresja vtisk komprese painuma puristuma benyomodas intryckning "
    "压入 压缩 压痕 圧入 圧縮 押込み вдавливание сжатие"
)
"""Positions by themselves; beside a word of forces they specify the force: ``Force de compression``."""

WORDS: Final = {
    TIME: "time timestamp stamp seconds zeit temps tiempo tempo tijd tid czas cas aika idő 时间 時間 время",
    POSITION: "position pos depth displacement disp travel extension elongation deflection crosshead "
    "stroke weg tiefe eindringtiefe lage hub traverse verformung langenanderung deplacement profondeur "
    "posicion desplazamiento profundidad posizione spostamento profondita positie verplaatsing diepte posicao "
    f"deslocamento pozycja przemieszczenie poloha 位置 位移 変位 深さ положение перемещение {PRESSED}",
    FORCE: "force load kraft last effort fuerza carga forza carico kracht forca sila сила усилие 力 荷重",
    VELOCITY: "velocity vel speed geschwindigkeit vitesse velocidad velocita snelheid velocidade hastighet predkosc "
    "速度 скорость",
}
"""Words of each quantity, without accents."""

COMPOUNDS: Final = ("zeit", "weg", "hub", "tiefe", "kraft", "last", "geschwindigkeit")
"""German words that others are put before, as in ``Prüfzeit``, ``Standardweg`` or ``Sollkraft``."""

SHORTEST_PART: Final = 3  # letters before such a word

ASKED_FOR: Final = "setpoint desired target commanded command cmd reference ref soll sollwert consigne"
"""Words of what was asked for and not measured."""

LETTERS: Final = {TIME: "t", POSITION: "x z s d", FORCE: "f fz fn"}
"""Symbols of each quantity, which count where nothing better is there."""

BY_WORD: Final = 2.0  # least rank of a name that has a word of its quantity, and not a symbol alone

UNITS: Final = {
    TIME: {
        "s": "s", "sec": "s", "sek": "s", "ms": "ms", "msec": "ms", "us": "us", "µs": "us", "ns": "ns", "min": "min",
        "h": "h",
    },
    POSITION: {
        "m": "m", "cm": "cm", "mm": "mm", "um": "um", "µm": "um", "rad": "rad", "deg": "deg", "°": "deg", "grad": "deg",
        "meter": "m", "metre": "m", "meters": "m", "metres": "m", "millimeter": "mm",
    },
    FORCE: {
        "N": "N", "mN": "mN", "cN": "cN", "kN": "kN", "Nm": "Nm", "N·m": "Nm", "newton": "N", "newtons": "N",
    },
}  # fmt: skip
"""Units as files write them, to those of a map."""

_bracketed = re.compile(r"[\[({<]\s*([^\])}>]*?)\s*[\])}>]\s*\Z")
_trailing = re.compile(r"(?:(?<=\w)_|\s+in\s+|\s*/\s*|\s+)([A-Za-zµμ°·]+(?:[/_]s)?)\s*\Z")
_word = re.compile(r"[^\W\d_]+|\d+")


class Named(NamedTuple):
    """Words in the name of a column, lower case, without accents, and the unit in it as written, or empty."""

    words: tuple[str, ...]
    unit: str


def name_says(name: str, stated_unit: str = "") -> Named:
    """Words and unit of a column's name, such as ``Weg [mm]``, ``position_mm``, ``F in N`` or ``run1/forceSensor``."""
    text = name.replace("\u03bc", "µ").strip()
    unit = stated_unit.replace("\u03bc", "µ").strip()
    for pattern in (_bracketed, _trailing):
        result = pattern.search(text)
        if result is not None and not result[1].isdecimal() and (pattern is _bracketed or _known(result[1])):
            text, unit = text[: result.start()], unit or result[1]
            break
    split = re.sub(r"(?<=[a-zß-ÿ])(?=[A-Z])", " ", text)  # camelCase
    return Named(tuple(part for word in _word.findall(split) for part in _parts(_plain(word))), unit)


def rank(quantity: str, named: Named) -> tuple[float, str]:
    """How well a name fits a quantity, 0 where it does not, and its unit as a map writes it, or empty."""
    words = [word for word in named.words if not word.isdigit()]
    known = _words(quantity)
    if quantity == POSITION and set(words) & _words(FORCE):
        known -= frozenset(_plain(PRESSED).split())
    unit = _unit(quantity, named.unit)
    no_speed = quantity != VELOCITY
    if (
        named.unit == "%"  # of a length, and so a strain
        or (no_speed and named.unit and not unit and _known(named.unit))  # "force [mm]" is none
        or (no_speed and set(words) & _words(VELOCITY))
        or (quantity == FORCE and "torque" in words)
        or set(ASKED_FOR.split()) & set(words)
    ):
        return 0.0, ""
    score = 0.0
    if len(words) == 1 and words[0] in known:
        score = 4.0
    elif words and words[-1] in known:
        score = 3.0
    elif set(words) & known:
        score = BY_WORD
    elif words and words[-1] in LETTERS.get(quantity, "").split():
        score = 1.0
    return (score + 0.5 * bool(unit), unit) if score else (0.0, unit)


def is_unit(text: str) -> bool:
    """Whether a text is a unit alone, such as ``mm``, ``[kN]`` or ``(mm/s)``."""
    return _known(text.strip().strip("[](){}<> ").replace("\u03bc", "µ"))


def _parts(word: str) -> tuple[str, ...]:
    """A word, or the two that it is put together of."""
    whole = any(word in _words(quantity) for quantity in WORDS)
    ends = [end for end in COMPOUNDS if word.endswith(end) and len(word) >= len(end) + SHORTEST_PART]
    return (word,) if whole or not ends else (word.removesuffix(ends[0]), ends[0])


@functools.cache
def _words(quantity: str) -> frozenset[str]:
    return frozenset(_plain(WORDS[quantity]).split())


def _unit(quantity: str, unit: str) -> str:
    units = UNITS.get(quantity, {})
    return units.get(unit) or (units.get(unit.lower(), "") if len(unit) > 1 else "")


def _known(unit: str) -> bool:
    return any(_unit(quantity, unit) for quantity in UNITS) or _is_rate(unit)


def _is_rate(unit: str) -> bool:
    return bool(re.fullmatch(r"[a-zµ]+[/_]s|[a-zµ]*/s\^?2?", unit))


def _plain(text: str) -> str:
    """Lower case, without accents."""
    return "".join(letter for letter in unicodedata.normalize("NFD", text.lower()) if not unicodedata.combining(letter))


class RobotColumn(NamedTuple):
    """Meaning of one number of a robot's interface."""

    quantity: str  # quantity of the number
    # how well it fits, on the scale of `foretouch.recordings.meaning.names.rank`: below a column that is named as the
    # quantity and nothing else, above one that has a word of it
    rank: float
    unit: str  # unit as a map writes it
    text: str  # its name and frame, for people
    axes: tuple[int, int, int]  # numbers of the columns along x, y and z there


_BASE, _FRANKA = "the robot's base frame", "Franka's estimated force on the stiffness frame, along"
_ITSELF = "that frame itself, which turns with the hand"
KNOWN: Final = {
    "O_T_EE": RobotColumn(
        POSITION, 3.8, "m", f"Franka's end effector in {_BASE}, of a 4 x 4 pose by columns", (12, 13, 14)
    ),
    "O_F_ext_hat_K": RobotColumn(FORCE, 3.8, "N", f"{_FRANKA} {_BASE}", (0, 1, 2)),
    "K_F_ext_hat_K": RobotColumn(FORCE, 3.7, "N", f"{_FRANKA} {_ITSELF}", (0, 1, 2)),
    "actual_TCP_pose": RobotColumn(POSITION, 3.8, "m", f"UR's tool centre point in {_BASE}", (0, 1, 2)),
    "actual_TCP_force": RobotColumn(FORCE, 3.8, "N", f"UR's force at the tool centre point, along {_BASE}", (0, 1, 2)),
}
"""The numbers of libfranka's `RobotState` and of UR's RTDE, by name without their index.

References:
    Franka Robotics, libfranka, franka/robot_state.h: struct RobotState.
    Universal Robots, Real-Time Data Exchange (RTDE) guide, robot controller outputs.
"""

_indexed = re.compile(rf"(?:^|[^A-Za-z])({'|'.join(KNOWN)})[\[_. ]?(\d+)\]?\s*\Z")


def robot_column(name: str) -> RobotColumn | None:
    """What a column is, such as ``O_T_EE[14]`` or ``state/actual_TCP_force_2``, if along z; None for any other."""
    result = _indexed.search(name)
    return KNOWN[result[1]] if result and int(result[2]) == KNOWN[result[1]].axes[2] else None


POSITION_UNITS: Final = {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6}
"""How many of a unit make a metre."""

FORCE_UNITS: Final = {"N": 1.0, "mN": 1e3, "cN": 1e2, "kN": 1e-3}
"""How many of a unit make a newton."""

REQUIRED: Final = ("time_s", "position_m", "force_N")
VELOCITY_KEY: Final = "velocity_m_s"


class ReadingKeywords(TypedDict, total=False):
    """The attributes of `RecordingOptions`, as keyword arguments."""

    position_unit: str | None
    force_unit: str | None
    flip: bool
    flip_force: bool
    force_channel: str
    map_file: str | PathLike[str] | None


@dataclass(frozen=True)
class RecordingOptions:
    """How a recording is to be read, where its file does not say so by itself.

    Attributes:
        position_unit: Unit of positions, where columns are named as in `read_recording` or the file does not state it:
            ``"m"``, ``"cm"``, ``"mm"`` or ``"um"``; velocities are in the same per second.
        force_unit: Unit of its forces: ``"N"``, ``"mN"``, ``"cN"`` or ``"kN"``.
        flip: Whether positions grow out of the material; position and velocity then change sign.
        flip_force: Whether forces are negative under load; they then change sign.
        force_channel: For TU/e recordings ``"raw"`` (the force bridge) or ``"logged"`` (the low-pass filtered torque).
        map_file: TOML file of a `Mapping`: which column or message field is what, in which unit.

    Raises:
        UnknownNameError: A unit or force channel that is not known.
        ArgumentTypeError: A unit or a path that is none.
    """

    position_unit: str | None = None
    force_unit: str | None = None
    flip: bool = False
    flip_force: bool = False
    force_channel: str = "raw"
    map_file: str | PathLike[str] | None = None

    def __post_init__(self) -> None:
        if self.map_file is not None:
            require_path("map_file", self.map_file)
        for name, unit, known in (
            ("position_unit", self.position_unit, POSITION_UNITS),
            ("force_unit", self.force_unit, FORCE_UNITS),
        ):
            require_type(name, unit, (str, type(None)), "the name of a unit, or None for what the file says")
            if unit is not None and unit not in known:
                raise UnknownNameError(name.replace("_", " "), unit, known)
        if self.force_channel not in FORCE_CHANNELS:
            raise UnknownNameError("force channel", self.force_channel, FORCE_CHANNELS)

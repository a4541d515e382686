"""A recording of presses in memory, and where a machine has its zero and which way it counts.

A recording has time, position, force, and velocity where it was measured; a machine's count is brought to the session's
own line of positions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import ArgumentTypeError, RecordingError, SettingError, plural
from foretouch.quantities.brief import shortest
from foretouch.quantities.columns import Columns
from foretouch.quantities.pose import Pose, RigidMotion, Vector, scaled

Array = NDArray[np.float64]

LARGEST_POSITION = 1.0
"""Positions beyond this [m] are refused: they are in other units, or not of a press."""


def numbers_of(name: str, values: ArrayLike) -> Array:
    """What is given as an array of numbers.

    Args:
        name: Name for the error.
        values: Values that were given.

    Raises:
        ArgumentTypeError: They are no numbers.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ArgumentTypeError(name, values, "a column of numbers, shape (n,)") from None


@dataclass(frozen=True, eq=False)
class Recording(Columns):
    """One recording, checked on construction.

    Attributes:
        time: Sample times [s], strictly increasing, shape (n,).
        position: Probe position [m], growing with depth, at most 1 m in size, shape (n,).
        force: Force as the sensor gives it [N], offset included, positive under compression, shape (n,).
        velocity: Measured velocity [m/s], positive while deepening, shape (n,), or None: then it is estimated
            causally from the positions.
        name: Name for messages, usually the file.
        contact_floor: Smallest force [N] that scoring counts as contact, by the noise of the origin.
        first_row: Row in the file that holds sample 0, as an editor counts lines, for error messages.

    Raises:
        RecordingError: A column of another length, fewer than 2 samples, a value that is not finite, time that
            does not increase, or a position beyond 1 m. The message names row and rule.
        ArgumentTypeError: A column that holds no numbers.
    """

    time: Array
    position: Array
    force: Array
    velocity: Array | None = None
    name: str = "recording"
    contact_floor: float = 0.05
    first_row: int | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        length = np.size(self.time)
        for label in ("time", "position", "force", *(["velocity"] if self.velocity is not None else [])):
            array = np.array(numbers_of(label, getattr(self, label)))  # a copy: the caller's array stays the caller's
            if array.ndim != 1 or array.size != length:
                raise RecordingError(self.name, f"{label} has shape {array.shape}, time has {length} samples")
            if length < 2:
                raise RecordingError(self.name, f"{plural(length, 'sample')}: at least 2 are needed")
            self._refuse(~np.isfinite(array), array, f"{label} is {{}}: every value must be finite")
            object.__setattr__(self, label, array)
            array.flags.writeable = False
        late = np.diff(self.time, prepend=-np.inf) <= 0.0
        self._refuse(late, self.time, "time {} s does not come after the row before: time must increase")
        self._refuse(
            np.abs(self.position) > LARGEST_POSITION,
            self.position,
            "position {} m is beyond 1 m: if it is not in metres, say so with --position-unit (mm, um, ...)",
        )

    def _refuse(self, bad: NDArray[np.bool_], values: Array, problem: str) -> None:
        if bad.any():
            index = int(np.argmax(bad))
            row = None if self.first_row is None else self.first_row + index
            where = "" if row is not None else f"sample {index}: "
            raise RecordingError(self.name, where + problem.format(f"{values[index]:g}"), row=row)

    def __len__(self) -> int:
        return int(self.time.size)

    def columns(self) -> dict[str, Array]:
        """Time, position, force, and velocity where it was measured."""
        values = {"time_s": self.time, "position_m": self.position, "force_N": self.force}
        return values if self.velocity is None else values | {"velocity_m_s": self.velocity}


FARTHEST_BASE = 10.0  # Largest distance of a machine's base from the world's origin, along any axis [m]


@dataclass(frozen=True, slots=True)
class Frame:
    r"""One line of positions as seen from another.

    .. math:: x = d\,(r - r_0)

    x is the session's position, which grows into the material; r the machine's own.

    Args:
        origin: r_0, the machine's own position where the session has its zero [m], at most 1 m.
        direction: d, 1, or -1 where the machine's own positions shrink into the material.

    Raises:
        SettingError: An origin beyond 1 m, or another direction.
    """

    origin: float = 0.0
    direction: int = 1

    def __post_init__(self) -> None:
        if not abs(self.origin) <= LARGEST_POSITION:
            raise SettingError("origin", self.origin, f"must lie within {LARGEST_POSITION:g} m")
        if self.direction not in (1, -1):
            raise SettingError("direction", self.direction, "must be 1 or -1")

    @classmethod
    def from_text(cls, name: str, text: str) -> Frame:
        """The frame that a setting of this name gives as ``ORIGIN,DIRECTION``, for example ``0.02,-1``.

        Raises:
            SettingError: It is nothing of the kind.
        """
        try:
            origin, direction = text.split(",")
            return cls(float(origin), int(direction))
        except (ValueError, SettingError):
            rule = f"must be ORIGIN,DIRECTION: metres within {LARGEST_POSITION:g}, and 1 or -1; for example 0.02,-1"
            raise SettingError(name, text, rule) from None

    def __str__(self) -> str:
        """The text that `from_text` reads."""
        return f"{shortest(self.origin)},{self.direction}"

    def inverse(self) -> Frame:
        """The session's frame as seen from the machine's: `inside` of one is `outside` of the other."""
        return Frame(-self.direction * self.origin, self.direction)

    def inside(self, position: float) -> float:
        """The session's position [m] of one of the machine's [m]."""
        return self.direction * (position - self.origin)

    def outside(self, position: float) -> float:
        """The machine's position [m] of one of the session's [m]."""
        return self.origin + self.direction * position


@dataclass(frozen=True, slots=True)
class SpatialFrame:
    r"""The base of a machine in the world.

    .. math:: p = R(\phi)\, q + t

    p is a place in the world, as the session counts; q the machine's own.

    Args:
        place: t, where the base is in the world [m], at most 10 m along each axis.
        rotation: \phi, axis times angle of the base in the world [rad], at most 2 pi along each axis.

    Raises:
        SettingError: No three numbers, or one out of range.
    """

    place: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)
    motion: RigidMotion = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name, most in (("place", FARTHEST_BASE), ("rotation", 2.0 * math.pi)):
            values = getattr(self, name)
            if len(values) != 3 or not all(abs(value) <= most for value in values):
                raise SettingError(name, values, f"must be three numbers within {most:.3g}")
            object.__setattr__(self, name, tuple(map(float, values)))
        object.__setattr__(self, "motion", RigidMotion.from_numbers((*self.place, *self.rotation)))

    @classmethod
    def from_text(cls, name: str, text: str) -> SpatialFrame:
        """The frame that a setting of this name gives as ``X,Y,Z,RX,RY,RZ``.

        Raises:
            SettingError: It is nothing of the kind.
        """
        try:
            x, y, z, *rotation = map(float, text.split(","))
            return cls((x, y, z), tuple(rotation))  # type: ignore[arg-type]  # checked there
        except (ValueError, SettingError):
            rule = f"must be X,Y,Z,RX,RY,RZ: metres within {FARTHEST_BASE:g}, and a rotation vector in radians"
            raise SettingError(name, text, f"{rule}; for example 0.4,0,0.1,0,0,1.57") from None

    def __str__(self) -> str:
        """The text that `from_text` reads."""
        return ",".join(map(shortest, (*self.place, *self.rotation)))

    def inverse(self) -> SpatialFrame:
        """The world as seen from the machine: `inside` of one is `outside` of the other."""
        turned_back = scaled(self.rotation, -1.0)
        return SpatialFrame(self.motion.rotate_back(scaled(self.place, -1.0)), turned_back)

    def inside(self, position: Vector) -> Vector:
        """The place in the world [m] of one of the machine's [m]."""
        return self.motion.apply(position)

    def outside(self, position: Vector) -> Vector:
        """The machine's place [m] of one in the world [m]."""
        return self.motion.apply_back(position)

    def pose_inside(self, numbers: Sequence[float]) -> tuple[float, ...]:
        """The pose in the world, a place [m] and a rotation vector [rad], of one in the machine's frame."""
        base, seen = Pose.from_rotation_vector(self.rotation, self.place), tuple(numbers)
        pose = base @ Pose.from_rotation_vector(seen[3:], seen[:3])
        return (*pose.translation.tolist(), *pose.rotation_vector().tolist())

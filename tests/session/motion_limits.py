"""A path with its limits, as tests ask it."""

from __future__ import annotations

import math

from foretouch.core import Kernel
from foretouch.quantities.pose import Vector, norm
from foretouch.session.safety.motion import UNBOUNDED, Bound, Path, begin, go_on, limited, new_path

_begin = Kernel(begin, "(Path, f8, f8, f8)", Path)
_go_on = Kernel(go_on, "(Path, UniTuple(f8, 3), UniTuple(f8, 3), UniTuple(UniTuple(f8, 4), 3))", Path)
_limited = Kernel(limited, "(Path, f8, f8, f8)", Path)


class MotionLimits:
    def __init__(self, speed: float, acceleration: float, jerk: float, sample_period: float) -> None:
        self._paths = new_path(speed, acceleration, jerk, sample_period)

    @property
    def place(self) -> Vector:
        return self._vector("position")

    @property
    def velocity(self) -> Vector:
        return self._vector("velocity")

    @property
    def acceleration(self) -> Vector:
        return self._vector("acceleration")

    @property
    def speed(self) -> float:
        return norm(self.velocity)

    def _vector(self, name: str) -> Vector:
        ((x, y, z),) = self._paths[name].tolist()
        return x, y, z

    def begin(self, x: float, y: float = 0.0, z: float = 0.0) -> None:
        _begin.entry(self._paths[0], x, y, z)

    def update(self, wanted: float, upwards: float = math.inf, shifted: float = 0.0) -> float:
        """On a line."""
        return _limited.entry(self._paths[0], wanted, upwards, shifted)

    def move(
        self,
        wanted: Vector,
        bounds: tuple[Bound, Bound, Bound] = (UNBOUNDED, UNBOUNDED, UNBOUNDED),
        shifted: Vector = (0.0, 0.0, 0.0),
    ) -> Vector:
        """In space."""
        _go_on.entry(self._paths[0], wanted, shifted, bounds)
        return self.place

"""What a tool at rest or in motion makes a six-axis force and torque sensor show, and what is left of contact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector, add, dot, rotation_of, scaled, subtract

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""[m/s^2]."""

LARGEST_TURN = math.pi + 1e-6
"""Length that a rotation vector may have [rad]: half a turn, and what is lost where numbers are rounded."""

STILL: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ToolLoad:
    r"""A rigid tool beyond a six-axis sensor, and the sensor's bias. All vectors are in the sensor's frame.

    Args:
        bias: What the sensor shows without any load: force [N] and torque [N m], six numbers.
        mass: m, beyond the sensor [kg], at least 0.
        centre_of_mass: c, from the sensor's origin [m].
        sensor_turn: Rotation vector that turns vectors of the flange's frame into the sensor's [rad].
        inertia: J about the centre of mass: xx, yy, zz, xy, xz, yz [kg m^2]; xy is the entry of the matrix, which is
            the negative product of inertia.

    Raises:
        SettingError: Another number of values, one that is not finite, a rotation vector longer than pi, a negative
            mass, or an inertia that no body has.
    """

    bias: tuple[float, ...]
    mass: float
    centre_of_mass: Vector
    sensor_turn: Vector = (0.0, 0.0, 0.0)
    inertia: tuple[float, ...] = (0.0,) * 6

    def __post_init__(self) -> None:
        for name, count in (("bias", 6), ("centre_of_mass", 3), ("sensor_turn", 3), ("inertia", 6)):
            values = tuple(map(float, getattr(self, name)))
            if len(values) != count or not all(map(math.isfinite, values)):
                raise SettingError(name, getattr(self, name), f"must be {count} finite numbers")
            object.__setattr__(self, name, values)
        if math.hypot(*self.sensor_turn) > LARGEST_TURN:
            raise SettingError("sensor_turn", self.sensor_turn, "must be a rotation vector in rad, at most pi long")
        require("mass", self.mass, at_least=0.0)
        xx, yy, zz, xy, xz, yz = self.inertia
        principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if principal[0] < 0.0 or principal[2] > (1.0 + 1e-9) * (principal[0] + principal[1]):
            rule = "must be that of a body: no principal moment is negative, or larger than the sum of the others"
            raise SettingError("inertia", self.inertia, rule)

    @cached_property
    def _turn(self) -> tuple[Vector, Vector, Vector]:
        return rotation_of(*self.sensor_turn)

    def wrench(
        self,
        rotation: ArrayLike,
        acceleration: Vector = STILL,
        angular_velocity: Vector = STILL,
        angular_acceleration: Vector = STILL,
    ) -> Array:
        r"""What the sensor shows without contact, shape (6,), by Newton and Euler.

        .. math::
            F = b_F + m (g - a_c), \quad
            T = b_T + c \times m (g - a_c) - J \dot\omega - \omega \times J \omega, \quad
            a_c = a + \dot\omega \times c + \omega \times (\omega \times c)

        It is the load on the sensor: the force and torque, about the sensor's origin, that the tool exerts on it. A
        tool that hangs pulls along gravity. A contact force on the tool adds to it as it is, and MuJoCo's sensors of
        force and torque at a site of the tool show the negative of it.

        Args:
            rotation: Of the flange: the matrix that turns its vectors into the base's frame, whose z points up, (3, 3).
            acceleration: a, of the sensor's origin in the base's frame, 0 at rest [m/s^2].
            angular_velocity: Of the tool in the base's frame [rad/s].
            angular_acceleration: Of the tool in the base's frame [rad/s^2].
        """
        rows = np.asarray(rotation, np.float64).tolist()
        centre, mass = self.centre_of_mass, self.mass
        rate, change = self._seen(rows, angular_velocity), self._seen(rows, angular_acceleration)
        # Gravity and the acceleration of the origin are one: weight is what accelerates upwards.
        free = self._seen(rows, (-acceleration[0], -acceleration[1], -STANDARD_GRAVITY - acceleration[2]))
        turning = add(_cross(change, centre), _cross(rate, _cross(rate, centre)))
        force = scaled(subtract(free, turning), mass)
        spin = add(self._inert(change), _cross(rate, self._inert(rate)))
        torque = subtract(_cross(centre, force), spin)
        return np.asarray([bias + load for bias, load in zip(self.bias, force + torque, strict=True)])

    def contact(self, measured: ArrayLike, rotation: ArrayLike, *motion: Vector) -> Array:
        """The wrench of a contact on the tool, about the sensor's origin in the sensor's frame, shape (6,).

        Args:
            measured: What the sensor shows: force [N] and torque [N m], shape (6,).
            rotation: As in `wrench`.
            *motion: The accelerations and the velocity of `wrench`, in its order; the tool is at rest without them.
        """
        return np.asarray(measured, np.float64) - self.wrench(rotation, *motion)

    def _seen(self, rows: Any, vector: Vector) -> Vector:
        """A vector of the base's frame in the sensor's."""
        (a, b, c), (d, e, f), (g, h, i) = rows
        x, y, z = vector
        flange = a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z
        first, second, third = self._turn
        return dot(first, flange), dot(second, flange), dot(third, flange)

    def _inert(self, rate: Vector) -> Vector:
        """J times a vector."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return dot((xx, xy, xz), rate), dot((xy, yy, yz), rate), dot((xz, yz, zz), rate)


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]

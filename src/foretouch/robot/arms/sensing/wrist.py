"""The contact force by a sensor at an arm's wrist."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from foretouch.core import kernel
from foretouch.robot.arms.body import Body
from foretouch.robot.engine import OFFSET_UNCERTAINTY

Array = NDArray[np.float64]


@kernel("void(f8[::1], f8[::1], f8, f8)")
def feel(felt: Array, sensed: Array, mass: float, gain: float) -> None:
    """Move the low-pass of the contact force [N] by what the sensors feel behind a physics step.

    Args:
        felt: Written, in the sensor's frame [N].
        sensed: What the flange does to the tool (force [N] and torque [N m]), and what an accelerometer in it shows
            [m/s^2].
        mass: Of the tool [kg].
        gain: Share by which the low-pass moves.
    """
    for axis in range(3):
        felt[axis] += gain * (mass * sensed[6 + axis] - sensed[axis] - felt[axis])


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8)")
def turn(shown: Array, rotation: Array, felt: Array, beside: Array, largest: float) -> None:
    """Write a force of the sensor's frame, with what is beside it and within its range, in the scene's [N]."""
    for row in range(3):
        shown[row] = 0.0
        for axis in range(3):
            value = min(max(felt[axis] + beside[axis], -largest), largest)
            shown[row] += rotation[3 * row + axis] * value


class WristForce:
    """A force sensor between flange and tool, with the tool's weight and inertia taken off by an accelerometer in it.

    Args:
        body: Whose wrist it is.
        offset: What it shows with nothing on it, in the sensor's frame [N].
    """

    noise, bandwidth, range, contact_floor = 0.03, 150.0, 145.0, 0.0

    def __init__(self, body: Body, offset: tuple[float, float, float] = (0.1, -0.15, 0.3)) -> None:
        self._body, (_, self._mass) = body, body.description.probe
        self._offset, self._nothing = np.asarray(offset), np.zeros(3)
        self._sensed, self._rotation = body.data.sensordata, body.sensor_rotation
        self._gain = -math.expm1(-2.0 * math.pi * self.bandwidth * float(body.model.opt.timestep))
        self.largest_offset = math.hypot(*offset) + OFFSET_UNCERTAINTY
        self._felt, self._force, self._shown = np.zeros(3), np.zeros(3), np.zeros(3)
        self._feel, self._turn = feel.entry, turn.entry

    @property
    def force(self) -> Array:
        """See `Sensing.force`."""
        self._turn(self._force, self._rotation, self._felt, self._nothing, self.range)
        return self._force

    def step(self) -> None:
        """See `Sensing.step`."""
        self._feel(self._felt, self._sensed, self._mass, self._gain)

    def positions(self) -> Array:
        """See `Sensing.positions`."""
        return self._body.counted

    def read(self, draws: Iterator[float]) -> Array:
        """See `Sensing.read`."""
        noise, (x, y, z) = self.noise, self._offset.tolist()
        beside = np.array((x + noise * next(draws), y + noise * next(draws), z + noise * next(draws)))
        self._turn(self._shown, self._rotation, self._felt, beside, self.range)
        return self._shown

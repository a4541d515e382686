"""The contact force by a sensor at an arm's wrist."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from foretouch.robot.arms.body import Body
from foretouch.robot.engine import OFFSET_UNCERTAINTY

Array = NDArray[np.float64]


class WristForce:
    """A force sensor between flange and tool, with the tool's weight and inertia taken off by an accelerometer in it.

    Args:
        body: Whose wrist it is.
        offset: What it shows with nothing on it, in the sensor's frame [N].
    """

    noise, bandwidth, range, contact_floor = 0.03, 150.0, 145.0, 0.0

    def __init__(self, body: Body, offset: tuple[float, float, float] = (0.1, -0.15, 0.3)) -> None:
        self._body, (_, self._mass) = body, body.description.probe
        self._offset = np.asarray(offset)
        self._sensed = body.data.sensordata
        self._gain = -math.expm1(-2.0 * math.pi * self.bandwidth * float(body.model.opt.timestep))
        self.largest_offset = math.hypot(*offset) + OFFSET_UNCERTAINTY
        self._felt, self.force = np.zeros(3), np.zeros(3)

    def step(self) -> None:
        """See `Sensing.step`."""
        sensed = self._sensed
        contact = self._mass * sensed[6:9] - sensed[0:3]  # MuJoCo gives what the flange does to the tool
        self._felt += self._gain * (contact - self._felt)
        self.force = self._body.sensor_rotation @ self._felt

    def positions(self) -> Array:
        """See `Sensing.positions`."""
        return self._body.counted

    def read(self, draws: Iterator[float]) -> Array:
        """See `Sensing.read`."""
        noise = [self.noise * next(draws) for _ in range(3)]
        shown = np.clip(self._felt + self._offset + noise, -self.range, self.range)
        return np.asarray(self._body.sensor_rotation @ shown)

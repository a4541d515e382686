"""What all designs of our own are made of: features of the motion, splines over depth, and what is believed of both.

The same formulas as in `foretouch.models.contact_map.kernel`, for whole recordings and with every choice open.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from designs.presses import Array, Press
from numba import njit

from foretouch.identification.contact_map.prior import FEATURE_REACH, LEVEL, SIZE
from foretouch.models.contact_map.layout import COARSE, PLAYS, SPEED, TIMES

LENGTH = COARSE.spacing
"""Depths are measured in this [m]: what is 1 in the coarse map."""


@njit(cache=True)
def _play(place: Array, radius: float) -> Array:
    followed = np.empty_like(place)
    at = place[0]
    for index in range(place.size):
        at = min(max(at, place[index] - radius), place[index] + radius)
        followed[index] = at
    return followed


@njit(cache=True)
def _average(place: Array, period: float, duration: float) -> Array:
    averaged = np.empty_like(place)
    at, rate = place[0], 1.0 - math.exp(-period / duration)
    for index in range(place.size):
        at += rate * (place[index] - at)
        averaged[index] = at
    return averaged


@dataclass(frozen=True)
class Features:
    """Of what the force depends on beside depth.

    Attributes:
        velocity: Whether it does on that.
        acceleration: Whether it does on that.
        plays: Radii of the play operators [m].
        averages: Time constants of the averages of depth [s].
    """

    velocity: bool = True
    acceleration: bool = False
    plays: Sequence[float] = PLAYS
    averages: Sequence[float] = TIMES

    def of(self, press: Press, place: Array, length: float = LENGTH) -> Array:
        """Each about one in a press by hand; shape (number of features, n)."""
        inside = np.maximum(place, 0.0)
        values = [press.velocity / SPEED * (LENGTH / length)] if self.velocity else []
        values += [press.acceleration / (20.0 * SPEED) * (LENGTH / length)] if self.acceleration else []
        values += [(place - _play(place, radius)) / radius for radius in self.plays]
        values += [(inside - _average(inside, press.period, time)) / (2.0 * length) for time in self.averages]
        return np.array(values).reshape(len(values), place.size)


def knots(spacing: float) -> Array:
    """Places of even knots [LENGTH], three more than there are intervals."""
    return spacing * np.arange(-math.ceil(COARSE.below / spacing) - 1, math.ceil(COARSE.above / spacing) + 2)


def splines(place: Array, spacing: float) -> Array:
    """Cubic B-splines at places [LENGTH]; shape (n, number of knots)."""
    at = np.clip(place, -COARSE.below, COARSE.above) / spacing - knots(spacing)[0] / spacing
    first = np.floor(at).astype(int)
    x = at - first
    values = np.zeros((place.size, knots(spacing).size))
    rows = np.arange(place.size)
    parts = ((1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3)
    for shift, part in enumerate(parts):
        values[rows, first + shift - 1] = part / 6.0
    return values


def smooth(one: Array, other: Array) -> Array:
    """Covariance of a force over depth [LENGTH]: white noise integrated twice from the origin both ways, a level and a
    slope (Wahba 1990)."""
    a, b = np.abs(one)[:, None], np.abs(other)[None]
    near, far = np.minimum(a, b), np.maximum(a, b)
    same_side = np.sign(one)[:, None] == np.sign(other)[None]
    bent = np.where(same_side, near * near * (3.0 * far - near) / 6.0, 0.0)
    return SIZE**2 * bent + LEVEL**2 + SIZE**2 * one[:, None] * other[None]


def alike(one: Array, other: Array) -> Array:
    """Covariance of a feature's part over depth [LENGTH]: a Gaussian process with a squared exponential."""
    return SIZE**2 * np.exp(-0.5 * ((one[:, None] - other[None]) / FEATURE_REACH) ** 2)

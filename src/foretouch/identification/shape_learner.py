"""The shape of a surface that nobody knew, learnt from touches beside law, scale and friction; compiled steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, kernel, squared
from foretouch.core.records import Record
from foretouch.models.shape_field import CELLS, CORNER, HIGHEST, PITCH, SIDE, SPREAD, packed_shape
from foretouch.quantities.pose import Vector

Array = NDArray[np.float64]

NODES = SIDE * SIDE
FRICTION, LATE = NODES, NODES + 1
"""Indices of the coefficient of friction, and of what all onsets of contact are late by, behind the nodes' heights."""
UNKNOWNS = NODES + 2
FOUR, ABOUT = 4, 16  # Nodes along each side of the square that a place depends on, and in it

REACH = 0.03
"""Length over which heights go together [m], about half the width of what lies under a hand's breadth of skin."""

FIRST_FRICTION, FRICTION_SPREAD = 0.3, 0.3  # Coefficient of friction before anything slid, and its deviation

TOUCH_DEVIATION, LATE_DEVIATION = 2e-4, 2e-4
"""Standard deviation of where a contact began [m], and of what is common to all of one material: the onset is computed
with one exponent for all."""

AIR_DEVIATION = 1e-3
"""The same of a surface that is not higher than a probe in free air [m]: a soft one is felt late."""

SLOPE_DEVIATION = 0.02
"""Standard deviation of a slope by the direction of one force, with a noise of 0.01: errors in a row are alike."""

SLOWEST, WEAKEST = 0.015, 0.4
"""Least speed [m/s] and force [N] of a probe that slides: else friction points anywhere, and noise turns the force."""

STEEPEST = 0.3  # Least part of a normal upwards: what is steeper is a side, of which heights know nothing
GATE = 5.0  # Number of standard deviations beyond which a measurement is of something else


class ShapeState(Record):
    """What a `ShapeLearner` remembers."""

    mean: Annotated[Array, float, UNKNOWNS]  # coefficients of the heights [m], and what stands behind them
    joint: Annotated[Array, float, (UNKNOWNS, UNKNOWNS)]  # their covariance
    nodes: Annotated[NDArray[Any], int, ABOUT]  # that the newest measurement was of
    weights: Annotated[Array, float, ABOUT]  # and their weights in it
    along: Annotated[Array, float, UNKNOWNS]  # covariance of all unknowns with it
    updates: int  # measurements learnt from
    refused: int  # measurements that did not fit


@compiled(error_model="numpy")
def _spline(u: float, slope: bool) -> tuple[float, float, float, float]:
    """Weights of four nodes at a place from 0 to 1 in a cell, or their derivatives by it [1/m]."""
    left, square, cube = 1.0 - u, squared(u), u * squared(u)
    if not slope:
        a, b = left * squared(left) / 6.0, (3.0 * cube - 6.0 * square + 4.0) / 6.0
        return a, b, 1.0 - a - b - cube / 6.0, cube / 6.0
    a, b, d = -0.5 * squared(left), 1.5 * square - 2.0 * u, 0.5 * square
    return a / PITCH, b / PITCH, -(a + b + d) / PITCH, d / PITCH


@compiled(error_model="numpy")
def _look_at(state: ShapeState, x: float, y: float, along: int) -> None:
    """Write which nodes the height at a place depends on, or its slope along the axis 0 or 1, and how."""
    u, v = (x - CORNER[0]) / PITCH, (y - CORNER[1]) / PITCH
    u, v = min(max(u, 0.0), 1.0 * CELLS), min(max(v, 0.0), 1.0 * CELLS)
    i, j = min(int(u), CELLS - 1), min(int(v), CELLS - 1)
    first, second = _spline(u - i, along == 0), _spline(v - j, along == 1)
    for a in range(FOUR):
        for b in range(FOUR):
            state.nodes[FOUR * a + b] = SIDE * (i + a) + j + b
            state.weights[FOUR * a + b] = first[a] * second[b]


@compiled(error_model="numpy")
def _value(state: ShapeState) -> tuple[float, float]:
    """What is looked at, and its variance."""
    value = variance = 0.0
    for a in range(ABOUT):
        n = state.nodes[a]
        value += state.weights[a] * state.mean[n]
        for b in range(ABOUT):
            variance += state.weights[a] * state.weights[b] * state.joint[n, state.nodes[b]]
    return value, max(variance, 0.0)


@compiled(error_model="numpy")
def _learn(state: ShapeState, beside: int, times: float, error: float, variance: float) -> bool:
    """Learn that what is looked at, and so many times another unknown, is larger by an error of this variance.

    One that is no number, or beyond `GATE` standard deviations, is left out. Returns whether it was learnt from.
    """
    joint, along, total = state.joint, state.along, variance
    for n in range(UNKNOWNS):
        along[n] = times * joint[beside, n]
    for a in range(ABOUT):
        row, weight = joint[state.nodes[a]], state.weights[a]
        for n in range(UNKNOWNS):
            along[n] += weight * row[n]
    total += times * along[beside]
    for a in range(ABOUT):
        total += state.weights[a] * along[state.nodes[a]]
    if not error * error < GATE * GATE * total:
        state.refused += 1
        return False
    state.updates += 1
    for n in range(UNKNOWNS):
        state.mean[n] += along[n] * error / total
        for m in range(UNKNOWNS):
            joint[n, m] -= along[n] * along[m] / total  # the same bits on both sides of the diagonal
    return True


@kernel("b1(ShapeState[::1], f8, f8, f8, f8)", error_model="numpy")
def touch(states: NDArray[np.void], x: float, y: float, z: float, deviation: float) -> bool:
    """Learn where a contact began, or free air is [m]; whether it was learnt from."""
    state = states[0]
    _look_at(state, x, y, -1)
    return bool(_learn(state, LATE, -1.0, z - _value(state)[0] + state.mean[LATE], deviation * deviation))


@kernel("b1(ShapeState[::1], f8, f8, UniTuple(f8, 3), UniTuple(f8, 3), f8)", error_model="numpy")
def slide(states: NDArray[np.void], x: float, y: float, force: Vector, velocity: Vector, deviation: float) -> bool:
    """Learn the slope at a place from the direction of a force on a probe that slides; whether it was learnt from."""
    state = states[0]
    size = math.sqrt(squared(force[0]) + squared(force[1]) + squared(force[2]))
    a, b, c = force[0] / size, force[1] / size, force[2] / size
    inwards = velocity[0] * a + velocity[1] * b + velocity[2] * c
    d, e, f = velocity[0] - inwards * a, velocity[1] - inwards * b, velocity[2] - inwards * c
    speed = math.sqrt(d * d + e * e + f * f)
    if not (size > WEAKEST and speed > SLOWEST):
        return False
    rubs = state.mean[FRICTION] / speed
    nx, ny, nz = a + rubs * d, b + rubs * e, c + rubs * f
    if not nz > STEEPEST * math.sqrt(nx * nx + ny * ny + nz * nz):
        return False
    _look_at(state, x, y, 0)
    right = _learn(state, FRICTION, d / speed / nz, -nx / nz - _value(state)[0], deviation * deviation)
    _look_at(state, x, y, 1)
    back = _learn(state, FRICTION, e / speed / nz, -ny / nz - _value(state)[0], deviation * deviation)
    return bool(right or back)


@kernel("Tuple((f8, f8))(ShapeState[::1], f8, f8)", error_model="numpy")
def height(states: NDArray[np.void], x: float, y: float) -> tuple[float, float]:
    """The height at a place and its variance [m, m^2]."""
    _look_at(states[0], x, y, -1)
    return _value(states[0])


@kernel("void(ShapeState[::1], i8[::1], f8[::1])", error_model="numpy")
def deviations(states: NDArray[np.void], nodes: NDArray[np.int64], out: Array) -> None:
    """Standard deviations of the height at some nodes [m]."""
    for n in range(nodes.size):
        i, j = nodes[n] // SIDE, nodes[n] % SIDE
        _look_at(states[0], CORNER[0] + (i - 1) * PITCH, CORNER[1] + (j - 1) * PITCH, -1)
        out[n] = math.sqrt(_value(states[0])[1])


_I, _J = np.divmod(np.arange(NODES), SIDE)


def _prior() -> Array:
    """Covariance of the unknowns before anything is touched."""
    joint = np.zeros((UNKNOWNS, UNKNOWNS))
    apart = math.sqrt(5.0) / REACH * PITCH * np.hypot(np.subtract.outer(_I, _I), np.subtract.outer(_J, _J))
    joint[:NODES, :NODES] = SPREAD**2 * (1.0 + apart + apart**2 / 3.0) * np.exp(-apart)
    joint[FRICTION, FRICTION], joint[LATE, LATE] = FRICTION_SPREAD**2, LATE_DEVIATION**2
    return joint


CHANGE = 1e-5  # Change of a height that is news [m]
MOST_NODES, IN_TURN = 54, 18
"""Largest number of nodes in a message that have changed, and number of those in turn, for a message may be lost."""


class ShapeLearner:
    r"""Learns the heights of `foretouch.models.ShapeField` from touches.

    The unknowns are its 324 coefficients c, the coefficient of friction, and what all onsets of contact are late by.
    Before anything is touched c is a Gaussian process,

    .. math:: \mathrm{cov}(c_m, c_n) = (10\,\mathrm{mm})^2 \left(1 + a + \frac{a^2}{3}\right) e^{-a}, \quad
        a = \frac{\sqrt 5 |p_m - p_n|}{30\,\mathrm{mm}}

    so that the uncertainty grows with the distance from what was touched. A Kalman filter keeps the joint covariance
    of all of them, so that rows of touches that meet mend each other. It learns

    - the height where a contact begins, which is where the force begins to grow;
    - the slope where a probe slides. The force on it is :math:`N (n - \mu t)` with the direction t of its motion, so
      that its direction, not its size, gives the normal n, whatever the stiffness of the material. The unknown
      :math:`\mu` is told from a slope where the probe comes back;
    - that the surface is no higher than a probe which feels nothing.

    A measurement that is no number, or 5 standard deviations off, is left out. What the onsets are late by is never
    told from the heights: their deviations hold it.

    Attributes:
        states: State of the compiled part, one `ShapeState`.
    """

    def __init__(self) -> None:
        self._touch, self._slide, self._height = touch.entry, slide.entry, height.entry
        self._deviations = deviations.entry
        self.reset()

    def reset(self) -> None:
        """Forget the surface."""
        self.states = ShapeState.new(joint=_prior())
        self.states["mean"][0, FRICTION] = FIRST_FRICTION
        self._told, self._turn = np.zeros(NODES), 0

    def go_back(self, earlier: NDArray[np.void]) -> None:
        """Forget what was learnt since a copy of `states` was taken. Who hears the news hears of it."""
        updates = self.updates
        self.states[:] = earlier
        self.states["updates"] = updates + 1

    @property
    def updates(self) -> int:
        """Number of measurements that it has learnt from, and of times that it went back."""
        return int(self.states[0].updates)

    @property
    def coefficients(self) -> Array:
        """Of the heights [m], shape (SIDE, SIDE), seen and not copied."""
        return self.states["mean"][0, :NODES].reshape(SIDE, SIDE)

    def touch(self, point: Sequence[float], deviation: float = TOUCH_DEVIATION) -> bool:
        """Learn a point of the surface, in the fixture's frame [m]; whether it was learnt from."""
        x, y, z = point
        return bool(self._touch(self.states, x, y, z, deviation))

    def slide(
        self, point: Sequence[float], force: Vector, velocity: Vector, deviation: float = SLOPE_DEVIATION
    ) -> bool:
        """Learn the slope at a point from the force on the probe [N] and its velocity [m/s]; whether it was."""
        return bool(self._slide(self.states, point[0], point[1], force, velocity, deviation))

    def height_at(self, point: Sequence[float]) -> tuple[float, float]:
        """Height of the surface at a point, seen from above, and its variance [m, m^2]."""
        z, variance = self._height(self.states, point[0], point[1])
        return z, variance

    def news(self) -> bytes:
        """The nodes that have changed since they were told, the surest first, and others in turn.

        They are for `foretouch.models.ShapeField.take`.
        """
        value = np.clip(self.states["mean"][0, :NODES], -HIGHEST, HIGHEST)
        change = np.abs(value - self._told)
        sure = change / np.sqrt(self.states["joint"][0].diagonal()[:NODES])
        changed = np.flatnonzero(change > CHANGE)
        picked = changed[np.argsort(-sure[changed])[:MOST_NODES]]
        turn = (self._turn + np.arange(IN_TURN)) % NODES
        self._turn = (self._turn + IN_TURN) % NODES
        picked = np.union1d(picked, turn)
        self._told[picked] = value[picked]
        deviation = np.empty(len(picked))
        self._deviations(self.states, picked, deviation)
        return packed_shape(_I[picked], _J[picked], value[picked], np.minimum(deviation, HIGHEST))

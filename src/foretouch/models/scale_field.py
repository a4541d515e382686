"""How strong a material is over a surface: a scale of the law's force, place by place."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import DecodeError
from foretouch.models.contact_model import ContactModel, advance

FIELD_DEPTH = 2e-3
"""Depth at which local stiffness is stated [m]."""

_SLOPE_STEP = 1e-4  # Half the distance over which a slope is taken [m]
_PRESS_SPEED, _PRESS_STEPS, _REST, _REST_STEPS = 0.01, 20, 1.0, 4
"""Speed of a press [m/s], the rest after it [s], and numbers of steps: ten times as many change a force by 3 %."""

Array = NDArray[np.float64]

_VERSION = 1
_HEADER = struct.Struct("<2sBxI")  # magic, version, number of nodes
NODE: np.dtype[np.void] = np.dtype([("i", "u1"), ("j", "u1"), ("value", "<f2"), ("deviation", "<f2")])


class NodePacket(NamedTuple):
    """A kind of bytes that tell what is known at the nodes of a grid over a surface: 8 for all, and 6 for each node.

    Attributes:
        magic: Its first two bytes.
        told: What it tells, as it is named where something else came.
    """

    magic: bytes
    told: str

    def pack(self, i: ArrayLike, j: ArrayLike, value: ArrayLike, deviation: ArrayLike) -> bytes:
        """Nodes by row and column, each with a number and its standard deviation, in half precision."""
        nodes = np.empty(np.size(i), NODE)
        nodes["i"], nodes["j"], nodes["value"], nodes["deviation"] = i, j, value, deviation
        return _HEADER.pack(self.magic, _VERSION, nodes.size) + nodes.tobytes()

    def unpack(self, content: bytes) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
        """Rows, columns, numbers and deviations.

        Raises:
            DecodeError: Another kind, version or length.
        """
        if len(content) < _HEADER.size:
            self.refuse(f"{len(content)} bytes, a header has {_HEADER.size}")
        magic, version, count = _HEADER.unpack_from(content)
        if magic != self.magic or version != _VERSION:
            self.refuse(f"begins with {magic!r}, version {version}, this side reads {self.magic!r}, version {_VERSION}")
        if len(content) != _HEADER.size + count * NODE.itemsize:
            self.refuse(f"{len(content)} bytes for {count} nodes of {NODE.itemsize}")
        nodes = np.frombuffer(content, NODE, count, _HEADER.size)
        i, j = nodes["i"].astype(np.int64), nodes["j"].astype(np.int64)
        return i, j, nodes["value"].astype(np.float64), nodes["deviation"].astype(np.float64)

    def refuse(self, problem: str) -> NoReturn:
        """Say what is wrong with it."""
        raise DecodeError(f"no {self.told}: {problem}")


_PACKET = NodePacket(b"SF", "field of scales")


class ScaleField:
    r"""The scale s of a law's force at each place of a surface, seen from above, as it becomes known.

    .. math:: F = s(p)\, f(x, \dot x), \quad \ln s(p) = \sum_{n=1}^{4} w_n(p)\, g_n

    with the law f of the whole material, which may remember, and the bilinear weights w of the four nodes about the
    point. Nodes stand 3 mm apart in the plane of the fixture, up to 384 mm from its origin; a point beyond has the
    scale of the rim. Places above one another, as on a steep side, have one scale.

    Before anything is known, g is a Gaussian process with a standard deviation of 1 and the covariance

    .. math:: \mathrm{cov}(g_m, g_n) = e^{-|p_m - p_n| / 20\,\mathrm{mm}}

    which is that of a process that forgets on its way: beyond what was touched, a node has the mean of its neighbours
    nearer to it, times their correlation, and so goes back to the law itself, while the deviation grows to that of the
    process. What is 24 mm away from any touch is unknown.

    Attributes:
        count: Number of nodes that were touched.
        messages: Number of messages that were taken.
    """

    __slots__ = ("_filled", "_known", "count", "messages")

    def __init__(self) -> None:
        kernel = _kernel()
        self._known, self._filled = kernel.Scales.new(), kernel.Scales.new()
        self.count = self.messages = 0

    @property
    def records(self) -> NDArray[np.void]:
        """An array of one `foretouch.models.scale_field_kernel.Scales`, with what is not touched filled."""
        records: NDArray[np.void] = self._filled
        return records

    @property
    def touched(self) -> NDArray[np.int64]:
        """Row and column of each node that was touched, shape (n, 2)."""
        return np.argwhere(self._known[0].variance < _kernel().TOUCHED)

    def take(self, content: bytes) -> None:
        """Take nodes from `packed`; others stay as they are.

        Raises:
            DecodeError: Another version or length, or a number that is out of range; then nothing is taken.
        """
        i, j, value, deviation = _PACKET.unpack(content)
        log, most = _kernel().LARGEST_LOG, _kernel().SPREAD
        if not ((np.abs(value) <= log) & (deviation >= 0.0) & (deviation <= most)).all():
            _PACKET.refuse(f"a scale beyond exp({log:g}), or a deviation that is not 0 to {most:g}")
        self.messages += 1
        if not i.size:
            return
        known = self._known[0]
        known.value[i, j], known.variance[i, j] = value, np.square(deviation)
        touched = self.touched
        self.count = len(touched)
        if self.count:
            (low_i, low_j), (high_i, high_j) = touched.min(axis=0).tolist(), touched.max(axis=0).tolist()
            _kernel().fill(known, self._filled[0], low_i, high_i, low_j, high_j)

    def scale_at(self, point: Sequence[float]) -> tuple[float, float]:
        """The scale at a point of the fixture's frame [m], and its relative standard deviation; never raises.

        A point that is not finite has the scale 1, as if nothing was touched.
        """
        x, y = point[:2]
        if not (math.isfinite(x) and math.isfinite(y)):
            return 1.0, _kernel().SPREAD
        value, variance = _kernel().scale_at(self._filled[0], x, y)
        return math.exp(value), math.sqrt(max(variance, 0.0))

    def scales_at(self, points: ArrayLike) -> tuple[Array, Array]:
        """The same at many points, of shape (n, 2) or (n, 3), finite: scales and deviations, of shape (n,)."""
        places = np.ascontiguousarray(np.asarray(points, np.float64)[:, :2])
        out = np.empty((len(places), 2))
        _kernel().scales_at(self._filled[0], places, out)
        return np.exp(out[:, 0]), np.sqrt(np.maximum(out[:, 1], 0.0))


def force_at_rest(model: ContactModel, depth: float) -> tuple[float, float]:
    """Force [N], and its standard deviation, of a probe that rests at a depth [m].

    A material that remembers was not touched before, is pressed at 10 mm/s, and rests for a second: pressed in an
    instant it would be as stiff as no hand feels it.
    """
    state, force, deviation = model.initial_state(), 0.0, math.nan
    period = max(depth, _SLOPE_STEP) / _PRESS_SPEED / _PRESS_STEPS
    for step in range(1, _PRESS_STEPS + 1):
        state, *_ = advance(model, state, depth * step / _PRESS_STEPS, _PRESS_SPEED, period)
    for _ in range(_REST_STEPS):
        state, force, deviation = advance(model, state, depth, 0.0, _REST / _REST_STEPS)
    return force, deviation


def stiffness_at_rest(model: ContactModel, depth: float = FIELD_DEPTH) -> float:
    r"""Local stiffness of a law at a depth [m], of a probe that rests there (`force_at_rest`).

    .. math:: K = \frac{F(x + h) - F(x - h)}{2 h}, \quad h = 0.1\,\mathrm{mm}
    """
    above, below = (force_at_rest(model, depth + way)[0] for way in (_SLOPE_STEP, -_SLOPE_STEP))
    return (above - below) / (2.0 * _SLOPE_STEP)


def packed(i: ArrayLike, j: ArrayLike, value: ArrayLike, variance: ArrayLike) -> bytes:
    """Nodes by row and column, the logarithms of their scales and their variances: 8 bytes, and 6 for each."""
    return _PACKET.pack(i, j, value, np.sqrt(variance))


@cache
def _kernel() -> ModuleType:
    """The compiled code, loaded when it is needed."""
    return import_module("foretouch.models.scale_field_kernel")

"""How strong a material is over a surface: a scale of the law's force, place by place."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import DecodeError
from foretouch.models.contact_model import ContactModel, advance

FIELD_DEPTH = 2e-3
"""Depth at which local stiffness is stated [m]."""

_SLOPE_STEP, _PERIOD = 1e-4, 1e-3
"""Half the distance over which a slope is taken [m], and the period of a step [s]."""

_MAGIC, _VERSION = b"SF", 1
_HEADER = struct.Struct("<2sBxI")  # magic, version, number of nodes
NODE: np.dtype[np.void] = np.dtype([("i", "u1"), ("j", "u1"), ("value", "<f2"), ("deviation", "<f2")])

Array = NDArray[np.float64]


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
        nodes, value, deviation = _unpacked(content)
        self.messages += 1
        if not nodes.size:
            return
        i, j = nodes["i"].astype(np.int64), nodes["j"].astype(np.int64)
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


def stiffness_at_rest(model: ContactModel, depth: float = FIELD_DEPTH) -> float:
    r"""Local stiffness of a law at a depth [m], of a material that was not touched before.

    .. math:: K = \frac{F(x + h) - F(x - h)}{2 h}, \quad h = 0.1\,\mathrm{mm}
    """
    state = model.initial_state()
    above, below = (advance(model, state, depth + way, 0.0, _PERIOD)[1] for way in (_SLOPE_STEP, -_SLOPE_STEP))
    return (above - below) / (2.0 * _SLOPE_STEP)


def packed(i: ArrayLike, j: ArrayLike, value: ArrayLike, variance: ArrayLike) -> bytes:
    """Nodes by row and column, the logarithms of their scales and their variances: 8 bytes, and 6 for each."""
    nodes = np.empty(np.size(i), NODE)
    nodes["i"], nodes["j"] = i, j
    nodes["value"] = value
    nodes["deviation"] = np.sqrt(variance)
    return _HEADER.pack(_MAGIC, _VERSION, nodes.size) + nodes.tobytes()


def _unpacked(content: bytes) -> tuple[NDArray[np.void], Array, Array]:
    """Nodes of `packed`, and their numbers in double precision.

    Raises:
        DecodeError: See `ScaleField.take`.
    """
    if len(content) < _HEADER.size:
        _refuse(f"{len(content)} bytes, a header has {_HEADER.size}")
    magic, version, count = _HEADER.unpack_from(content)
    if magic != _MAGIC or version != _VERSION:
        _refuse(f"begins with {magic!r}, version {version}, this side reads {_MAGIC!r}, version {_VERSION}")
    if len(content) != _HEADER.size + count * NODE.itemsize:
        _refuse(f"{len(content)} bytes for {count} nodes of {NODE.itemsize}")
    nodes = np.frombuffer(content, NODE, count, _HEADER.size)
    value, deviation = nodes["value"].astype(np.float64), nodes["deviation"].astype(np.float64)
    if not ((np.abs(value) <= _kernel().LARGEST_LOG) & (deviation >= 0.0) & (deviation <= _kernel().SPREAD)).all():
        _refuse(f"a scale beyond exp({_kernel().LARGEST_LOG:g}), or a deviation that is not 0 to {_kernel().SPREAD:g}")
    return nodes, value, deviation


def _refuse(problem: str) -> NoReturn:
    raise DecodeError(f"no field of scales: {problem}")


@cache
def _kernel() -> ModuleType:
    """The compiled code, loaded when it is needed."""
    return import_module("foretouch.models.scale_field_kernel")

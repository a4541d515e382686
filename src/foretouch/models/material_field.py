"""Materials over a surface: a law at every node of a sparse lattice."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import DecodeError, SettingError
from foretouch.errors.checks import require
from foretouch.models.memoryless_law import QuadraticContact

if TYPE_CHECKING:
    from collections.abc import Callable

NODE_SPACING = 6e-3
"""Default distance between two nodes [m]."""

MOST_NODES = 1024
"""Largest number of nodes of a field."""

FIELD_DEPTH = 2e-3
"""Depth at which the uncertainty of local stiffness is stated [m]."""

LARGEST_LAW = (1e7, 1e10, 1e9)  # Laws with a larger a [N/m], b [N/m^2] or c [N s/m^2] are refused: no material has them
LARGEST_DEVIATION = 1e9  # Fields with a larger standard deviation of local stiffness [N/m] are refused
SPACINGS = (5e-4, 0.1)  # Least and largest spacing of nodes [m]

_LARGEST = np.array([*LARGEST_LAW, LARGEST_DEVIATION])
_PLACES = np.array([1 << 32, 1 << 16, 1])  # of the numbers of a key in its code
_MAGIC, _VERSION = b"MF", 1
_HEADER = struct.Struct("<2sBxHxxf3ff")  # magic, version, count, spacing, mean law, uncertainty
_NODE = np.dtype([("key", "<i2", 3), ("values", "<f4", 4)])

Array = NDArray[np.float64]
Keys = NDArray[np.int16]


class MaterialField:
    r"""The law of a touched surface, as a function of position.

    .. math:: \theta(p) = \sum_{n=1}^{8} w_n(p)\, \theta_n, \quad \theta = (a, b, c)

    with the trilinear weights of the eight nodes about p, and `QuadraticContact` of these numbers. Where a node is not
    known, the mean law and its uncertainty stand in for it: so the law is continuous everywhere, and a probe that
    slides out of what has been learnt meets no step. Nodes stand at h (i, j, k) in the fixture's frame. A field does
    not change.

    Numbers are rounded to 32 bits, as they cross the network, so that both ends have the same field.

    Args:
        keys: (i, j, k) of the nodes, 16-bit, of shape (n, 3), each once, at most 1,024.
        values: a [N/m], b [N/m^2], c [N s/m^2] and the standard deviation of the local stiffness at 2 mm [N/m], of
            shape (n, 4), none negative.
        mean: The law (a, b, c) of unknown nodes.
        uncertainty: Standard deviation of the local stiffness there [N/m], not negative.
        spacing: Spacing h of the nodes [m], 0.5 to 100 mm.

    Attributes:
        keys: Ascending, of shape (n, 3); not to be written.
        values: In the same order, of shape (n, 4); not to be written.
        mean: As given.
        uncertainty: As given.
        spacing: As given.

    Raises:
        SettingError: An argument is out of its range.
    """

    __slots__ = ("_blend", "_blend_many", "_codes", "_unknown", "keys", "mean", "spacing", "uncertainty", "values")

    def __init__(
        self,
        keys: ArrayLike,
        values: ArrayLike,
        *,
        mean: Sequence[float],
        uncertainty: float,
        spacing: float = NODE_SPACING,
    ) -> None:
        from foretouch.models import material_field_kernel as kernel  # compiled code is loaded when it is needed

        require("spacing", spacing, at_least=SPACINGS[0], at_most=SPACINGS[1])
        wide = np.array(keys, dtype=np.int64).reshape(-1, 3)
        with np.errstate(invalid="ignore"):  # bytes from the network may hold NaN that signal
            numbers = np.array(values, dtype=np.float64).reshape(-1, kernel.NUMBERS)
        if len(wide) != len(numbers) or len(wide) > MOST_NODES:
            raise SettingError("keys", len(wide), f"must be as many as values ({len(numbers)}), {MOST_NODES} at most")
        above = wide + kernel.HALF
        if (above >> 16).any():
            raise SettingError("keys", int(np.abs(wide).max()), "must fit 16 bits: the surface is too far away")
        unknown = np.array([*mean, uncertainty], dtype=np.float64)
        if len(unknown) != kernel.NUMBERS:
            raise SettingError("mean", tuple(mean), "takes a, b, c")
        _check_numbers(unknown[np.newaxis])
        _check_numbers(numbers)
        codes = above @ _PLACES
        if not (codes[1:] > codes[:-1]).all():  # they mostly ascend
            order = np.argsort(codes, kind="stable")
            codes, wide, numbers = codes[order], wide[order], numbers[order]
            if (np.diff(codes) == 0).any():
                raise SettingError("keys", len(wide), "must be different from one another")
        self._codes = codes
        self.keys: Keys = wide.astype(np.int16)
        self.values: Array = _rounded(numbers)
        self._unknown = _rounded(unknown)
        for array in (self.keys, self.values, self._codes, self._unknown):
            array.setflags(write=False)
        a, b, c, self.uncertainty = self._unknown.tolist()
        self.mean = QuadraticContact(a, b, c)
        self.spacing = struct.unpack("<f", struct.pack("<f", spacing))[0]
        self._blend: Callable[..., tuple[float, float, float, float, float]] = kernel.blend
        self._blend_many: Callable[..., None] = kernel.blend_many

    def __len__(self) -> int:
        return len(self.keys)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MaterialField) and self.to_bytes() == other.to_bytes()

    def __hash__(self) -> int:
        return hash(self.to_bytes())

    def law_at(self, point: Sequence[float]) -> tuple[QuadraticContact, float, bool]:
        """The law at a point, within some microseconds; never raises.

        Args:
            point: Point in the fixture's frame [m], three numbers; one that is not finite counts as unknown.

        Returns:
            The law; the standard deviation of its local stiffness at 2 mm [N/m], in which the errors of nodes count as
            independent and those of unknown ones as one; and whether any node about the place is known.
        """
        x, y, z = point
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            return self.mean, self.uncertainty, False
        a, b, c, deviation, known = self._blend(self._codes, self.values, self._unknown, self.spacing, x, y, z)
        if known <= 0.0:
            return self.mean, self.uncertainty, False
        return QuadraticContact(a, b, c), deviation, True

    def stiffness_at(self, points: ArrayLike, depth: float = FIELD_DEPTH) -> tuple[Array, Array]:
        r"""Local stiffness at rest over many places, for maps.

        .. math:: K = a + 2 b x

        Args:
            points: In the fixture's frame [m], of shape (n, 3), finite.
            depth: x [m], not negative.

        Returns:
            K [N/m], and its standard deviation at 2 mm [N/m], whatever the depth; each of shape (n,).
        """
        positions = np.ascontiguousarray(np.asarray(points, dtype=np.float64).reshape(-1, 3))
        out = np.empty((len(positions), 5))
        self._blend_many(self._codes, self.values, self._unknown, self.spacing, positions, out)
        return out[:, 0] + 2.0 * depth * out[:, 1], out[:, 3].copy()

    def nodes(self) -> Array:
        """Positions of the nodes [m], of shape (n, 3)."""
        positions: Array = self.keys.astype(np.float64) * self.spacing
        return positions

    def to_bytes(self) -> bytes:
        """A header of 28 bytes and 22 for each node."""
        a, b, c = self.mean.parameters
        header = _HEADER.pack(_MAGIC, _VERSION, len(self), self.spacing, a, b, c, self.uncertainty)
        rows = np.empty(len(self), _NODE)
        rows["key"], rows["values"] = self.keys, self.values
        return header + rows.tobytes()

    @classmethod
    def from_bytes(cls, content: bytes) -> MaterialField:
        """The field of these bytes.

        Raises:
            DecodeError: Another version or length, more than 1,024 nodes, nodes that are not in ascending order, or a
                number that is not finite or out of its range.
        """
        size = len(content)
        if size < _HEADER.size:
            _refuse(f"{size} bytes, a header has {_HEADER.size}")
        magic, version, count, spacing, a, b, c, uncertainty = _HEADER.unpack_from(content)
        if magic != _MAGIC or version != _VERSION:
            _refuse(f"begins with {magic!r}, version {version}, this side reads {_MAGIC!r}, version {_VERSION}")
        if count > MOST_NODES:
            _refuse(f"{count} nodes, {MOST_NODES} at most")
        if size != _HEADER.size + count * _NODE.itemsize:
            _refuse(f"{size} bytes, {count} nodes have {_HEADER.size + count * _NODE.itemsize}")
        rows = np.frombuffer(content, _NODE, count, _HEADER.size)
        try:
            field = cls(rows["key"], rows["values"], mean=(a, b, c), uncertainty=uncertainty, spacing=spacing)
        except SettingError as error:
            _refuse(str(error))
        if field.keys.tobytes() != rows["key"].tobytes():
            _refuse("the nodes are not in ascending order")
        return field


def _check_numbers(numbers: Array) -> None:
    """Refuse laws and uncertainties out of range, in rows of (a, b, c, deviation)."""
    good = (numbers >= 0.0) & (numbers <= _LARGEST)
    if not good.all():
        row, column = np.argwhere(~good)[0]
        name = ("a", "b", "c", "deviation")[column]
        raise SettingError(name, float(numbers[row, column]), f"must be finite, 0 to {_LARGEST[column]:g}")


def _rounded(numbers: Array) -> Array:
    """Round to 32 bits, as on the wire."""
    return np.ascontiguousarray(numbers.astype(np.float32).astype(np.float64))


def _refuse(problem: str) -> NoReturn:
    raise DecodeError(f"no field of materials: {problem}")

"""A surface of heights over a regular grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError
from foretouch.models.checks import require
from foretouch.rendering.surfaces.mesh import TriangleMesh
from foretouch.rendering.surfaces.surface import Array, Surface, SurfaceContact

__all__ = ["HeightField"]


class HeightField(Surface):
    """Heights z(x, y) on a regular grid, felt from above: two triangles a cell, with the god object of `TriangleMesh`.

    Between the nodes the surface is flat in each triangle: a bilinear one has no proxy in closed form, and its normal
    jumps at the cells' edges as well.

    Args:
        heights: z [m], of shape (n, m): n along x, m along y, at least 2 by 2.
        spacing: Between nodes [m], positive.
        origin: x and y of the first node [m].

    Attributes:
        mesh: Its triangles.

    Raises:
        SettingError: A grid that is none, or heights that are not finite.
    """

    def __init__(self, heights: ArrayLike, spacing: float, origin: Sequence[float] = (0.0, 0.0)) -> None:
        require("spacing", spacing, above=0.0)
        z = np.array(heights, dtype=np.float64)
        if z.ndim != 2 or min(z.shape) < 2:
            raise SettingError("heights", z.shape, "must be of shape (n, m), 2 by 2 at least")
        n, m = z.shape
        x, y = np.meshgrid(origin[0] + spacing * np.arange(n), origin[1] + spacing * np.arange(m), indexing="ij")
        node = np.arange(n * m).reshape(n, m)
        a, b, c, d = (part.ravel() for part in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
        even = (np.add.outer(np.arange(n - 1), np.arange(m - 1)) % 2 == 0).ravel()
        # the diagonals change direction from cell to cell: none is preferred
        first = np.where(even[:, None], np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
        second = np.where(even[:, None], np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
        self.mesh = TriangleMesh(np.stack([x, y, z], axis=2).reshape(-1, 3), np.concatenate([first, second]))

    def initial_memory(self) -> Array:
        """See `Surface.initial_memory`."""
        return self.mesh.initial_memory()

    def follow(self, memory: Array, x: float, y: float, z: float) -> SurfaceContact:
        """See `Surface.follow`."""
        return self.mesh.follow(memory, x, y, z)

    def outline(self) -> tuple[Array, NDArray[np.int64]]:
        """See `Surface.outline`."""
        return self.mesh.outline()

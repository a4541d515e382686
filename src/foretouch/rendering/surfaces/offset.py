"""A surface as a sphere feels it: its centre is a point that feels the surface offset outwards by the radius."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.rendering.surfaces.surface import Array, Memory, Point, Surface, SurfaceContact


class OffsetSurface(Surface):
    r"""A surface that a sphere touches; the position that is followed is the sphere's centre c.

    .. math:: d = r + \delta(c), \quad q = c + \delta(c)\, n

    delta is the depth of the centre as of a point, minus its distance from the surface while it is outside. So d is the
    deepest overlap, q the touched point of the surface itself, and the sphere just touches where the centre is at
    q + r n. In a valley narrower than the sphere the nearest wall counts, and not what is straight below; where two are
    equally near, the normal jumps and the depth does not. There is no torque: the force acts on the centre, and a
    sphere that slides does not roll.

    A centre that has come through the surface is held as a point is, and is r deeper. A sphere overlaps an open sheet
    from whichever side its centre is on, so that up to its radius it feels the border, and the sheet from behind.

    Args:
        surface: The surface itself.
        radius: r [m], not negative. The radius of a surface that is offset already is added to it.

    Attributes:
        radius: r [m].

    Raises:
        SettingError: A radius that is negative or not finite.

    References:
        Ruspini, Kolarov and Khatib (1997), The haptic display of complex graphical environments, SIGGRAPH: a proxy of
        finite size, whose centre moves in configuration space over the surface grown by its radius.
    """

    def __init__(self, surface: Surface, radius: float) -> None:
        require("radius", radius, at_least=0.0)
        self._bare, self.radius = surface.bare, surface.radius + radius

    @property
    def bare(self) -> Surface:
        """See `Surface.bare`."""
        return self._bare

    def initial_memory(self) -> Memory:
        """See `Surface.initial_memory`."""
        return self.bare.initial_memory()

    def follow(self, memory: Memory, x: float, y: float, z: float) -> SurfaceContact:
        """Move the sphere's centre to a position [m]; see `Surface.follow`."""
        contact = self.bare.follow(memory, x, y, z)
        return contact._replace(depth=contact.depth + self.radius)

    def outline(self) -> tuple[Array, NDArray[np.int64]]:
        """The surface itself; see `Surface.outline`."""
        return self.bare.outline()

    def facing(self) -> Point:
        """See `Surface.facing`; an offset turns no normal."""
        return self.bare.facing()

    def relief(self) -> tuple[float, float]:
        """See `Surface.relief`; an offset turns no normal and makes no valley deeper."""
        return self.bare.relief()

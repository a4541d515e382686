"""How much nearer a surface may be at a place than it is believed to be, and how otherwise inclined."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface

__all__ = ["LARGEST_DOUBT", "LARGEST_TURN", "LEAST_TURN", "PoseDoubt"]

FACTOR = 3.0
"""Standard deviations that are doubted."""

SHARED = 5e-4
"""Besides, what all touches may have in common and their number does not take away [m]: where a contact began is
reckoned with one exponent for all materials, which for a spring or Hertz's ball errs by up to 0.3 mm."""

LARGEST_DOUBT = 0.1
"""Nothing is doubted further than this [m]."""

LARGEST_TURN, LEAST_TURN = 0.2, 0.1
"""A surface may be inclined against what is believed, and a robot's motion against what it is told, for each drive is
late by its own time, by at most and at least this [rad]."""

NUMBERS = 6
ROUNDING = 1e-12
"""Of a sum of variances that may be nothing [rad^2]."""


class PoseDoubt:
    r"""The doubt of a fixture's pose, at a place of its surface.

    The pose's error on the right, of covariance P, changes the height of a place q over a surface of normal n by
    J = (-n, n x q) of it. So the surface may be nearer by

    .. math:: 3 \sqrt{J P J^T} + \min(3 \sigma \sin\alpha, h) + 0.5\ \mathrm{mm}

    which is small where it was touched, however little is known of the rest of the pose. The second term is for the
    normal, which is another where the surface is displaced along itself, with a standard deviation of sigma: alpha is
    the largest angle against the mean normal, and h the surface's relief. J is taken for n and for the mean normal, for
    beside the surface's edge they differ; the larger counts. It may be inclined otherwise by

    .. math:: 3 \sqrt{\mathrm{tr} P_\phi - n^T P_\phi n} + 2 \sin\alpha\, \min(3 \sigma \sin\alpha / h, 1)

    for a turn about the normal inclines nothing, and a displacement through the whole relief may change any normal of
    it for any other.

    Args:
        surface: In the fixture's frame.
    """

    __slots__ = ("_covariance", "_facing", "_height_variance", "_known", "_relief", "_slope", "_variances")

    def __init__(self, surface: Surface) -> None:
        # Imported here: it brings a compiler along.
        from foretouch.session.spatial.pose_doubt_kernel import height_variance, variances

        self._height_variance, self._variances = height_variance, variances
        self._slope, self._relief = surface.relief()
        self._facing = surface.facing()
        self._covariance, self._known = np.zeros((NUMBERS, NUMBERS)), False

    def believe(self, covariance: Sequence[float]) -> None:
        """Take the covariance of the pose's error on the right [m, rad], 36 numbers; others mean that it is unknown."""
        self._known = len(covariance) == NUMBERS**2 and all(map(math.isfinite, covariance))
        if self._known:
            self._covariance = np.array(covariance, dtype=np.float64).reshape(NUMBERS, NUMBERS)

    def at(self, point: Vector, normal: Vector) -> tuple[float, float]:
        """At a point of the surface [m] with an outward normal, both in the fixture's frame.

        Returns:
            By how much it may be nearer [m], and otherwise inclined [rad]; the largest where the pose is unknown.
        """
        height, place, turn = self._variances(self._covariance, *normal, *point)
        if self._relief > 0.0:
            height = max(height, self._height_variance(self._covariance, *self._facing, *point))
        if not (self._known and 0.0 <= height < math.inf and 0.0 <= place < math.inf and -ROUNDING <= turn < math.inf):
            return LARGEST_DOUBT, LARGEST_TURN  # no covariance has such variances
        uneven = min(FACTOR * math.sqrt(max(place - height, 0.0)) * self._slope, self._relief)
        inclined = FACTOR * math.sqrt(max(turn, 0.0))
        if uneven > 0.0:
            inclined += 2.0 * self._slope * uneven / self._relief
        doubt = FACTOR * math.sqrt(height) + uneven + SHARED
        return min(doubt, LARGEST_DOUBT), min(max(inclined, LEAST_TURN), LARGEST_TURN)

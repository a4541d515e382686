"""What tells of the fixture's pose: an image, and a touch of its surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities.pose import Pose

__all__ = ["ContactSeen", "ImageSeen", "Seen", "is_finite"]

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImageSeen:
    """The fixture's pose as one image gives it.

    Attributes:
        time: Of the exposure [s].
        pose: Of the fixture in the world.
        covariance: Of its error on the right, (6, 6).
    """

    time: float
    pose: Pose
    covariance: Array


@dataclass(frozen=True, slots=True)
class ContactSeen:
    """A point of the surface that the probe has just touched.

    Attributes:
        time: Of the first contact [s].
        point: Of the surface, in the world [m].
        deviation: Standard deviation along the normal [m].
    """

    time: float
    point: tuple[float, float, float]
    deviation: float


Seen: TypeAlias = ImageSeen | ContactSeen


def is_finite(seen: Seen) -> bool:
    """Whether all of it is finite, and its covariance is one."""
    if not math.isfinite(seen.time):
        return False
    if isinstance(seen, ContactSeen):
        return _all_finite(seen.point) and math.isfinite(seen.deviation) and seen.deviation > 0.0
    covariance = seen.covariance
    if covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        return False
    return bool(np.abs(covariance - covariance.T).max() < 1e-9 and np.linalg.eigvalsh(covariance)[0] > 0.0)


def _all_finite(values: Sequence[float]) -> bool:
    return len(values) == 3 and all(math.isfinite(value) for value in values)

"""Long curves with fewer points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["thinned"]

Array = NDArray[np.float64]


GAP, GAP_PERIODS = 0.05, 10.0
"""Times further apart than this [s], and than so many usual periods, are not joined by a line."""


def thinned(time: Array, values: Array, buckets: int = 1500) -> tuple[Array, Array]:
    """Lowest and highest sample of each bucket, in order: the same picture with fewer points.

    In a gap of time there is one that is no number, so that no line is drawn over it.
    """
    size = -(-time.size // buckets)
    if size <= 2:
        return _with_gaps(time, time, values)
    keep = []
    finite = np.where(np.isfinite(values), values, 0.0)
    for start in range(0, time.size, size):
        piece = finite[start : start + size]
        keep += sorted({start + int(piece.argmin()), start + int(piece.argmax())})
    return _with_gaps(time, time[keep], values[keep])


def _with_gaps(time: Array, kept: Array, values: Array) -> tuple[Array, Array]:
    periods = np.diff(time)
    if not periods.size:
        return kept, values
    gaps = time[:-1][periods > max(GAP, GAP_PERIODS * float(np.median(periods)))]
    places = np.searchsorted(kept, gaps, side="right")
    return np.insert(kept, places, gaps), np.insert(values, places, np.nan)

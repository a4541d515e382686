"""Curves and marks of any length with as many points as can be seen: what a page takes is bounded by its width."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GAP, GAP_PERIODS = 0.05, 10.0
"""Times further apart than this [s], and than so many usual periods, are not joined by a line."""

NARROW = 500
"""A mark is not told from the next one where they are nearer than this part of what is shown."""


def extremes(values: Array, buckets: int = 1500) -> NDArray[np.intp]:
    """Places of the lowest and the highest sample of each bucket, in order: with them every peak is drawn.

    A bucket in which nothing is a number has one place, so that a hole in a curve stays one.

    Args:
        values: Shape (n,).
        buckets: At most so many; where there are no more than two samples for each, all are kept.

    Returns:
        Increasing, at most two for each bucket.
    """
    size = -(-values.size // buckets)
    if size <= 2:
        return np.arange(values.size)
    finite = np.isfinite(values)
    low, high = np.where(finite, values, np.inf), np.where(finite, values, -np.inf)
    kept = [
        start + int(place)
        for start in range(0, values.size, size)
        for place in sorted({low[start : start + size].argmin(), high[start : start + size].argmax()})
    ]
    return np.array(kept, dtype=np.intp)


def thinned(time: Array, values: Array, buckets: int = 1500) -> tuple[Array, Array]:
    """Lowest and highest sample of each bucket, in order: the same picture with fewer points.

    In a gap of time there is one that is no number, so that no line is drawn over it.

    Args:
        time: Increasing [s], shape (n,).
        values: Shape (n,).
        buckets: As of `extremes`; of more gaps than that the longest are kept.
    """
    kept = extremes(values, buckets)
    periods = np.diff(time)
    if not periods.size:
        return time[kept], values[kept]
    gaps = np.flatnonzero(periods > max(GAP, GAP_PERIODS * float(np.median(periods))))
    if gaps.size > buckets:
        gaps = np.sort(gaps[np.argsort(periods[gaps])[-buckets:]])
    places = np.searchsorted(time[kept], time[gaps], side="right")
    return np.insert(time[kept], places, time[gaps]), np.insert(values[kept], places, np.nan)


def joined(spans: Array, shown: float) -> Array:
    """Spans of time, those too near to each other to be told apart being one.

    Args:
        spans: Begin and end of each [s], by their begin, shape (n, 2).
        shown: Length of what the axes show [s].

    Returns:
        Shape (m, 2), at most some `NARROW` of them within what is shown.
    """
    if not len(spans):
        return spans
    ends = np.maximum.accumulate(spans[:, 1])
    cuts = np.flatnonzero(spans[1:, 0] - ends[:-1] > shown / NARROW)
    return np.column_stack((spans[np.append(0, cuts + 1), 0], ends[np.append(cuts, -1)]))


def corners(time: Array, flags: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """The times at which a flag is set, with the corners alone.

    Args:
        time: Increasing [s], shape (n,).
        flags: Shape (n,).

    Returns:
        Times and flags: of each span its begin and its end, and its end once more without the flag.
    """
    changes = np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))
    begin, end = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0) - 1
    spans = joined(np.column_stack((time[begin], time[end])), float(np.ptp(time)) if time.size else 0.0)
    return np.column_stack((spans, spans[:, 1])).ravel(), np.tile([True, True, False], len(spans))

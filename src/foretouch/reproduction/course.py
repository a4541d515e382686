"""What can be said of the course of estimated parameters: when they settle, how often they swing, how they jump."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Array",
    "History",
    "in_deep_half",
    "jump",
    "local_stiffness",
    "material_stiffness",
    "peak",
    "settled_at",
    "stiffness_at_force",
    "stiffness_in_phases",
    "swing",
]

Array = NDArray[np.float64]
History = Mapping[str, Array]

JUMP_TIME = 0.1
"""Changes within this time are jumps [s]: a twelfth of a compression."""


def settled_at(history: History, period: float, band: float | None) -> int | None:
    """Iteration from which on s stays where it is in the end.

    Where it is in the end is a band about its median over the last two presses, or its range over these two, wider by
    half of itself on either side.

    Args:
        history: Of `Watched`.
        period: Of one press [s].
        band: To either side [-]; None for the range.

    Returns:
        The iteration, that of the first note at least; None where s leaves the band within the last two presses.
    """
    time, s = history["time"], history["s"]
    if not time.size:
        return None
    late = time > time[-1] - 2.0 * period
    middle, half = float(np.median(s[late])), band
    if half is None:
        low, high = float(s[late].min()), float(s[late].max())
        middle, half = 0.5 * (low + high), high - low
    outside = np.flatnonzero(np.abs(s - middle) > half)
    if not outside.size:
        return int(history["iteration"][0])
    return None if late[outside[-1]] else int(history["iteration"][outside[-1] + 1])


def swing(history: History, period: float) -> tuple[float, float]:
    """Period of the strongest sine in ln k after the first press [s], and the share of the variance that it explains.

    A quadratic drift is taken off first. Sines from 0.4 s to 1.6 presses are tried.

    Args:
        history: Of `Watched`.
        period: Of one press [s].
    """
    time = np.arange(history["time"][0] + period, history["time"][-1], 0.02)
    values = np.interp(time, history["time"], history["ln_k"])
    values = values - np.polyval(np.polyfit(time, values, 2), time)
    total = float(values @ values)
    if not total > 0.0:
        return float("nan"), 0.0
    periods = np.arange(0.4, 1.6 * period, 0.02)
    shares = []
    for tried in periods:
        phase = 2.0 * np.pi * time / tried
        columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
        left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        shares.append(1.0 - float(left @ left) / total)
    best = int(np.argmax(shares))
    return float(periods[best]), shares[best]


def jump(history: History, after: float) -> float:
    """Largest change of ln k within 0.1 s, after a time [s] since the first sample: 1 is a factor of e in k."""
    time = np.arange(history["time"][0] + after, history["time"][-1], 0.5 * JUMP_TIME)
    values = np.interp(time, history["time"], history["ln_k"])
    return float(np.abs(values[2:] - values[:-2]).max())


def local_stiffness(ln_k: Array, s: Array, depth: float) -> Array:
    """dF/dx = k s x^(s-1) of a slow press [N/m] at a depth [m]."""
    with np.errstate(over="ignore"):
        return np.asarray(s * np.exp(ln_k + (s - 1.0) * np.log(depth)))


def stiffness_in_phases(
    history: History, turns: Sequence[float], depth: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Medians over compression and over restitution: of k [N/m^s], and of dF/dx at a depth [N/m].

    Args:
        history: Of `Watched`.
        turns: Times of the turning points [s]; compression begins at the first.
        depth: [m].
    """
    compressing = np.zeros(history["time"].size, dtype=np.bool_)
    inside = (history["time"] >= turns[0]) & (history["time"] < turns[-1])
    for begin, end in list(pairwise(turns))[::2]:
        compressing |= (history["time"] >= begin) & (history["time"] < end)
    with np.errstate(over="ignore"):
        k = np.exp(history["ln_k"])
    slope = local_stiffness(history["ln_k"], history["s"], depth)
    into, out = compressing & inside, ~compressing & inside
    return (
        (float(np.median(k[into])), float(np.median(k[out]))),
        (float(np.median(slope[into])), float(np.median(slope[out]))),
    )


def material_stiffness(position: Array, force: Array, turns: Sequence[float], time: Array, at: float) -> list[float]:
    """Slope of the felt force [N/m] around a position [m], once for each phase between two turning points.

    A straight line through the samples within 0.5 mm.
    """
    slopes = []
    for begin, end in pairwise(turns):
        near = (time >= begin) & (time < end) & (np.abs(position - at) < 5e-4)
        slopes.append(float(np.polyfit(position[near], force[near], 1)[0]))
    return slopes


def in_deep_half(history: History, deepest: float, depth: float) -> NDArray[np.intp]:
    """Indices of the samples of one press at more than half of its depth.

    Args:
        history: Of `Watched`.
        deepest: Time of its greatest depth [s]; its samples are within 1.5 s.
        depth: Its greatest depth [m].
    """
    return np.flatnonzero((np.abs(history["time"] - deepest) < 1.5) & (history["depth"] > 0.5 * depth))


def peak(values: Array, inside: NDArray[np.intp]) -> int | None:
    """Index of the largest of some values, None where there are fewer than three."""
    return int(inside[np.argmax(values[inside])]) if inside.size >= 3 else None


def stiffness_at_force(ln_k: float, s: float, force: float) -> float:
    """dF/dx of F = k x^s [N/m] where the force is `force` [N]: s F / x."""
    return s * force / float(np.exp((np.log(force) - ln_k) / s))

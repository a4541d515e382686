"""The contact map, compiled: what the material remembers, and the force.

Follower and leader call the same functions on the same flat array (`contact_map_layout`). The equations are in
`contact_map`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.models.contact_map_layout import (
    BELOW,
    COARSENESS,
    DOUBT,
    FEATURE_COUNT,
    FEATURE_KNOTS,
    FEATURE_WEIGHTS,
    FELT,
    FINE_REACH,
    KNOTS,
    LARGEST_FEATURES,
    LARGEST_FORCE,
    LAW,
    LAW_SPEED,
    LAW_SURFACE,
    LEAST_DEPTH,
    LENGTHS,
    LETTING_GO,
    LOWEST,
    MOST,
    ORIGIN,
    PLAYS,
    RANGES,
    REACH,
    REACHED,
    SHARES,
    SPEED,
    SPEED_REACH,
    STARTS,
    STEEPEST,
    TIMES,
    WEIGHTS,
    ZERO,
)

__all__ = ["cubic", "doubt", "experts", "features", "force_at", "judge", "locate", "rates", "remember", "run", "step"]

Array = NDArray[np.float64]

_compiled: Callable[[Any], Any] = njit(cache=True, error_model="numpy")
_inlined: Callable[[Any], Any] = njit(cache=True, error_model="numpy", forceinline=True)

_COARSE_LENGTH, _FINE_LENGTH = LENGTHS
_PLAYS = np.array(PLAYS)
_TIMES = np.array(TIMES)
_N_PLAYS, _N_TIMES = len(PLAYS), len(TIMES)


def _length(kind: int) -> float:
    return _COARSE_LENGTH if kind == 0 else _FINE_LENGTH


length: Callable[[int], float] = _inlined(_length)


def _cubic(place: float, spacing: float, below: int, knots: int) -> tuple[int, float, float, float, float]:
    """Cubic B-splines on even knots: the first of the four that are not zero, and their values.

    Args:
        place: Where [m]; held to the knots.
        spacing: Of the knots [m].
        below: Knots above the origin.
        knots: In all, three more than there are intervals.
    """
    at = min(max(place / spacing + below + 1.0, 1.0), knots - 2.0 - 1e-9)
    first = int(at)
    x = at - first
    y = 1.0 - x
    return (
        first - 1,
        y * y * y / 6.0,
        (3.0 * x * x * x - 6.0 * x * x + 4.0) / 6.0,
        (3.0 * y * y * y - 6.0 * y * y + 4.0) / 6.0,
        x * x * x / 6.0,
    )


cubic: Callable[[float, float, int, int], tuple[int, float, float, float, float]] = _inlined(_cubic)


def _locate(place: float, spacing: float, below: int, knots: int, values: Array) -> int:
    """`cubic` with its values in an array of shape (4,), which is written."""
    first, values[0], values[1], values[2], values[3] = cubic(place, spacing, below, knots)
    return first


locate: Callable[[float, float, int, int, Array], int] = _compiled(_locate)


def _rates(period: float, values: Array) -> None:
    """How far the averages go towards the depth in one period."""
    for k in range(_N_TIMES):
        values[k] = 1.0 - math.exp(-period / _TIMES[k])


rates: Callable[[float, Array], None] = _inlined(_rates)


def _remember(memory: Array, place: float, shares: Array) -> None:
    """One sample of motion: plays follow where pushed, averages follow in their time.

    Args:
        memory: Written in place.
        place: Of the probe, from the origin [m], positive inside.
        shares: `rates` of the time since the sample before.
    """
    inside = max(place, 0.0)
    if math.isnan(memory[0]):
        memory[:_N_PLAYS] = place
        memory[_N_PLAYS:] = inside
        return
    for k in range(_N_PLAYS):
        memory[k] = min(max(memory[k], place - _PLAYS[k]), place + _PLAYS[k])
    for k in range(_N_TIMES):
        memory[_N_PLAYS + k] += shares[k] * (inside - memory[_N_PLAYS + k])


remember: Callable[[Array, float, Array], None] = _inlined(_remember)


def _run(flat: Array, memory: Array, depths: Array, periods: Array) -> None:
    """`remember` for one sample after the other."""
    shares, period = np.empty(_N_TIMES), -1.0
    for index in range(depths.size):
        if periods[index] != period:
            period = periods[index]
            rates(period, shares)
        remember(memory, depths[index] - flat[ORIGIN], shares)


run: Callable[[Array, Array, Array, Array], None] = _compiled(_run)


def _features(memory: Array, place: float, velocity: float, values: Array) -> None:
    """What the force depends on beside depth, each about one in a press by hand: velocity, plays, averages."""
    values[0] = velocity / SPEED
    for k in range(_N_PLAYS):
        values[1 + k] = (place - memory[k]) / _PLAYS[k]
    inside = max(place, 0.0)
    for k in range(_N_TIMES):
        values[1 + _N_PLAYS + k] = (inside - memory[_N_PLAYS + k]) / (2.0 * _COARSE_LENGTH)


features: Callable[[Array, float, float, Array], None] = _inlined(_features)


def _mapped(flat: Array, kind: int, place: float, values: Array) -> float:
    """What a map gives at a place within what was visited, for features within their range [N]."""
    start = STARTS[kind]
    spacing = length(kind)
    below = BELOW[0] if kind == 0 else BELOW[1]
    first, a, b, c, d = cubic(place, spacing, below, start[KNOTS])
    at = start[WEIGHTS] + first
    force = a * flat[at] + b * flat[at + 1] + c * flat[at + 2] + d * flat[at + 3]
    knots = start[FEATURE_KNOTS]
    first, a, b, c, d = cubic(place, COARSENESS * spacing, -(-below // COARSENESS), knots)
    at = start[FEATURE_WEIGHTS] + first
    for f in range(start[FEATURE_COUNT]):
        lower, upper = flat[start[RANGES] + 2 * f], flat[start[RANGES] + 2 * f + 1]
        value = min(max(values[f], REACH * lower), REACH * upper)
        force += value * (a * flat[at] + b * flat[at + 1] + c * flat[at + 2] + d * flat[at + 3])
        at += knots
    return float(force)


mapped: Callable[[Array, int, float, Array], float] = _inlined(_mapped)


def _map_force(flat: Array, kind: int, place: float, values: Array) -> float:
    """Force of a map [N]; further in or out than ever along the slope there."""
    lowest, reached = flat[LOWEST], flat[REACHED]
    step = 0.25 * length(kind)
    if place < lowest:
        force = mapped(flat, kind, lowest, values)
        slope = (mapped(flat, kind, min(lowest + step, reached), values) - force) / step
        force = max(force - flat[ZERO], 0.0)
        return float(max(force + max(slope, force / LETTING_GO) * (place - lowest), 0.0))
    force = max(mapped(flat, kind, min(place, reached), values) - flat[ZERO], 0.0)
    if place > reached:
        before = max(mapped(flat, kind, max(reached - step, lowest), values) - flat[ZERO], 0.0)
        chord = force / max(reached + flat[ORIGIN], step, LEAST_DEPTH)
        force += (place - reached) * min(max((force - before) / step, chord), STEEPEST * chord)
    return float(force)


map_force: Callable[[Array, int, float, Array], float] = _inlined(_map_force)


def _law_force(flat: Array, place: float, velocity: float) -> float:
    """Force of the law [N], deeper than ever in proportion, faster than ever as at the largest speed."""
    shift = flat[ORIGIN] + flat[LAW_SURFACE]
    depth = place + shift
    if not (depth > 0.0 and flat[LAW] > 0.0):
        return 0.0
    known = min(depth, max(flat[REACHED] + shift, LEAST_DEPTH))
    speed = SPEED_REACH * flat[LAW_SPEED]
    velocity = min(max(velocity, -speed), speed)
    k, damping, n, alpha = flat[LAW], flat[LAW + 1], flat[LAW + 2], flat[LAW + 3]
    return float(max(known**n * (k * known**alpha * depth / known + damping * velocity), 0.0))


law_force: Callable[[Array, float, float], float] = _inlined(_law_force)


def _experts(
    flat: Array, values: Array, place: float, velocity: float, everything: bool
) -> tuple[float, float, float, float]:
    """What each expert says, and the force that they agree on by their shares [N].

    Args:
        flat: The model.
        values: `features` of this sample.
        place: From the origin [m].
        velocity: [m/s].
        everything: Whether an expert is asked even where it has no share.

    Returns:
        Forces of law, coarse and fine map, and theirs: numbers, which compiled code keeps in registers; written to an
        array they take three times as long.
    """
    coarse = map_force(flat, 0, place, values)
    # Further out than ever the law, which knows one surface, has no say.
    asked = everything or flat[SHARES] > 0.0
    law = law_force(flat, place, velocity) if asked and place >= flat[LOWEST] else coarse
    # Deeper than its knots the fine map has no say either.
    asked = everything or flat[SHARES + 2] > 0.0
    fine = map_force(flat, 1, place, values) if asked and place < FINE_REACH else coarse
    force = flat[SHARES] * law + flat[SHARES + 1] * coarse + flat[SHARES + 2] * fine
    if place > flat[REACHED]:
        force = min(force, MOST * flat[FELT])
    return law, coarse, fine, min(force, LARGEST_FORCE) if force >= 0.0 else 0.0  # 0 where it is no number


experts: Callable[[Array, Array, float, float, bool], tuple[float, float, float, float]] = _inlined(_experts)


def _judge(flat: Array, values: Array, place: float, velocity: float, everything: bool, forces: Array) -> float:
    """The force that `experts` agree on [N]; what each says is written to an array of shape (3,)."""
    forces[0], forces[1], forces[2], force = experts(flat, values, place, velocity, everything)
    return force


judge: Callable[[Array, Array, float, float, bool, Array], float] = _inlined(_judge)


def _force_at(flat: Array, memory: Array, place: float, velocity: float, values: Array) -> float:
    """Force at a memory that stays as it is [N]; its features are written."""
    features(memory, place, velocity, values)
    return experts(flat, values, place, velocity, False)[3]


force_at: Callable[[Array, Array, float, float, Array], float] = _inlined(_force_at)


def _doubt(flat: Array, force: float, velocity: float) -> float:
    """Variance of a late prediction [N^2]."""
    speed = velocity / SPEED
    return float(flat[DOUBT] + flat[DOUBT + 1] * force * force + flat[DOUBT + 2] * speed * speed)


doubt: Callable[[Array, float, float], float] = _inlined(_doubt)


def _step(flat: Array, memory: Array, depth: float, velocity: float, period: float) -> tuple[float, float]:
    """One sample of motion: the memory moves on in place; force and its standard deviation [N]."""
    values, shares = np.empty(LARGEST_FEATURES), np.empty(_N_TIMES)
    place = depth - flat[ORIGIN]
    rates(period, shares)
    remember(memory, place, shares)
    force = force_at(flat, memory, place, velocity, values)
    variance = doubt(flat, force, velocity)
    if place > flat[REACHED]:  # what the slope adds is a guess
        share = (place - flat[REACHED]) / max(place + flat[ORIGIN], 1e-9)
        variance += (min(share, 1.0) * force) ** 2
    return force, math.sqrt(variance)


step: Callable[[Array, Array, float, float, float], tuple[float, float]] = _compiled(_step)

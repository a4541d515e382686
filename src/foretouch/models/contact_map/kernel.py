"""The contact map, compiled: what the material remembers, and the force.

Follower and leader call the same functions on the same flat array (`foretouch.models.contact_map.layout`). The
equations are told by `foretouch.models.ContactMap`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.models.contact_map.layout import (
    BELOW,
    COARSENESS,
    DOUBT,
    FEATURE_COUNT,
    FEATURE_KNOTS,
    FEATURE_WEIGHTS,
    FELT,
    FINE_REACH,
    KNOTS,
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

Array = NDArray[np.float64]

Memory: TypeAlias = tuple[float, float, float, float, float]
"""What the material remembers [m]: positions of the two plays, then the three averages. Like rates and features these
are numbers, which compiled code keeps in registers; a force that takes them from an array takes twice as long."""

Rates: TypeAlias = tuple[float, float, float]
Features: TypeAlias = tuple[float, float, float, float, float, float]

Values: TypeAlias = Features | Array
"""Features as either: an estimator keeps them."""

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

_COARSE_LENGTH, _FINE_LENGTH = LENGTHS


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


def _rate_of(period: float) -> Rates:
    """How far the averages go towards the depth in one period."""
    return (
        1.0 - math.exp(-period / TIMES[0]),
        1.0 - math.exp(-period / TIMES[1]),
        1.0 - math.exp(-period / TIMES[2]),
    )


rate_of: Callable[[float], Rates] = _inlined(_rate_of)


def _rates(period: float, values: Array) -> None:
    """`rate_of` in an array of shape (3,), which is written."""
    values[0], values[1], values[2] = rate_of(period)


rates: Callable[[float, Array], None] = _inlined(_rates)


def _moved(memory: Memory, place: float, shares: Rates) -> Memory:
    """Memory after one sample of motion: plays follow where pushed, averages follow in their time.

    Args:
        memory: Before it.
        place: Of the probe, from the origin [m], positive inside.
        shares: `rate_of` the time since the sample before.
    """
    near, far, short, middle, long = memory
    inside = max(place, 0.0)
    if math.isnan(near):
        return place, place, inside, inside, inside
    return (
        min(max(near, place - PLAYS[0]), place + PLAYS[0]),
        min(max(far, place - PLAYS[1]), place + PLAYS[1]),
        short + shares[0] * (inside - short),
        middle + shares[1] * (inside - middle),
        long + shares[2] * (inside - long),
    )


moved: Callable[[Memory, float, Rates], Memory] = _inlined(_moved)


def _numbers_of(memory: Array) -> Memory:
    """Memory of an array of shape (`MEMORY`,) as numbers."""
    return memory[0], memory[1], memory[2], memory[3], memory[4]


numbers_of: Callable[[Array], Memory] = _inlined(_numbers_of)


def _write(numbers: Memory, memory: Array) -> None:
    """Memory into an array of shape (`MEMORY`,)."""
    memory[0], memory[1], memory[2], memory[3], memory[4] = numbers


write: Callable[[Memory, Array], None] = _inlined(_write)


def _remember(memory: Array, place: float, shares: Array) -> None:
    """`moved` of a memory in an array, which is written."""
    write(moved(numbers_of(memory), place, (shares[0], shares[1], shares[2])), memory)


remember: Callable[[Array, float, Array], None] = _inlined(_remember)


def _run(flat: Array, memory: Array, depths: Array, periods: Array) -> None:
    """`moved` for one sample after the other; the memory is written."""
    now, period = numbers_of(memory), -1.0
    shares = rate_of(period)
    for index in range(depths.size):
        if periods[index] != period:
            period = periods[index]
            shares = rate_of(period)
        now = moved(now, depths[index] - flat[ORIGIN], shares)
    write(now, memory)


run: Callable[[Array, Array, Array, Array], None] = _compiled(_run)


def _features_of(memory: Memory, place: float, velocity: float) -> Features:
    """What the force depends on beside depth, each about one in a press by hand: velocity, plays, averages."""
    near, far, short, middle, long = memory
    inside = max(place, 0.0)
    return (
        velocity / SPEED,
        (place - near) / PLAYS[0],
        (place - far) / PLAYS[1],
        (inside - short) / (2.0 * _COARSE_LENGTH),
        (inside - middle) / (2.0 * _COARSE_LENGTH),
        (inside - long) / (2.0 * _COARSE_LENGTH),
    )


features_of: Callable[[Memory, float, float], Features] = _inlined(_features_of)


def _features(memory: Array, place: float, velocity: float, values: Array) -> None:
    """`features_of` a memory in an array, in an array of shape (`LARGEST_FEATURES`,), which is written."""
    values[0], values[1], values[2], values[3], values[4], values[5] = features_of(numbers_of(memory), place, velocity)


features: Callable[[Array, float, float, Array], None] = _inlined(_features)


def _blend(flat: Array, at: int, a: float, b: float, c: float, d: float) -> float:
    """Four splines times the weights that stand from a place on."""
    return float(a * flat[at] + b * flat[at + 1] + c * flat[at + 2] + d * flat[at + 3])


blend: Callable[[Array, int, float, float, float, float], float] = _inlined(_blend)


def _mapped(flat: Array, kind: int, place: float, values: Values) -> float:
    """What a map gives at a place within what was visited, for features within their range [N]."""
    start = STARTS[kind]
    spacing = length(kind)
    below = BELOW[0] if kind == 0 else BELOW[1]
    first, a, b, c, d = cubic(place, spacing, below, start[KNOTS])
    force = blend(flat, start[WEIGHTS] + first, a, b, c, d)
    knots = start[FEATURE_KNOTS]
    first, a, b, c, d = cubic(place, COARSENESS * spacing, -(-below // COARSENESS), knots)
    at = start[FEATURE_WEIGHTS] + first
    for f in range(start[FEATURE_COUNT]):
        lower, upper = flat[start[RANGES] + 2 * f], flat[start[RANGES] + 2 * f + 1]
        value = min(max(values[f], REACH * lower), REACH * upper)
        force += value * blend(flat, at, a, b, c, d)
        at += knots
    return float(force)


mapped: Callable[[Array, int, float, Values], float] = _inlined(_mapped)


def _map_force(flat: Array, kind: int, place: float, values: Values) -> float:
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


map_force: Callable[[Array, int, float, Values], float] = _inlined(_map_force)


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
    flat: Array, values: Values, place: float, velocity: float, everything: bool
) -> tuple[float, float, float, float]:
    """What each expert says, and the force that they agree on by their shares [N].

    Args:
        flat: The model.
        values: `features_of` this sample.
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


experts: Callable[[Array, Values, float, float, bool], tuple[float, float, float, float]] = _inlined(_experts)


def _judge(flat: Array, values: Array, place: float, velocity: float, everything: bool, forces: Array) -> float:
    """The force that `experts` agree on [N]; what each says is written to an array of shape (3,)."""
    forces[0], forces[1], forces[2], force = experts(flat, values, place, velocity, everything)
    return force


judge: Callable[[Array, Array, float, float, bool, Array], float] = _inlined(_judge)


def _force_at(flat: Array, memory: Memory, place: float, velocity: float) -> float:
    """Force at a memory [N]."""
    return experts(flat, features_of(memory, place, velocity), place, velocity, False)[3]


force_at: Callable[[Array, Memory, float, float], float] = _inlined(_force_at)


def _doubt(flat: Array, force: float, velocity: float) -> float:
    """Variance of a late prediction [N^2]."""
    speed = velocity / SPEED
    return float(flat[DOUBT] + flat[DOUBT + 1] * force * force + flat[DOUBT + 2] * speed * speed)


doubt: Callable[[Array, float, float], float] = _inlined(_doubt)


def _advanced(flat: Array, memory: Memory, depth: float, velocity: float, period: float) -> tuple[Memory, float, float]:
    """One sample of motion: the memory after it, the force and its standard deviation [N]."""
    place = depth - flat[ORIGIN]
    memory = moved(memory, place, rate_of(period))
    force = force_at(flat, memory, place, velocity)
    variance = doubt(flat, force, velocity)
    if place > flat[REACHED]:  # what the slope adds is a guess
        share = (place - flat[REACHED]) / max(place + flat[ORIGIN], 1e-9)
        variance += (min(share, 1.0) * force) ** 2
    return memory, force, math.sqrt(variance)


advanced: Callable[[Array, Memory, float, float, float], tuple[Memory, float, float]] = _inlined(_advanced)


def _step(flat: Array, memory: Array, depth: float, velocity: float, period: float) -> tuple[float, float]:
    """`advanced` of a memory in an array, which is written: force and its standard deviation [N]."""
    after, force, deviation = advanced(flat, numbers_of(memory), depth, velocity, period)
    write(after, memory)
    return force, deviation


step: Callable[[Array, Array, float, float, float], tuple[float, float]] = _compiled(_step)

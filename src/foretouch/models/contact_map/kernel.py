"""The contact map, compiled: the memory of the material, and the force.

Follower and leader call the same functions on the same flat array (`foretouch.models.contact_map.layout`). The
equations are given by `foretouch.models.ContactMapModel`.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.models.contact_map import layout

Array = NDArray[np.float64]

Memory: TypeAlias = tuple[float, float, float, float, float]
"""Memory of the material [m]: positions of the two plays, then the three averages. Like rates and features these are
numbers, which compiled code keeps in registers; a force that takes them from an array takes twice as long."""

Rates: TypeAlias = tuple[float, float, float]
Features: TypeAlias = tuple[float, float, float, float, float, float]

Values: TypeAlias = Features | Array
"""Features as numbers or as an array, in which an estimator keeps them."""


_COARSE_LENGTH, _FINE_LENGTH = layout.LENGTHS


@inlined
def length(kind: int) -> float:
    """Spacing of the knots of the coarse map, which is kind 0, or of the fine one [m]."""
    return _COARSE_LENGTH if kind == 0 else _FINE_LENGTH


@inlined
def cubic(place: float, spacing: float, below: int, knots: int) -> tuple[int, float, float, float, float]:
    """Cubic B-splines on even knots: the first of the four that are not zero, and their values.

    Args:
        place: Position [m]; clamped to the range of the knots.
        spacing: Spacing of the knots [m].
        below: Number of knots above the origin.
        knots: Number of all knots, three more than there are intervals.
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


@compiled(error_model="numpy")
def locate(place: float, spacing: float, below: int, knots: int, values: Array) -> int:
    """`cubic` with its values in an array of shape (4,), which is written."""
    first, values[0], values[1], values[2], values[3] = cubic(place, spacing, below, knots)
    return first


@inlined
def rate_of(period: float) -> Rates:
    """Fraction of the way to the depth that each average goes in one period."""
    return (
        1.0 - math.exp(-period / layout.TIMES[0]),
        1.0 - math.exp(-period / layout.TIMES[1]),
        1.0 - math.exp(-period / layout.TIMES[2]),
    )


@inlined
def rates(period: float, values: Array) -> None:
    """`rate_of` in an array of shape (3,), which is written."""
    values[0], values[1], values[2] = rate_of(period)


@inlined
def moved(memory: Memory, place: float, shares: Rates) -> Memory:
    """Memory after one sample of motion: plays follow where pushed, averages follow in their time.

    Args:
        memory: Memory before the sample.
        place: Position of the probe, from the origin [m], positive inside.
        shares: `rate_of` the time since the previous sample.
    """
    near, far, short, middle, long = memory
    inside = max(place, 0.0)
    if math.isnan(near):
        return place, place, inside, inside, inside
    return (
        min(max(near, place - layout.PLAYS[0]), place + layout.PLAYS[0]),
        min(max(far, place - layout.PLAYS[1]), place + layout.PLAYS[1]),
        short + shares[0] * (inside - short),
        middle + shares[1] * (inside - middle),
        long + shares[2] * (inside - long),
    )


@inlined
def numbers_of(memory: Array) -> Memory:
    """Convert memory from an array of shape (`MEMORY`,) to numbers."""
    return memory[0], memory[1], memory[2], memory[3], memory[4]


@inlined
def write(numbers: Memory, memory: Array) -> None:
    """Write memory into an array of shape (`MEMORY`,)."""
    memory[0], memory[1], memory[2], memory[3], memory[4] = numbers


@inlined
def remember(memory: Array, place: float, shares: Array) -> None:
    """Update a memory in an array by `moved`, in place."""
    write(moved(numbers_of(memory), place, (shares[0], shares[1], shares[2])), memory)


@compiled(error_model="numpy")
def run(flat: Array, memory: Array, depths: Array, periods: Array) -> None:
    """Update the memory by `moved` for one sample after the other, in place."""
    now, period = numbers_of(memory), -1.0
    shares = rate_of(period)
    for index in range(depths.size):
        if periods[index] != period:
            period = periods[index]
            shares = rate_of(period)
        now = moved(now, depths[index] - flat[layout.ORIGIN], shares)
    write(now, memory)


@inlined
def features_of(memory: Memory, place: float, velocity: float) -> Features:
    """What the force depends on besides depth, each about one in a press by hand: velocity, plays, averages."""
    near, far, short, middle, long = memory
    inside = max(place, 0.0)
    return (
        velocity / layout.SPEED,
        (place - near) / layout.PLAYS[0],
        (place - far) / layout.PLAYS[1],
        (inside - short) / (2.0 * _COARSE_LENGTH),
        (inside - middle) / (2.0 * _COARSE_LENGTH),
        (inside - long) / (2.0 * _COARSE_LENGTH),
    )


@inlined
def features(memory: Array, place: float, velocity: float, values: Array) -> None:
    """`features_of` a memory in an array, in an array of shape (`LARGEST_FEATURES`,), which is written."""
    values[0], values[1], values[2], values[3], values[4], values[5] = features_of(numbers_of(memory), place, velocity)


@inlined
def blend(flat: Array, at: int, a: float, b: float, c: float, d: float) -> float:
    """Sum of four splines times the four weights from this index on."""
    return float(a * flat[at] + b * flat[at + 1] + c * flat[at + 2] + d * flat[at + 3])


@inlined
def mapped(flat: Array, kind: int, place: float, values: Values) -> float:
    """Force of a map [N] at a position within the visited range, for features within their range."""
    start = layout.STARTS[kind]
    spacing = length(kind)
    below = layout.BELOW[0] if kind == 0 else layout.BELOW[1]
    first, a, b, c, d = cubic(place, spacing, below, start[layout.KNOTS])
    force = blend(flat, start[layout.WEIGHTS] + first, a, b, c, d)
    knots = start[layout.FEATURE_KNOTS]
    first, a, b, c, d = cubic(place, layout.COARSENESS * spacing, -(-below // layout.COARSENESS), knots)
    at = start[layout.FEATURE_WEIGHTS] + first
    for f in range(start[layout.FEATURE_COUNT]):
        lower, upper = flat[start[layout.RANGES] + 2 * f], flat[start[layout.RANGES] + 2 * f + 1]
        value = min(max(values[f], layout.REACH * lower), layout.REACH * upper)
        force += value * blend(flat, at, a, b, c, d)
        at += knots
    return float(force)


@inlined
def map_force(flat: Array, kind: int, place: float, values: Values) -> float:
    """Force of a map [N]; outside the visited range it is extrapolated along the slope at its end."""
    lowest, reached = flat[layout.LOWEST], flat[layout.REACHED]
    step = 0.25 * length(kind)
    if place < lowest:
        force = mapped(flat, kind, lowest, values)
        slope = (mapped(flat, kind, min(lowest + step, reached), values) - force) / step
        force = max(force - flat[layout.ZERO], 0.0)
        return float(max(force + max(slope, force / layout.LETTING_GO) * (place - lowest), 0.0))
    force = max(mapped(flat, kind, min(place, reached), values) - flat[layout.ZERO], 0.0)
    if place > reached:
        before = max(mapped(flat, kind, max(reached - step, lowest), values) - flat[layout.ZERO], 0.0)
        chord = force / max(reached + flat[layout.ORIGIN], step, layout.LEAST_DEPTH)
        force += (place - reached) * min(max((force - before) / step, chord), layout.STEEPEST * chord)
    return float(force)


@inlined
def law_force(flat: Array, place: float, velocity: float) -> float:
    """Force of the law [N]: beyond the greatest depth in proportion, above the largest speed as at that speed."""
    shift = flat[layout.ORIGIN] + flat[layout.LAW_SURFACE]
    depth = place + shift
    if not (depth > 0.0 and flat[layout.LAW] > 0.0):
        return 0.0
    known = min(depth, max(flat[layout.REACHED] + shift, layout.LEAST_DEPTH))
    speed = layout.SPEED_REACH * flat[layout.LAW_SPEED]
    velocity = min(max(velocity, -speed), speed)
    k, damping, n, alpha = flat[layout.LAW], flat[layout.LAW + 1], flat[layout.LAW + 2], flat[layout.LAW + 3]
    return float(max(known**n * (k * known**alpha * depth / known + damping * velocity), 0.0))


@inlined
def experts(
    flat: Array, values: Values, place: float, velocity: float, everything: bool
) -> tuple[float, float, float, float]:
    """Force of each expert, and their weighted mean [N].

    Args:
        flat: The model.
        values: `features_of` this sample.
        place: Position from the origin [m].
        velocity: Velocity [m/s].
        everything: Whether an expert is evaluated even where its weight is zero.

    Returns:
        Forces of law, coarse and fine map, and their mean: numbers, which compiled code keeps in registers; written to
            an array they take three times as long.
    """
    coarse = map_force(flat, 0, place, values)
    # Further out than the visited range the law, which knows one surface, has no weight.
    asked = everything or flat[layout.SHARES] > 0.0
    law = law_force(flat, place, velocity) if asked and place >= flat[layout.LOWEST] else coarse
    # Deeper than its knots the fine map has no weight either.
    asked = everything or flat[layout.SHARES + 2] > 0.0
    fine = map_force(flat, 1, place, values) if asked and place < layout.FINE_REACH else coarse
    force = flat[layout.SHARES] * law + flat[layout.SHARES + 1] * coarse + flat[layout.SHARES + 2] * fine
    if place > flat[layout.REACHED]:
        force = min(force, layout.MOST * flat[layout.FELT])
    return law, coarse, fine, min(force, layout.LARGEST_FORCE) if force >= 0.0 else 0.0  # 0 where it is no number


@inlined
def judge(flat: Array, values: Array, place: float, velocity: float, everything: bool, forces: Array) -> float:
    """The weighted mean of `experts` [N]; the force of each is written to an array of shape (3,)."""
    forces[0], forces[1], forces[2], force = experts(flat, values, place, velocity, everything)
    return force


@inlined
def force_at(flat: Array, memory: Memory, place: float, velocity: float) -> float:
    """Force for this state of the memory [N]."""
    return experts(flat, features_of(memory, place, velocity), place, velocity, False)[3]


@inlined
def uncertainty(flat: Array, force: float, velocity: float) -> float:
    """Variance of a late prediction [N^2]."""
    speed = velocity / layout.SPEED
    return float(
        flat[layout.UNCERTAINTY]
        + flat[layout.UNCERTAINTY + 1] * force * force
        + flat[layout.UNCERTAINTY + 2] * speed * speed
    )


@inlined
def advanced(flat: Array, memory: Memory, depth: float, velocity: float, period: float) -> tuple[Memory, float, float]:
    """One sample of motion: the memory after it, the force and its standard deviation [N]."""
    place = depth - flat[layout.ORIGIN]
    memory = moved(memory, place, rate_of(period))
    force = force_at(flat, memory, place, velocity)
    variance = uncertainty(flat, force, velocity)
    if place > flat[layout.REACHED]:  # extrapolation along the slope is uncertain
        share = (place - flat[layout.REACHED]) / max(place + flat[layout.ORIGIN], 1e-9)
        variance += (min(share, 1.0) * force) ** 2
    return memory, force, math.sqrt(variance)


@compiled(error_model="numpy")
def step(flat: Array, memory: Array, depth: float, velocity: float, period: float) -> tuple[float, float]:
    """`advanced` of a memory in an array, which is written: force and its standard deviation [N]."""
    after, force, deviation = advanced(flat, numbers_of(memory), depth, velocity, period)
    write(after, memory)
    return force, deviation

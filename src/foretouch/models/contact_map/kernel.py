"""The contact map, compiled: the memory of the material, and the force; the same calls on follower and leader.

The equations are in `foretouch.models.ContactMapModel`. The memory crosses from Python as plain numbers: a call into
compiled code takes 0.3 us in any case, and each array made of a tuple for it as much again.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core import compiled, kernel, squared
from foretouch.core.compiling import inlined
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.layout import COARSE, FINE, CoarseMap, FineMap, Grid, Map
from foretouch.models.contact_model import EXIT_SPEED, SLICE_BEYOND, SLICES, SLICES_BEYOND, SPEED_STEP, ContactState

Array = NDArray[np.float64]

Memory: TypeAlias = tuple[float, float, float, float, float, float]
"""Memory of the material: positions of the two plays [m], the three averages [m], and whether it is stuck, 0 or 1. Like
rates and features these are numbers, which compiled code keeps in registers; a force that takes them from an array
takes twice as long."""

UNTOUCHED: Memory = (math.nan,) * 6

Rates: TypeAlias = tuple[float, float, float]
Features: TypeAlias = tuple[float, float, float, float, float, float]

Values: TypeAlias = Features | Array
"""Features as numbers or as an array, in which an estimator keeps them."""


@inlined
def cubic(position: float, spacing: float, below: int, knots: int) -> tuple[int, float, float, float, float]:
    """Cubic B-splines on even knots: the first of the four that are not zero, and their values.

    Args:
        position: Position [m]; clamped to the range of the knots.
        spacing: Spacing of the knots [m].
        below: Number of knots outside the origin.
        knots: Number of all knots, three more than there are intervals.
    """
    at = min(max(position / spacing + below + 1.0, 1.0), knots - 2.0 - 1e-9)
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
def locate(position: float, spacing: float, below: int, knots: int, values: Array) -> int:
    """`cubic` with its values in an array of shape (4,), which is written."""
    first, values[0], values[1], values[2], values[3] = cubic(position, spacing, below, knots)
    return first


@inlined
def rate_of(period: float) -> Rates:
    """Fraction of the distance to the depth that each average goes in one period."""
    return (
        1.0 - math.exp(-period / layout.TIMES[0]),
        1.0 - math.exp(-period / layout.TIMES[1]),
        1.0 - math.exp(-period / layout.TIMES[2]),
    )


@inlined
def moved(learnt: Map, memory: Memory, position: float, rates: Rates) -> Memory:
    """Memory after one sample at a position [m from the origin]: plays follow where pushed, averages in their time.

    What sticks to the probe does so from where it catches it until where it can hold it no longer.
    """
    near, far, short, middle, long, stuck = memory
    inside = max(position, 0.0)
    stuck = 1.0 if position >= learnt.catch else stuck if position >= learnt.hold else 0.0
    if math.isnan(near):
        return position, position, inside, inside, inside, 1.0 if stuck > 0.0 else 0.0
    return (
        min(max(near, position - layout.PLAYS[0]), position + layout.PLAYS[0]),
        min(max(far, position - layout.PLAYS[1]), position + layout.PLAYS[1]),
        short + rates[0] * (inside - short),
        middle + rates[1] * (inside - middle),
        long + rates[2] * (inside - long),
        stuck,
    )


@inlined
def numbers_of(memory: Array) -> Memory:
    """Memory as numbers, of an array of shape (`MEMORY`,)."""
    return memory[0], memory[1], memory[2], memory[3], memory[4], memory[5]


@inlined
def write(numbers: Memory, memory: Array) -> None:
    """The reverse of `numbers_of`."""
    memory[0], memory[1], memory[2], memory[3], memory[4], memory[5] = numbers


@inlined
def remember(learnt: Map, memory: Array, position: float, period: float) -> None:
    """Update a memory in an array by `moved`, in place."""
    write(moved(learnt, numbers_of(memory), position, rate_of(period)), memory)


@compiled(error_model="numpy")
def run(maps: NDArray[np.void], memory: Array, depths: Array, periods: Array) -> None:
    """Update the memory by `moved` for one sample after the other, in place."""
    now, period, learnt = numbers_of(memory), -1.0, maps[0]
    rates = rate_of(period)
    for index in range(depths.size):
        if periods[index] != period:
            period = periods[index]
            rates = rate_of(period)
        now = moved(learnt, now, depths[index] - learnt.origin, rates)
    write(now, memory)


@inlined
def features_of(memory: Memory, position: float, velocity: float) -> Features:
    """What the force depends on besides depth, each about one in a press by hand: velocity, plays, averages."""
    near, far, short, middle, long = memory[0], memory[1], memory[2], memory[3], memory[4]
    inside = max(position, 0.0)
    return (
        velocity / layout.SPEED,
        (position - near) / layout.PLAYS[0],
        (position - far) / layout.PLAYS[1],
        (inside - short) / (2.0 * COARSE.spacing),
        (inside - middle) / (2.0 * COARSE.spacing),
        (inside - long) / (2.0 * COARSE.spacing),
    )


@inlined
def features(memory: Array, position: float, velocity: float, values: Array) -> None:
    """`features_of` a memory in an array, in an array of shape (`LARGEST_FEATURES`,), which is written."""
    values[0], values[1], values[2], values[3], values[4], values[5] = features_of(
        numbers_of(memory), position, velocity
    )


@inlined
def blend(weights: Array, at: int, a: float, b: float, c: float, d: float) -> float:
    """Sum of four splines times the four weights from this index on."""
    return float(a * weights[at] + b * weights[at + 1] + c * weights[at + 2] + d * weights[at + 3])


@inlined
def mapped(part: CoarseMap | FineMap, grid: Grid, position: float, values: Values) -> float:
    """Force of a map [N] at a position within the visited range, for features within their range."""
    weights, ranges = part.weights, part.ranges
    first, a, b, c, d = cubic(position, grid.spacing, grid.below, grid.knots)
    force = blend(weights, first, a, b, c, d)
    first, a, b, c, d = cubic(position, grid.feature_spacing, grid.feature_below, grid.feature_knots)
    at = grid.knots + first
    for f in range(grid.features):
        value = min(max(values[f], ranges[f, 0]), ranges[f, 1])
        force += value * blend(weights, at, a, b, c, d)
        at += grid.feature_knots
    return float(force)


@inlined
def map_force(
    learnt: Map, part: CoarseMap | FineMap, grid: Grid, place: float, position: float, values: Values
) -> float:
    """Force of a map [N] whose knots count from a place; beyond the visited range it goes on along its last slope."""
    lowest, reached, zero = learnt.lowest - place, learnt.reached - place, learnt.zero
    position -= place
    step, least = 0.25 * grid.spacing, 0.0 - learnt.pull
    if position < lowest:
        force = mapped(part, grid, lowest, values)
        span = max(min(step, reached - lowest), 1e-6)
        slope = (mapped(part, grid, lowest + span, values) - force) / span
        force = max(force - zero, least)
        if force < 0.0:
            return float(force * max(1.0 + (position - lowest) / layout.LETTING_GO, 0.0))
        return float(max(force + max(slope, force / layout.LETTING_GO) * (position - lowest), 0.0))
    force = max(mapped(part, grid, min(position, reached), values) - zero, least)
    if position > reached and force >= 0.0:
        before = max(mapped(part, grid, max(reached - step, lowest), values) - zero, 0.0)
        chord = force / max(learnt.reached + learnt.origin, step, layout.PLAYS[0])
        force += (position - reached) * min(max((force - before) / step, chord), layout.BEYOND * chord)
    return float(force)


@inlined
def law_force(learnt: Map, position: float, velocity: float) -> float:
    """Force of the law [N]: beyond the greatest depth in proportion, above the largest speed as at that speed."""
    shift = learnt.origin + learnt.law_surface
    depth = position + shift
    k, damping, n, alpha = learnt.law[0], learnt.law[1], learnt.law[2], learnt.law[3]
    if not (depth > 0.0 and k > 0.0):
        return 0.0
    known = min(depth, max(learnt.law_reached + shift, layout.PLAYS[0]))
    speed = layout.BEYOND * learnt.law_speed
    velocity = min(max(velocity, -speed), speed)
    return float(max(known**n * (k * known**alpha * depth / known + damping * velocity), 0.0))


@inlined
def fine_part(position: float) -> float:
    """Weight of the fine map against the coarse one at a position from its place [m], by where its knots are."""
    part = min(position - layout.FINE_FROM, layout.FINE_TO - position) / layout.PLAYS[0]
    part = min(max(part, 0.0), 1.0)
    return float(part * part * (3.0 - 2.0 * part))


@inlined
def most_outside(learnt: Map, position: float) -> float:
    """Largest force [N] that is given outside of where the material was touched so far, where that is known.

    A motion that is new in free air extrapolates what velocity and memory do, and would make a force there.
    """
    away = learnt.touch - position
    if learnt.lowest > learnt.touch - learnt.touch_way:  # the probe was never outside
        return layout.LARGEST_FORCE
    # The force there is known up to the next power of two.
    return float(2.0 * learnt.touch_force * max(1.0 - away / learnt.touch_way, 0.0))


@inlined
def experts(
    learnt: Map, values: Values, position: float, velocity: float, stuck: float, everything: bool
) -> tuple[float, float, float, float]:
    """Force of law, coarse and fine map, and their weighted mean [N], of the features of this sample.

    Numbers, which compiled code keeps in registers; written to an array they take three times as long. Without
    `everything`, an expert is not evaluated where its weight is zero.
    """
    weights = learnt.shares
    coarse = map_force(learnt, learnt.coarse, COARSE, 0.0, position, values)
    # Further out than the visited range the law, which knows one surface, has no weight.
    asked = everything or weights[0] > 0.0
    law = law_force(learnt, position, velocity) if asked and position >= learnt.lowest else coarse
    # Where the fine map has no knots the coarse one stands for it.
    fine, inside = (
        coarse,
        fine_part(min(position, learnt.reached) - learnt.place) if everything or weights[2] > 0.0 else 0.0,
    )
    if inside > 0.0:
        fine += inside * (map_force(learnt, learnt.fine, FINE, learnt.place, position, values) - coarse)
    force = weights[0] * law + weights[1] * coarse + weights[2] * fine
    if position <= learnt.reached:
        force = min(force, layout.BEYOND * learnt.felt)
    if position < learnt.touch:
        force = min(force, most_outside(learnt, position))
    if not (stuck > 0.0 and position >= learnt.hold):
        force = max(force, 0.0)
    force = min(max(force, 0.0 - learnt.pull), layout.LARGEST_FORCE) if not math.isnan(force) else 0.0
    return law, coarse, fine, force


@inlined
def force_at(learnt: Map, memory: Memory, position: float, velocity: float) -> float:
    """Force for this state of the memory [N]."""
    return experts(learnt, features_of(memory, position, velocity), position, velocity, memory[layout.STUCK], False)[3]


@inlined
def uncertainty(learnt: Map, force: float) -> float:
    """Variance of a late prediction [N^2]."""
    return float(learnt.uncertainty[0] + learnt.uncertainty[1] * force * force)


@inlined
def advanced(learnt: Map, memory: Memory, depth: float, velocity: float, period: float) -> tuple[Memory, float, float]:
    """One sample of motion: the memory after it, the force and its standard deviation [N]."""
    position = depth - learnt.origin
    memory = moved(learnt, memory, position, rate_of(period))
    force = force_at(learnt, memory, position, velocity)
    variance = uncertainty(learnt, force)
    if position > learnt.reached:  # extrapolation along the slope is uncertain
        weight = (position - learnt.reached) / max(position + learnt.origin, 1e-9)
        variance += squared(min(weight, 1.0) * force)
    return memory, force, math.sqrt(variance)


@compiled
def memory_of(state: ContactState) -> Memory:
    """A state of `MEMORY` numbers; one with a number that is not finite counts as untouched."""
    for number in state:
        if not math.isfinite(number):
            return UNTOUCHED
    return state[0], state[1], state[2], state[3], state[4], state[5]


@inlined
def slopes_at(learnt: Map, memory: Memory, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """Local stiffness and damping, as `ContactModel.local_slopes` says."""
    position = depth - learnt.origin
    here = force_at(learnt, memory, position, velocity)
    deeper = force_at(learnt, memory, position + reach, velocity)
    shallower = force_at(learnt, memory, position - reach, velocity)
    faster = force_at(learnt, memory, position, velocity + SPEED_STEP)
    slower = force_at(learnt, memory, position, velocity - SPEED_STEP)
    return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)


@inlined
def work_at(learnt: Map, memory: Memory, depth: float, offset: float, largest: float) -> tuple[float, float]:
    """Work until contact is left and the way, as `ContactModel.leaving_work` says."""
    position = depth - learnt.origin
    before = max(min(force_at(learnt, memory, position, 0.0), largest) + offset, 0.0)
    energy = distance = 0.0
    for beyond in (False, True):
        count = SLICES_BEYOND if beyond else SLICES
        length = SLICE_BEYOND if beyond else max(depth, 0.0) / SLICES
        if not length > 0.0:
            continue
        rates = rate_of(length / EXIT_SPEED)
        for _ in range(count):
            if beyond and not before > 0.0:
                break
            position -= length
            memory = moved(learnt, memory, position, rates)
            after = max(min(force_at(learnt, memory, position, 0.0), largest) + offset, 0.0)
            energy += 0.5 * (before + after) * length
            distance += length
            before = after
    return energy, distance


@kernel("(Map[::1], UniTuple(f8, 6), f8, f8, f8)")
def advance(
    maps: NDArray[np.void], state: ContactState, depth: float, velocity: float, period: float
) -> tuple[ContactState, float, float]:
    """`ContactMapModel.advance` of a state of `MEMORY` numbers."""
    return advanced(maps[0], memory_of(state), depth, velocity, period)


@kernel("(Map[::1], UniTuple(f8, 6), f8, f8, f8)")
def local_slopes(
    maps: NDArray[np.void], state: ContactState, depth: float, velocity: float, reach: float
) -> tuple[float, float]:
    """`ContactMapModel.local_slopes` of a state of `MEMORY` numbers."""
    return slopes_at(maps[0], memory_of(state), depth, velocity, reach)


@kernel("(Map[::1], UniTuple(f8, 6), f8, f8, f8)")
def leaving_work(
    maps: NDArray[np.void], state: ContactState, depth: float, offset: float, largest: float
) -> tuple[float, float]:
    """`ContactMapModel.leaving_work` of a state of `MEMORY` numbers."""
    return work_at(maps[0], memory_of(state), depth, offset, largest)

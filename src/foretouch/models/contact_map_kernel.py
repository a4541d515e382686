"""The contact map, compiled: what the material remembers, the force, and the form in which both cross the network.

One flat array of numbers holds everything that a force is computed from (`HEADER`, then the two maps); follower and
leader call the same functions on it. The equations are in `contact_map`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.models.contact_model import SPEED_STEP

__all__ = [
    "COARSE",
    "EXPERTS",
    "FINE",
    "HEADER",
    "MEMORY",
    "SIZE",
    "exit_work",
    "features",
    "judge",
    "locate",
    "pack",
    "remember",
    "run",
    "slopes",
    "step",
    "unpack",
]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

LENGTHS = (1e-3, 3e-5)
"""Distance between the knots of the elastic part of the coarse and of the fine map [m]."""

BELOW = (10, 50)
ABOVE = (40, 60)
"""Knots above and below the origin, in that length: the coarse map reaches 10 mm out and 40 mm in."""

COARSENESS = 3
"""Features vary more slowly over depth than the elastic part: their knots are so many times further apart."""

PLAYS = (1e-4, 3e-4)
"""Radii of the play operators [m]."""

TIMES = (0.05, 0.3, 1.5)
"""Time constants of the averages of depth [s]."""

SPEED = 0.05
"""Speed that counts as one [m/s]."""

MEMORY = len(PLAYS) + len(TIMES)
"""Numbers of memory: positions of the plays, then the averages [m]; all NaN before the first sample."""

FEATURES = (1 + MEMORY, 1)
"""Of the coarse map: velocity, plays, averages; of the fine one: velocity."""

LARGEST_FEATURES = max(FEATURES)

REACH = 1.0
"""Features count up to this many times their range so far."""

STEEPEST = 1.5
"""Deeper than ever the force grows along the last slope, which counts as at least that of the chord from the
surface, and at most this many times it."""

SPEED_REACH = 1.5
"""The law counts speeds up to this many times the largest so far."""

LARGEST_FORCE = 1e6
"""No force is larger [N]."""

FINE_REACH = ABOVE[1] * LENGTHS[1]
"""The knots of the fine map end here [m]."""

MOST = 20.0
"""Deeper than ever the force is at most this many times the largest that was felt."""

LETTING_GO = 5e-3
"""Further out than ever a force is gone after this distance [m] at the latest."""

LEAST_DEPTH = 1e-4
"""A law that was seen no deeper than this [m] is believed down to it."""

# --- the flat array --------------------------------------------------------------------------------------------------

ORIGIN = 0  # of the maps, below the published surface [m]
ZERO = 1  # what the maps give without contact [N]
LAW = 2  # k, lambda, n, alpha
LAW_SURFACE = 6  # height of the law's surface above the published one [m]
LAW_SPEED = 7  # largest in contact so far [m/s]
LOWEST, REACHED = 8, 9  # smallest and largest place of learning [m], from the origin
DOUBT = 10  # variance of the force: constant [N^2], share of the force's square, share of the speed's [N^2]
DOUBTS = 3
SHARES = 13  # of the law, the coarse map and the fine map
EXPERTS = 3
FELT = 16  # largest force so far [N]
HEADER = 17


def _layout(kind: int, start: int) -> tuple[int, ...]:
    """Where a map stands: ranges of its features, first weight, number of knots, the same for features, end."""
    knots = BELOW[kind] + ABOVE[kind] + 3
    coarse = -(-BELOW[kind] // COARSENESS) + -(-ABOVE[kind] // COARSENESS) + 3
    features = FEATURES[kind]
    ranges, weights = start, start + 2 * features
    return ranges, weights, knots, weights + knots, coarse, features, weights + knots + features * coarse


COARSE = _layout(0, HEADER)
FINE = _layout(1, COARSE[-1])
SIZE = FINE[-1]
"""Length of the flat array."""

_STARTS = np.array([COARSE[:6], FINE[:6]])
_RANGES, _WEIGHTS, _KNOTS, _FEATURE_WEIGHTS, _FEATURE_KNOTS, _FEATURES = range(6)
_COARSE_LENGTH, _FINE_LENGTH = LENGTHS
_PLAYS = np.array(PLAYS)
_TIMES = np.array(TIMES)
_N_PLAYS, _N_TIMES = len(PLAYS), len(TIMES)


def _length(kind: int) -> float:
    return _COARSE_LENGTH if kind == 0 else _FINE_LENGTH


length: Callable[[int], float] = njit(cache=True)(_length)


def _locate(place: float, spacing: float, below: int, knots: int, values: Array) -> int:
    """Cubic B-splines on even knots: the first of the four that are not zero, and their values.

    Args:
        place: Where [m]; held to the knots.
        spacing: Of the knots [m].
        below: Knots above the origin.
        knots: In all, three more than there are intervals.
        values: Of shape (4,), written.
    """
    at = min(max(place / spacing + below + 1.0, 1.0), knots - 2.0 - 1e-9)
    first = int(at)
    x = at - first
    y = 1.0 - x
    values[0] = y * y * y / 6.0
    values[1] = (3.0 * x * x * x - 6.0 * x * x + 4.0) / 6.0
    values[2] = (3.0 * y * y * y - 6.0 * y * y + 4.0) / 6.0
    values[3] = x * x * x / 6.0
    return first - 1


locate: Callable[[float, float, int, int, Array], int] = njit(cache=True)(_locate)


def _rates(period: float, values: Array) -> None:
    """How far the averages go towards the depth in one period."""
    for k in range(_N_TIMES):
        values[k] = 1.0 - math.exp(-period / _TIMES[k])


rates: Callable[[float, Array], None] = njit(cache=True)(_rates)


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


remember: Callable[[Array, float, Array], None] = njit(cache=True)(_remember)


def _run(flat: Array, memory: Array, depths: Array, periods: Array) -> None:
    """`remember` for one sample after the other."""
    shares, period = np.empty(_N_TIMES), -1.0
    for index in range(depths.size):
        if periods[index] != period:
            period = periods[index]
            rates(period, shares)
        remember(memory, depths[index] - flat[ORIGIN], shares)


run: Callable[[Array, Array, Array, Array], None] = njit(cache=True)(_run)


def _features(memory: Array, place: float, velocity: float, values: Array) -> None:
    """What the force depends on beside depth, each about one in a press by hand: velocity, plays, averages."""
    values[0] = velocity / SPEED
    for k in range(_N_PLAYS):
        values[1 + k] = (place - memory[k]) / _PLAYS[k]
    inside = max(place, 0.0)
    for k in range(_N_TIMES):
        values[1 + _N_PLAYS + k] = (inside - memory[_N_PLAYS + k]) / (2.0 * _COARSE_LENGTH)


features: Callable[[Array, float, float, Array], None] = njit(cache=True)(_features)


def _mapped(flat: Array, kind: int, place: float, values: Array, splines: Array) -> float:
    """What a map gives at a place within what was visited, for features within their range [N]."""
    start = _STARTS[kind]
    spacing = length(kind)
    below = BELOW[0] if kind == 0 else BELOW[1]
    first = start[_WEIGHTS] + locate(place, spacing, below, start[_KNOTS], splines)
    force = 0.0
    for j in range(4):
        force += splines[j] * flat[first + j]
    knots = start[_FEATURE_KNOTS]
    first = start[_FEATURE_WEIGHTS] + locate(place, COARSENESS * spacing, -(-below // COARSENESS), knots, splines)
    for f in range(start[_FEATURES]):
        lower, upper = flat[start[_RANGES] + 2 * f], flat[start[_RANGES] + 2 * f + 1]
        value = min(max(values[f], REACH * lower), REACH * upper)
        slope = 0.0
        for j in range(4):
            slope += splines[j] * flat[first + f * knots + j]
        force += value * slope
    return force


mapped: Callable[[Array, int, float, Array, Array], float] = njit(cache=True)(_mapped)


def _map_force(flat: Array, kind: int, place: float, values: Array, splines: Array) -> float:
    """Force of a map [N]; further in or out than ever along the slope there."""
    lowest, reached = flat[LOWEST], flat[REACHED]
    step = 0.25 * length(kind)
    if place < lowest:
        force = mapped(flat, kind, lowest, values, splines)
        slope = (mapped(flat, kind, min(lowest + step, reached), values, splines) - force) / step
        force = max(force - flat[ZERO], 0.0)
        return float(max(force + max(slope, force / LETTING_GO) * (place - lowest), 0.0))
    force = max(mapped(flat, kind, min(place, reached), values, splines) - flat[ZERO], 0.0)
    if place > reached:
        before = max(mapped(flat, kind, max(reached - step, lowest), values, splines) - flat[ZERO], 0.0)
        chord = force / max(reached + flat[ORIGIN], step, LEAST_DEPTH)
        force += (place - reached) * min(max((force - before) / step, chord), STEEPEST * chord)
    return float(force)


map_force: Callable[[Array, int, float, Array, Array], float] = njit(cache=True)(_map_force)


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


law_force: Callable[[Array, float, float], float] = njit(cache=True)(_law_force)


def _judge(flat: Array, values: Array, place: float, velocity: float, everything: bool, forces: Array) -> float:
    """What each expert says, and the force that they agree on by their shares [N].

    Args:
        flat: The model.
        values: `features` of this sample.
        place: From the origin [m].
        velocity: [m/s].
        everything: Whether the fine map is asked even where it has no share.
        forces: Of law, coarse and fine map [N], shape (3,), written.
    """
    splines = np.empty(4)
    forces[1] = map_force(flat, 0, place, values, splines)
    # Further out than ever the law, which knows one surface, has no say.
    forces[0] = law_force(flat, place, velocity) if place >= flat[LOWEST] else forces[1]
    # Deeper than its knots the fine map has no say either.
    asked = everything or flat[SHARES + 2] > 0.0
    forces[2] = map_force(flat, 1, place, values, splines) if asked and place < FINE_REACH else forces[1]
    force = 0.0
    for k in range(EXPERTS):
        force += flat[SHARES + k] * forces[k]
    if place > flat[REACHED]:
        force = min(force, MOST * flat[FELT])
    return min(force, LARGEST_FORCE) if force >= 0.0 else 0.0  # 0 where it is no number


judge: Callable[[Array, Array, float, float, bool, Array], float] = njit(cache=True)(_judge)


def _doubt(flat: Array, force: float, velocity: float) -> float:
    """Variance of a late prediction [N^2]."""
    speed = velocity / SPEED
    return float(flat[DOUBT] + flat[DOUBT + 1] * force * force + flat[DOUBT + 2] * speed * speed)


doubt: Callable[[Array, float, float], float] = njit(cache=True)(_doubt)


def _step(flat: Array, memory: Array, depth: float, velocity: float, period: float) -> tuple[float, float]:
    """One sample of motion: the memory moves on in place; force and its standard deviation [N]."""
    values, forces, shares = np.empty(LARGEST_FEATURES), np.empty(EXPERTS), np.empty(_N_TIMES)
    place = depth - flat[ORIGIN]
    rates(period, shares)
    remember(memory, place, shares)
    features(memory, place, velocity, values)
    force = judge(flat, values, place, velocity, False, forces)
    variance = doubt(flat, force, velocity)
    if place > flat[REACHED]:  # what the slope adds is a guess
        share = (place - flat[REACHED]) / max(place + flat[ORIGIN], 1e-9)
        variance += (min(share, 1.0) * force) ** 2
    return force, math.sqrt(variance)


step: Callable[[Array, Array, float, float, float], tuple[float, float]] = njit(cache=True)(_step)


# --- what a renderer asks --------------------------------------------------------------------------------------------


def _force_at(flat: Array, memory: Array, place: float, velocity: float, values: Array, forces: Array) -> float:
    features(memory, place, velocity, values)
    return judge(flat, values, place, velocity, False, forces)


force_at: Callable[[Array, Array, float, float, Array, Array], float] = njit(cache=True)(_force_at)


def _slopes(flat: Array, memory: Array, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """Local stiffness [N/m], the steeper side's size, and damping [N s/m], at a memory that stays as it is."""
    values, forces = np.empty(LARGEST_FEATURES), np.empty(EXPERTS)
    place = depth - flat[ORIGIN]
    here = force_at(flat, memory, place, velocity, values, forces)
    deeper = force_at(flat, memory, place + reach, velocity, values, forces)
    shallower = force_at(flat, memory, place - reach, velocity, values, forces)
    faster = force_at(flat, memory, place, velocity + SPEED_STEP, values, forces)
    slower = force_at(flat, memory, place, velocity - SPEED_STEP, values, forces)
    return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)


slopes: Callable[[Array, Array, float, float, float], tuple[float, float]] = njit(cache=True)(_slopes)


def _exit_work(
    flat: Array, memory: Array, depth: float, offset: float, largest: float, way_out: Array
) -> tuple[float, float]:
    """Work of the force and a constant beside it, never below zero together, on the way out, without damping.

    Args:
        flat: The model.
        memory: Of now; it is left as it is.
        depth: Of now [m].
        offset: The constant [N].
        largest: The force counts as no more than this [N].
        way_out: Slices to the surface, slices beyond it, length of one of the latter [m], speed [m/s] at which averages
            are left behind.

    Returns:
        The work [J], and the way on which there is any [m].
    """
    values, forces, shares = np.empty(LARGEST_FEATURES), np.empty(EXPERTS), np.empty(_N_TIMES)
    moved = memory.copy()
    place = depth - flat[ORIGIN]
    before = max(min(force_at(flat, moved, place, 0.0, values, forces), largest) + offset, 0.0)
    energy = way = 0.0
    for part in range(2):
        count = int(way_out[part])
        length = way_out[2] if part else max(depth, 0.0) / count
        if not length > 0.0:
            continue
        rates(length / way_out[3], shares)
        for _ in range(count):
            if part and not before > 0.0:
                break
            place -= length
            remember(moved, place, shares)
            after = max(min(force_at(flat, moved, place, 0.0, values, forces), largest) + offset, 0.0)
            energy += 0.5 * (before + after) * length
            way += length
            before = after
    return energy, way


exit_work: Callable[[Array, Array, float, float, float, Array], tuple[float, float]] = njit(cache=True)(_exit_work)


# --- the network -----------------------------------------------------------------------------------------------------


def _window(flat: Array, spacing: float, below: int, knots: int, splines: Array) -> tuple[int, int]:
    """The knots that a force can be computed from: those around the places that were visited."""
    first = locate(flat[LOWEST], spacing, below, knots, splines)
    return first, locate(flat[REACHED], spacing, below, knots, splines) + 4


window: Callable[[Array, float, int, int, Array], tuple[int, int]] = njit(cache=True)(_window)


def _transfer(flat: Array, packed: Array, unpacking: bool) -> int:
    """Copy what a force can be computed from between a flat array and a short one; returns the short one's length.

    A fine map without a share is left out; -1 where the short array ends too early.
    """
    splines = np.empty(4)
    if packed.size < HEADER:
        return -1
    if unpacking:
        flat[:] = 0.0
        flat[:HEADER] = packed[:HEADER]
    else:
        packed[:HEADER] = flat[:HEADER]
    size = HEADER
    for kind in range(2):
        if kind == 1 and not flat[SHARES + 2] > 0.0:
            continue
        start = _STARTS[kind]
        below = BELOW[0] if kind == 0 else BELOW[1]
        count = start[_FEATURES]
        for part in range(2 + count):
            if part == 0:
                begin, end = start[_RANGES], start[_RANGES] + 2 * count
            elif part == 1:
                low, high = window(flat, length(kind), below, start[_KNOTS], splines)
                begin, end = start[_WEIGHTS] + low, start[_WEIGHTS] + high
            else:
                spacing, knots = COARSENESS * length(kind), start[_FEATURE_KNOTS]
                low, high = window(flat, spacing, -(-below // COARSENESS), knots, splines)
                offset = start[_FEATURE_WEIGHTS] + (part - 2) * knots
                begin, end = offset + low, offset + high
            if size + end - begin > packed.size:
                return -1
            if unpacking:
                flat[begin:end] = packed[size : size + end - begin]
            else:
                packed[size : size + end - begin] = flat[begin:end]
            size += end - begin
    return size


transfer: Callable[[Array, Array, bool], int] = njit(cache=True)(_transfer)


def pack(flat: Array) -> bytes:
    """The numbers that a force can be computed from, less those of the law, as 32-bit floats, little-endian."""
    short, rounded = np.empty(SIZE), flat.copy()
    rounded[LAW : LAW + 4] = 0.0
    # What is rounded decides which knots are needed, so it is rounded first.
    rounded = rounded.astype(np.float32).astype(np.float64)
    return short[: transfer(rounded, short, False)].astype("<f4").tobytes()


def _sensible(short: Array) -> bool:
    """Whether numbers can be those of a model."""
    total, good = 0.0, short.size >= HEADER
    for value in short:
        good = good and math.isfinite(value)
    if not good:
        return False
    for k in range(EXPERTS):
        total += short[SHARES + k]
        good = good and short[SHARES + k] >= 0.0
    for k in range(4):
        good = good and short[LAW + k] >= 0.0
    good = good and abs(total - 1.0) < 1e-3 and short[LAW_SPEED] >= 0.0
    for k in range(DOUBTS):
        good = good and short[DOUBT + k] >= 0.0
    return good and short[LOWEST] <= short[REACHED]


sensible: Callable[[Array], bool] = njit(cache=True)(_sensible)


def unpack(content: bytes) -> Array | None:
    """The flat array of packed bytes, None where they are none."""
    if len(content) % 4 or len(content) > 4 * SIZE:
        return None
    rounded = np.frombuffer(content, dtype="<f4")
    if not np.isfinite(rounded).all():
        return None
    short, flat = rounded.astype(np.float64), np.empty(SIZE)
    return flat if sensible(short) and transfer(flat, short, True) == short.size else None

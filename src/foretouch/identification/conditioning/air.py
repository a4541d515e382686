"""The force in free air, compiled: when it begins, and its drift where the geometry says that nothing is touched.

The method and its reasons are in `foretouch.identification.Conditioner`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Record, squared
from foretouch.core.compiling import inlined
from foretouch.models.contact_map.layout import PLAYS

Field = NDArray[Any]

START_WINDOW = 0.05
"""Length of a window of the newest forces [s]. A driver may repeat one number at first: in such a window its sensor's
noise is looked for. The lowest mean of such a window is the first guess of the force in free air."""

BLOCK = 0.02  # Length of a block whose mean force is taken [s]

LEVEL_WAY, LEVEL_TIME = 2e-3, 3.0 * START_WINDOW
"""Way [m] and time [s] for which a force has to be level to be that of free air: a material would give way to it."""

OUTER_SHARE = 0.25
"""Fraction of the way out, nearest to its end, that counts: what sticks to the probe lets go before. And the largest
difference of blocks of a force above the threshold of contact, relative to it, with which it is level: it is friction
then. While free air is not known otherwise, it has to become level within `LEVEL_WAY` of where it began."""

UNSURE = 0.4  # Standard deviation of a block in free air, in contact floors: blocks of a stay are alike

RATE, RATE_TIME = 0.25, 4.0
"""Standard deviation of the rate of drift, in contact floors per second, and how long one lasts [s]."""

SLOW = 5e-4  # Speed at which half of it is there [m/s]: the noise of a velocity

SURE = 3.0  # Standard deviations beyond which a block is not of the free air that was expected


UNKNOWNS = 3
"""Of free air: drift of the force [N], its rate [N/s], and the friction of the mechanism [N], which goes with the
direction of motion."""


class Start(Record):
    """How the recording began: a driver may say one number until its sensor is there."""

    since: float = math.nan  # time of the first sample [s]
    over: float = math.nan  # when the force first was another than the first one [s]
    last: float = math.nan  # newest force [N]
    before: float = math.nan  # the one before it [N]
    first: float  # force at that time [N]
    count: int  # number of differences since then
    steps: float  # sum of their squares [N^2]
    bends: float  # and of second ones [N^2]


class Level(Record):
    """A force that has been level from block to block."""

    force: float = math.nan  # mean of its blocks [N], NaN for none
    count: int  # of them
    way: float  # mean direction of their motion
    place: float  # position at which it began [m]
    since: float  # and when [s]


class Air(Record):
    """What is known of free air: a Kalman filter of `UNKNOWNS`, and the block that is being taken."""

    reference: float = math.nan  # force in free air from which the drift counts [N]; NaN while none is known
    reference_at: float = math.inf  # outermost position at which that was found [m]
    reference_in: float = -math.inf  # and innermost that is known to be free
    touching: bool  # whether there is contact
    onset: float  # position at which it began [m]
    touched: bool  # whether there was contact since the reference is known
    confirmed: bool  # whether the force was the same after it
    known: Annotated[Field, float, UNKNOWNS]
    covariance: Annotated[Field, float, (UNKNOWNS, UNKNOWNS)]
    time: float = math.nan  # of these [s]
    begin: float = math.nan  # of the block [s], NaN for none
    count: int  # of its samples
    force: float  # their sum [N]
    place: float  # that of their positions [m]
    way: float  # and that of the directions of their motion
    outermost: float = math.inf  # position of a block since the last contact [m]
    end_before: float = math.inf  # and before it
    low_at: float = math.inf  # outermost position since the last contact with a force below that of free air [m]
    held_to: float = math.inf  # position at which something that held the probe had let go [m]
    level: Level


Block = tuple[float, float, float]
"""Means of a block: position [m], force [N], direction of motion."""


@inlined
def direction(velocity: float) -> float:
    """Direction of a motion, 1 inwards: the sign of the friction."""
    return float(velocity / (abs(velocity) + SLOW))


@inlined
def drifted(air: Air, time: float) -> float:
    """Drift expected at a time [N]."""
    since = time - air.time  # NaN before the first
    return float(air.known[0] + (air.known[1] * min(since, RATE_TIME) if since > 0.0 else 0.0))


@inlined
def predict_air(air: Air, time: float, floor: float) -> None:
    """Take the filter to a time."""
    since, covariance = time - air.time if time > air.time else 0.0, air.covariance  # the first is NaN
    air.known[0], air.time = drifted(air, time), time
    for k in range(UNKNOWNS):
        covariance[0, k] += since * covariance[1, k]
    for k in range(UNKNOWNS):
        covariance[k, 0] += since * covariance[k, 1]
    most = squared(RATE * floor)
    covariance[1, 1] = min(covariance[1, 1] + most * since / RATE_TIME, most)


@inlined
def variance_of(air: Air, way: float, floor: float) -> float:
    """Variance of the mean force of a block in free air [N^2]."""
    p = air.covariance
    return float(p[0, 0] + 2.0 * way * p[0, 2] + way * way * p[2, 2] + squared(UNSURE * floor))


@inlined
def learn_air(air: Air, way: float, innovation: float, total: float) -> None:
    """Correct the filter by the force of a block in free air, less the one expected [N], and the variance of it."""
    p = air.covariance
    seen = p[0, 0] + way * p[0, 2], p[1, 0] + way * p[1, 2], p[2, 0] + way * p[2, 2]
    for k in range(UNKNOWNS):
        air.known[k] += seen[k] / total * innovation
        for m in range(UNKNOWNS):
            p[k, m] -= seen[k] * seen[m] / total


@inlined
def begin_air(air: Air, time: float, force: float, way: float, floor: float) -> None:
    """Let the drift count from this force [N], felt in a direction of motion; with NaN, from none."""
    air.reference, air.time = force, time
    air.known[:], air.covariance[:] = 0.0, 0.0
    p, friction = air.covariance, floor * floor  # it is of the size of a contact floor
    p[0, 0], p[1, 1], p[2, 2] = way * way * friction, squared(RATE * floor), friction
    p[0, 2] = p[2, 0] = -way * friction  # what is friction in this force is no zero
    air.touched = air.confirmed = False


@inlined
def take_level(level: Level, time: float, block: Block, most: float) -> bool:
    """Whether the force has been level, up to a difference [N], so far and for so long that this is free air."""
    place, force, way = block
    if math.isnan(level.force) or abs(force - level.force) > most:
        level.force, level.count, level.way, level.place, level.since = force, 0, way, place, time
    level.count += 1
    level.force += (force - level.force) / level.count
    level.way += (way - level.way) / level.count
    return abs(place - level.place) >= LEVEL_WAY and time - level.since >= LEVEL_TIME


@inlined
def follow_block(air: Air, time: float, block: Block, floor: float, is_level: bool) -> None:
    """Learn from a block in free air."""
    place, force, way = block
    predict_air(air, time, floor)
    innovation, total = force - air.reference - air.known[0] - way * air.known[2], variance_of(air, way, floor)
    if abs(innovation) <= SURE * math.sqrt(total):
        learn_air(air, way, innovation, total)
        air.confirmed = air.confirmed or air.touched
    elif not air.confirmed and -innovation > floor and place < air.reference_at:  # it was not free air
        begin_air(air, time, math.nan, 0.0, floor)
        air.touched = True
    elif is_level or (innovation < 0.0 and time - air.level.since >= LEVEL_TIME):  # nothing is lower than free air
        air.low_at = math.inf
        air.covariance[0, 0] += innovation * innovation
        air.covariance[2, 2] += innovation * innovation
        learn_air(air, way, innovation, variance_of(air, way, floor))


@inlined
def take_block(air: Air, time: float, block: Block, surface: float, limits: tuple[float, float, float]) -> bool:
    """Learn from a block if it is in free air; whether it is."""
    (place, force, _), (floor, quiet, zero) = block, limits
    if air.touching:
        quiet = min(quiet, OUTER_SHARE * abs(force - zero))
    has_risen = force > air.level.force + quiet
    is_level = take_level(air.level, time, block, quiet)
    if air.touching:
        if not air.touched:  # by now it is no spike of the sensor
            air.touched, air.reference_in = True, max(air.reference_in, air.onset)
        is_first = not air.confirmed and abs(air.level.place - air.onset) <= LEVEL_WAY
        if not (is_level and (is_first or place <= air.reference_in)):
            return False
    else:
        air.outermost = min(air.outermost, place)
    if math.isnan(air.reference):
        if is_level and (air.touching or not air.touched):
            begin_air(air, time, air.level.force, air.level.way, floor)
            air.reference_at, air.reference_in = min(place, air.level.place), max(place, air.level.place)
        return True
    if math.isinf(air.reference_in):
        air.reference_in = place
    low = air.reference + drifted(air, time) + block[2] * air.known[2] - force
    if low > floor:
        air.low_at = min(air.low_at, place)
    elif place < air.low_at - PLAYS[1] < math.inf and not has_risen:  # friction lasts until the probe turns
        air.low_at, air.held_to = math.inf, place
    if low > floor and (has_risen or place > air.held_to):
        return True  # something lets go within the block, or holds the probe where it has done so before
    end = min(air.outermost, air.end_before)
    # While no surface is known, further in may be inside a soft material.
    inner = air.reference_in if math.isnan(surface) else end + OUTER_SHARE * (surface - end)
    if air.touching or place <= inner:
        follow_block(air, time, block, floor, is_level)
    return True


@inlined
def follow_air(
    air: Air, time: float, sample: Block, touching: bool, surface: float, limits: tuple[float, float, float]
) -> bool:
    """Take one sample; whether there is contact, for a force that is level in free air is none.

    Args:
        air: Written.
        time: Of the sample [s].
        sample: Its position [m], its force with the offset [N], and its direction of motion.
        touching: Whether the force alone says so.
        surface: Position of the surface [m]; NaN where it is not known.
        limits: Least force that counts as contact, largest difference of two blocks in free air, and zero of the force
            as known [N].
    """
    if touching != air.touching:
        air.touching, air.begin, air.level.force = touching, math.nan, math.nan
        air.low_at = math.inf if touching else air.low_at
        if touching:
            if air.outermost < math.inf:
                air.end_before = air.outermost
            air.outermost, air.onset = math.inf, sample[0]
    if math.isnan(air.begin):
        air.begin, air.count, air.place, air.force, air.way = time, 0, 0.0, 0.0, 0.0
    air.count += 1
    air.place += sample[0]
    air.force += sample[1]
    air.way += sample[2]
    if time - air.begin >= BLOCK:
        air.begin = math.nan
        block = air.place / air.count, air.force / air.count, air.way / air.count
        if take_block(air, time, block, surface, limits):
            air.touching = False
    return bool(air.touching)


@inlined
def begins_now(start: Start, first: float, time: float, force: float) -> bool:
    """Whether all samples so far were one number and the newest ones are noise: the sensor has come only now.

    The squares of the second differences of white noise are three times those of the first; those of a contact that
    begins are small against them, those of a sensor's steps at most twice; and noise leads nowhere.
    """
    if math.isnan(start.over):
        if math.isnan(first):
            start.since = time
        elif force != first:  # a number that did not last is one of the noise
            start.over, start.first = (time if time - start.since >= START_WINDOW else -math.inf), force
        return False
    if time - start.over > 2.0 * START_WINDOW:
        return False
    step, bend = force - start.last, force - 2.0 * start.last + start.before
    if not math.isnan(bend):
        start.count += 1
        start.steps += step * step
        start.bends += bend * bend
    start.before, start.last = start.last, force
    if time - start.over <= START_WINDOW or not start.bends > 2.5 * start.steps > 0.0:
        return False
    rise = force - start.first
    return bool(rise * rise < 9.0 * start.steps / start.count)

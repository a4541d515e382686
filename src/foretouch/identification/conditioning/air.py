"""The force in free air, compiled: when it begins, and its drift where the geometry says that nothing is touched.

The method and its reasons are in `foretouch.identification.Conditioner`.
"""

from __future__ import annotations

import math

from foretouch.core import Record
from foretouch.core.compiling import inlined

BLOCK = 0.02  # Length of a block whose mean force is taken [s]

LEVEL_WAY, LEVEL_TIME = 3e-3, 0.15
"""Way [m] and time [s] for which a force has to be level to be that of free air: a material would give way to it."""

OUTER_SHARE = 0.25  # Fraction of the way out, nearest to its end, that counts: what sticks to the probe lets go before

UNSURE = 0.4
"""Standard deviation of a block in free air, as a fraction of the contact floor: friction of the mechanism is in it,
and the blocks of one stay are alike."""

RATE, RATE_TIME = 0.25, 60.0
"""Standard deviation of the rate of drift, in contact floors per second, and the time in which it changes [s]."""

LONGEST = 2.0  # Time for which the drift goes on unseen [s]

SURE = 4.0  # Standard deviations beyond which a block is not of the drift that was expected

LET_GO = 3e-4  # Least way beyond a force below that of free air after which something has let go [m]

START_WINDOW = 0.04  # Time over which it is seen whether a force that was one number before is noise now [s]


class Start(Record):
    """How the recording began: a driver may say one number until its sensor is there."""

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
    place: float  # position at which it began [m]
    since: float  # and when [s]


class Air(Record):
    """What is known of free air: a Kalman filter of the drift and its rate, and the block that is being taken."""

    reference: float = math.nan  # force in free air from which the drift counts [N]; NaN while none is known
    reference_at: float  # outermost position at which that was found [m]
    reference_in: float  # and innermost
    touched: bool  # whether there was contact since
    confirmed: bool  # whether the force was the same after it
    drift: float  # [N]
    rate: float  # of the drift [N/s]
    time: float = math.nan  # of these two [s]
    variance: float  # of the drift [N^2]
    shared: float  # covariance of drift and rate [N^2/s]
    rate_variance: float  # [N^2/s^2]
    begin: float = math.nan  # of the block [s], NaN for none
    count: int  # of its samples
    force: float  # their sum [N]
    place: float  # and that of their positions [m]
    outermost: float = math.inf  # position of a block since the last contact [m]
    end_before: float = math.inf  # and before it
    low_at: float = math.inf  # outermost position since the last contact with a force below that of free air [m]
    held_to: float = math.inf  # position at which something that held the probe had let go [m]
    level: Level


@inlined
def drifted(air: Air, time: float) -> float:
    """Drift expected at a time [N]."""
    since = min(max(time - air.time, 0.0), LONGEST)
    return air.drift + air.rate * since if since > 0.0 else air.drift


@inlined
def predict_drift(air: Air, time: float, floor: float) -> None:
    """Take the filter to a time."""
    since = max(time - air.time, 0.0)
    air.drift, air.time = drifted(air, time), time
    air.variance += since * (2.0 * air.shared + since * air.rate_variance)
    air.shared += since * air.rate_variance
    most = (RATE * floor) ** 2
    air.rate_variance = min(air.rate_variance + most * since / RATE_TIME, most)


@inlined
def take_level(air: Air, innovation: float, floor: float) -> None:
    """Correct the filter by the force of a block in free air, less the one expected [N]."""
    total = air.variance + (UNSURE * floor) ** 2
    gain, rate_gain = air.variance / total, air.shared / total
    air.drift += gain * innovation
    air.rate += rate_gain * innovation
    air.rate_variance -= rate_gain * air.shared
    air.shared *= 1.0 - gain
    air.variance *= 1.0 - gain


@inlined
def begin_drift(air: Air, time: float, force: float, floor: float) -> None:
    """Let the drift count from this force [N]; with NaN, from none."""
    air.reference, air.time, air.rate_variance = force, time, (RATE * floor) ** 2
    air.drift = air.rate = air.variance = air.shared = 0.0
    air.touched = air.confirmed = False


@inlined
def take_block(air: Air, time: float, block: tuple[float, float], surface: float, floor: float, quiet: float) -> None:
    """Learn from a block out of contact: its mean position [m] and force [N]."""
    place, force = block
    has_risen = force > air.level.force + quiet
    if math.isnan(air.level.force) or abs(force - air.level.force) > quiet:
        air.level.force, air.level.count, air.level.place, air.level.since = force, 0, place, time
    air.level.count += 1
    air.level.force += (force - air.level.force) / air.level.count
    is_level = abs(place - air.level.place) >= LEVEL_WAY and time - air.level.since >= LEVEL_TIME
    air.outermost = min(air.outermost, place)
    if math.isnan(air.reference):
        if is_level and not air.touched:
            begin_drift(air, time, air.level.force, floor)
            air.reference_at, air.reference_in = min(place, air.level.place), max(place, air.level.place)
        return
    low = air.reference + drifted(air, time) - force
    if low > floor:
        air.low_at = min(air.low_at, place)
    elif place < air.low_at - LET_GO < math.inf and not has_risen:  # friction lasts until the probe turns
        air.low_at, air.held_to = math.inf, place
    if low > floor and (has_risen or place > air.held_to):
        return  # something lets go within the block, or holds the probe where it has done so before
    end = min(air.outermost, air.end_before)
    # While no surface is known, further in may be inside a soft material.
    if place > (air.reference_in if math.isnan(surface) else end + OUTER_SHARE * (surface - end)):
        return
    predict_drift(air, time, floor)
    innovation = force - air.reference - air.drift
    if abs(innovation) <= SURE * math.sqrt(air.variance + (UNSURE * floor) ** 2):
        take_level(air, innovation, floor)
        air.confirmed = air.confirmed or air.touched
    elif not air.confirmed and -innovation > floor and place < air.reference_at:  # it was not free air
        begin_drift(air, time, math.nan, floor)
        air.touched = True
    elif is_level or (innovation < 0.0 and time - air.level.since >= LEVEL_TIME):  # nothing is lower than free air
        air.low_at = math.inf
        air.drift, air.variance, air.shared = force - air.reference, 0.0, 0.0


@inlined
def follow_air(air: Air, time: float, sample: tuple[float, float], surface: float, floor: float, quiet: float) -> None:
    """Take one sample out of contact.

    Args:
        air: Written.
        time: Of the sample [s].
        sample: Its position [m], and its force with the offset [N].
        surface: Position of the surface [m]; NaN where it is not known.
        floor: Least force that counts as contact [N].
        quiet: Largest difference of two blocks in free air [N].
    """
    if math.isnan(air.begin):
        air.begin, air.count, air.force, air.place = time, 0, 0.0, 0.0
    air.count += 1
    air.place += sample[0]
    air.force += sample[1]
    if time - air.begin >= BLOCK:
        air.begin = math.nan
        take_block(air, time, (air.place / air.count, air.force / air.count), surface, floor, quiet)


@inlined
def leave_air(air: Air) -> None:
    """There is contact: what is being taken is none of free air."""
    if air.outermost < math.inf:
        air.end_before = air.outermost
    air.begin, air.level.force, air.outermost, air.touched = math.nan, math.nan, math.inf, True
    air.low_at = math.inf


@inlined
def begins_now(start: Start, first: float, time: float, force: float) -> bool:
    """Whether all samples so far were one number and the newest ones are noise: the sensor has come only now.

    The squares of the second differences of white noise are three times those of the first; those of a contact that
    begins are small against them, those of a sensor's steps at most twice; and noise leads nowhere.
    """
    if math.isnan(start.over):
        if force != first and not math.isnan(first):
            start.over, start.first = time, force
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

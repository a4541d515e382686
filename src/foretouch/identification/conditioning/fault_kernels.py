r"""Fault detection for a measured force that contradicts the robot's motion, compiled: lost contact, stepping offset.

Two signs show that a force in contact is wrong:

- **depth**: within 8 ms it falls below 0.4 of what no material could have lost, for three samples:

  .. math:: F < 0.4\,\big(F_0 - b\,(v_0 - v) - K\,(x_0 - x + \epsilon)\big) - 0.2\ \mathrm{N}

  with force, position and speed of 8 ms ago (index 0), each term only where it is positive: slowing down frees no more
  than the damping of b = 500 N s/m, going outwards, on the mean of four samples and 5 um more, no more than a stiffness
  of K = 200 kN/m, and what relaxes at once is less than 0.6;
- **the drive's effort**, where the robot measures it: force and effort of the drive differ by more than 2 N and a fifth
  of the larger for 30 ms, both low-passed with 4 ms.

A force that changes without contact is a step of the sensor's offset. It is a fault as soon as one of these holds:

- **still**: the force steps within two samples, by at least 0.3 N and fifteen standard deviations of the force before
  (fading mean and variance, 10 ms), and for 50 ms it stays level and the probe stays within 50 um;
- **pulling**: the force steps like that and stays for 50 ms 0.3 N below the zero. What sticks begins to pull like that,
  by 2 N at most, a probe that comes nearer; then it is a fault only where the force is still as level 5 mm further;
- **free motion**: the probe goes outwards by 1 mm for at least 50 ms, the force stays level (within 0.3 N) and is 0.6 N
  above the zero, where the last motion outwards was free.

The zero is the force in free air, not known at first. It is the lowest level of such a motion; levels up to 0.15 N
above it raise it slowly, in 60 s. A soft foam can be as level as free air, but not where there was free air; and what
holds a probe that leaves can be level and lower, so no level counts that is 0.3 N below a zero that is told. A step
from below up to the zero is something that lets go.

Two samples that span more than 3 ms, and smaller steps, are not judged.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled

Array = NDArray[np.float64]


class SensorState(IntEnum):
    """Fault of the sensors; `SENSOR_SENTENCES` has the sentence."""

    GOOD = 0
    NOT_FINITE = 1
    DROPOUT = 2
    STUCK = 3
    SATURATED = 4
    OFFSET_STEP = 5
    SPIKE = 6
    ENCODER_JUMP = 7
    CONTACT_LOST = 8
    FORCE_DISAGREES = 9


GOOD, NOT_FINITE, DROPOUT, STUCK, SATURATED, OFFSET_STEP, SPIKE, ENCODER_JUMP, CONTACT_LOST, FORCE_DISAGREES = map(
    int, SensorState
)

SPAN, PLACES = 8e-3, 16
"""Age [s] of the force that the newest is compared with, and the largest number of samples in that time."""

LONGEST_PERIOD = 4e-3  # Samples that are further apart than this [s] show nothing sudden
WINDOW = 4  # Number of samples for a mean speed or position: the force follows later than these means show the motion
KEPT = 0.4  # Fraction of a force that remains for a moment in every material while the probe stays
LEAST = 0.2  # Least missing force [N] that counts, above noise and zero error of the sensor
TOUCHING = 1.0  # Least expected remaining force [N] that is judged: less may be the sensor's zero

DAMPED, STIFF = 500.0, 2e5
"""Largest damping [N s/m] and unloading stiffness [N/m] of any material: twice the largest assumed in loading."""

SLACK = 5e-6  # Distance that the probe may have gone out beyond what an encoder shows [m]
LOSS_CONFIRMED = 3  # Number of samples in a row that must show a loss: one alone may be a spike

EFFORT_TIME, EFFORT_WAIT = 0.004, 0.03
"""Time constant of the low-passes, and time for which they must differ [s]: longer than any impact."""

EFFORT_LEAST, EFFORT_SHARE = 2.0, 0.2
"""Least difference [N], and its least ratio to the larger of the two: friction of the drive is in it."""


class Loss(Record):
    """State of the watch for a lost contact. Its rings hold the newest samples."""

    least: float = LEAST  # missing force that counts [N]; more where friction of the robot shows as a force
    count: int  # of samples in the rings
    at: int  # next index to write
    low: int  # samples in a row with a force that is too low
    uncertain: bool  # whether a force has fallen and it is not certain yet if that is a fault
    effort: float  # of the drive, low-passed [N]
    felt: float  # force, low-passed [N]
    differs: float  # time for which these two differ [s]
    times: Annotated[Array, float, PLACES]  # [s]
    positions: Annotated[Array, float, PLACES]  # [m]
    forces: Annotated[Array, float, PLACES]  # [N]


@compiled
def begin_loss(loss: Loss) -> None:
    """Forget all samples."""
    loss.count = loss.at = loss.low = 0
    loss.effort = loss.felt = loss.differs = 0.0


@compiled
def _speed(loss: Loss, at: int) -> float:
    """Mean speed over the samples up to an index in the rings [m/s]."""
    before = (at + PLACES - WINDOW) % PLACES
    return float((loss.positions[at] - loss.positions[before]) / max(loss.times[at] - loss.times[before], 1e-4))


@compiled
def _place(loss: Loss, at: int) -> float:
    """Mean position of the samples up to an index in the rings [m]."""
    total = 0.0
    for back in range(WINDOW):
        total += loss.positions[(at + PLACES - back) % PLACES]
    return total / WINDOW


@compiled
def _is_low(loss: Loss, newest: int, zero: float) -> bool:
    """Whether the newest force is below what must remain of that of a moment ago."""
    then = newest
    for _ in range(PLACES - WINDOW - 2):
        then = (then + PLACES - 1) % PLACES
        if loss.times[newest] - loss.times[then] >= SPAN:
            break
    before = (then + PLACES - 1) % PLACES  # the lower of two: a spike is one
    force = min(loss.forces[then], loss.forces[before])
    slowed = max(_speed(loss, then) - _speed(loss, newest), 0.0)
    outwards = max(_place(loss, then) - _place(loss, newest) + SLACK, 0.0)
    left = force - zero - DAMPED * slowed - STIFF * outwards
    return bool(left > TOUCHING and loss.forces[newest] - zero < KEPT * left - loss.least)


@compiled
def _disagrees(loss: Loss, force: float, effort: float, period: float) -> bool:
    """Whether the effort of the drive has differed from the measured force for long."""
    if not math.isfinite(effort):
        return False
    gain = 1.0 - math.exp(-period / EFFORT_TIME)
    loss.effort += gain * (effort - loss.effort)
    loss.felt += gain * (force - loss.felt)
    largest = max(abs(loss.effort), abs(loss.felt))
    apart = abs(loss.effort - loss.felt) > max(EFFORT_LEAST, EFFORT_SHARE * largest)
    loss.differs = loss.differs + period if apart else 0.0
    return bool(loss.differs >= EFFORT_WAIT)


@compiled
def find_loss(loss: Loss, time: float, position: float, force: float, zero: float, effort: float, slid: float) -> int:
    """Take one finite sample, as of `SensorWatch.update`: `GOOD`, `CONTACT_LOST` or `FORCE_DISAGREES`.

    The force is that of the sensor less the tool's [N], and a zero that is not known is 0. A probe that has slid may
    have left the surface.
    """
    newest, last = loss.at, (loss.at + PLACES - 1) % PLACES
    period = time - loss.times[last]
    if loss.count > 0 and period > LONGEST_PERIOD:
        begin_loss(loss)
        newest = 0
    if slid > 0.0:
        for index in range(PLACES):
            loss.positions[index] += slid
    loss.times[newest], loss.positions[newest], loss.forces[newest] = time, position, force
    loss.at = (newest + 1) % PLACES
    loss.count = min(loss.count + 1, PLACES)
    if loss.count < PLACES:
        return GOOD
    loss.low = loss.low + 1 if _is_low(loss, newest, zero) else 0
    if loss.low >= LOSS_CONFIRMED:
        return CONTACT_LOST
    return FORCE_DISAGREES if _disagrees(loss, force - zero, effort, period) else GOOD


LEAST_STEP = 0.3  # Smaller steps of the offset than this [N] are not looked for
NOISE_FACTOR = 15.0  # Least step, as a multiple of the standard deviation of the force before it
LEVEL_SHARE = 0.3  # Largest deviation after a step, as a fraction of its size: 4.5 standard deviations of the smallest
LONGEST_RISE = 3e-3  # Longest time between the two samples of a step [s]: in more time a stiff contact rises as much
LEVEL_TIME = 0.01  # Time constant of level and variance [s]
QUIET_BEFORE = 0.03  # Time before a step without another step [s]
CONFIRMING = 5  # Number of level samples that confirm a step
HOLD = 0.05  # Time after which a level has stayed [s]
STILL = 5e-5  # A probe that stays within this [m] is still
FREE_WAY = 1e-3  # Distance outwards [m] over which a level force is that of free air: a material would give way
TURN = 1e-4  # A probe that goes deeper by this distance [m] no longer goes outwards

FREE_FACTOR = 2.0
"""Multiple of the least step from which free air shows a wrong zero: friction of the mechanism is in it."""

FREE_SHARE = 0.5
"""A motion outwards was certainly free where its level is above the zero by at most this fraction of the least step."""

LARGEST_PULL = 2.0  # Largest step below the zero that may be something that sticks [N]
CATCH_WAY = 5e-3  # Way after which a force below the zero that is as level as before is none that sticks [m]

DRIFT_TIME = 60.0  # Time constant in which the zero follows what free air shows [s of free motion]


class FreeMotion(Record):
    """A motion that may be free of contact."""

    begin: float = -math.inf  # where it began [m]; the first sample lies further in
    outermost: float = -math.inf  # its outermost position [m]
    low: float  # lowest force [N]
    high: float  # highest force [N]
    age: float  # [s]
    goes_on: bool  # whether it continues one that was free up to its beginning


class Step(Record):
    """State of the watch for a step of the offset."""

    least: float = LEAST_STEP  # [N]; more where friction of the robot shows as a force
    zero: float = math.nan  # [N], NaN before it is known
    edge: float = -math.inf  # innermost position of the newest free motion [m]
    quiet: float  # time without a step [s]
    level: float  # of the force up to two samples ago [N]
    variance: float  # of that force [N^2]
    age: float = math.inf  # of the step that is being judged [s], infinite for none
    before: float  # level before it [N]
    rise: float  # [N]
    place: float  # position at which it came [m]
    catches: bool  # whether it may be something that begins to stick
    confirmed: int  # samples that have confirmed it
    level_after: float  # of these samples [N]
    low: float  # innermost position since [m]
    high: float  # outermost position since [m]
    free: FreeMotion


@compiled
def _sets_out(step: Step, position: float, force: float, goes_on: bool) -> None:
    """Begin to look for free motion here, perhaps as the rest of a motion that was free up to here."""
    step.free.begin = step.free.outermost = position
    step.free.low = step.free.high = force
    step.free.age = 0.0
    step.free.goes_on = goes_on


@compiled
def restart_steps(step: Step) -> None:
    """Forget the samples so far, but not the zero."""
    step.quiet = step.level = step.variance = 0.0
    step.age = math.inf
    _sets_out(step, -math.inf, 0.0, False)  # the first sample lies further in


@compiled
def _has_stepped(step: Step, second: float, force: float) -> bool:
    """Whether the force has stepped since the sample before the previous one, whose force is `second`."""
    spread = math.sqrt(step.variance)
    if step.quiet < QUIET_BEFORE or abs(force - second) < max(step.least, NOISE_FACTOR * spread):
        return False
    return bool(abs(second - step.level) <= 4.0 * spread + 0.1 * step.least)


@compiled
def _learn(step: Step, force: float, period: float) -> None:
    """Update level and variance by the force of two samples ago."""
    if step.quiet == 0.0:
        step.level, step.variance = force, 0.0
    step.quiet += period
    weight = 1.0 - math.exp(-period / min(LEVEL_TIME, step.quiet))
    away = force - step.level
    step.level += weight * away
    step.variance += weight * ((1.0 - weight) * away * away - step.variance)


@compiled
def _judge(step: Step, second: tuple[float, float], force: float) -> None:
    """Begin to judge a force that has stepped since the sample before the previous one, `second`."""
    step.before, step.rise = step.level, force - second[1]
    step.age, step.confirmed, step.level_after = 0.0, 0, force
    _sets_out(step, -math.inf, 0.0, False)
    step.low = step.high = step.place = second[0]
    step.catches = -LARGEST_PULL <= step.rise < 0.0 and not step.before > step.zero + step.least
    step.quiet = 0.0


@compiled
def _has_stayed(step: Step, position: float, force: float, period: float) -> bool:
    """Whether a step has stayed without a reason."""
    step.age += period
    step.low, step.high = min(step.low, position), max(step.high, position)
    size = abs(step.level_after - step.before)
    if step.confirmed > 0 and abs(force - step.level_after) > LEVEL_SHARE * size:
        step.age = math.inf
        return False
    if step.confirmed < CONFIRMING:
        step.confirmed += 1
        step.level_after += (force - step.level_after) / step.confirmed
        return False
    if size < step.least or abs(step.rise) < 0.8 * size:
        step.age = math.inf
    if not HOLD <= step.age < math.inf:
        return False
    is_still, is_below = step.high - step.low <= STILL, step.level_after < step.zero - step.least
    comes_nearer = step.high - step.place > STILL and max(step.high - step.place, step.place - step.low) < CATCH_WAY
    if is_below and not is_still and step.catches and comes_nearer:
        return False
    step.age = math.inf
    lets_go = step.before < step.zero - step.least and abs(step.level_after - step.zero) < step.least
    return is_below or (is_still and not lets_go)


@compiled
def _is_free(step: Step, position: float, force: float, period: float, told: float) -> bool:
    """Whether free air shows that the zero is wrong; `told` is what is known of it otherwise [N], or NaN."""
    low, high = min(step.free.low, force), max(step.free.high, force)
    if position > step.free.outermost + TURN or high - low > step.least:
        _sets_out(step, position, force, False)
        return False
    step.free.low, step.free.high = low, high
    step.free.outermost = min(step.free.outermost, position)
    step.free.age += period
    begin, age = step.free.begin, step.free.age
    if begin - position < FREE_WAY or age < HOLD:
        return False
    level = 0.5 * (low + high)
    # Something holds the probe, or this is not certainly free air; where that was known here, the zero may be wrong.
    if level < told - step.least or level > step.zero + FREE_SHARE * step.least:
        _sets_out(step, position, force, False)
        return bool(level >= step.zero + FREE_FACTOR * step.least and begin <= step.edge)
    if not level >= step.zero - step.least:  # the first, or the earlier level was not free air
        step.zero, step.edge = level, begin
    elif not step.free.goes_on:
        step.edge = begin
    step.zero = min(level, step.zero + (level - step.zero) * min(age / DRIFT_TIME, 1.0))
    _sets_out(step, position, force, True)
    return False


@compiled
def find_step(
    step: Step, second: tuple[float, float], position: float, force: float, period: float, told: float
) -> bool:
    """Take one finite sample, with the time since the previous one; whether a step of the offset is detected now.

    Position [m] and force [N] of the sample before the previous one are `second`, NaN for none. What is known of the
    zero otherwise is `told` [N], NaN for nothing.
    """
    if step.age < math.inf:  # no zero is learnt from a step that is being judged
        result = _has_stayed(step, position, force, period)
    else:
        result = _is_free(step, position, force, period, told)
    if not math.isnan(second[0]):
        if 2.0 * period <= LONGEST_RISE and _has_stepped(step, second[1], force):
            _judge(step, second, force)
        else:
            _learn(step, second[1], period)
    return result

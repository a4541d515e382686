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
- **pulling**: the force steps like that and stays for 50 ms 0.3 N below the zero; a contact never pulls;
- **free motion**: the probe goes outwards by 1 mm for at least 50 ms, the force stays level (within 0.3 N) and is 0.6 N
  above the zero, where the last motion outwards was free.

The zero is the force in free air, not known at first. It is the lowest level of such a motion; levels up to 0.15 N
above it raise it slowly, in 60 s. A soft foam can be as level as free air, but not where there was free air.

Two samples that span more than 3 ms, and smaller steps, are not judged.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

AGREES, LOST, DISAGREES = 0, 1, 2
"""Result of the loss watch: no fault, a contact that is lost, or a force that contradicts the drive's effort."""

SPAN, PLACES = 8e-3, 16
"""Age [s] of the force that the newest is compared with, and the largest number of samples in that time."""

LONGEST_PERIOD = 4e-3
"""Samples that are further apart than this [s] show nothing sudden."""

WINDOW = 4
"""Number of samples for a mean speed or position: the force follows later than these means show the motion."""

KEPT = 0.4
"""Fraction of a force that remains for a moment in every material while the probe stays."""

LEAST = 0.2
"""Least missing force [N] that counts, above noise and zero error of the sensor."""

TOUCHING = 1.0
"""Least expected remaining force [N] that is judged: less may be the sensor's zero."""

DAMPED, STIFF = 500.0, 2e5
"""Largest damping [N s/m] and unloading stiffness [N/m] of any material: twice the largest assumed in loading."""

SLACK = 5e-6
"""Distance that the probe may have gone out beyond what an encoder shows [m]."""

LOSS_CONFIRMED = 3
"""Number of samples in a row that must show a loss: one alone may be a spike."""

EFFORT_TIME, EFFORT_WAIT = 0.004, 0.03
"""Time constant of the low-passes, and time for which they must differ [s]: longer than any impact."""

EFFORT_LEAST, EFFORT_SHARE = 2.0, 0.2
"""Least difference [N], and its least ratio to the larger of the two: friction of the drive is in it."""

COUNT, AT, LOSS_LOW, EFFORT, FELT, DIFFERS = 0, 1, 2, 3, 4, 5
"""Indices in the array: number of samples in the rings; next index to write; number of samples in a row with a force
that is too low; effort and force, low-passed [N]; and time for which they differ [s]."""

TIMES, POSITIONS, FORCES = 6, 6 + PLACES, 6 + 2 * PLACES
"""Rings of the newest samples [s, m, N]."""

LOSS_SIZE = 6 + 3 * PLACES


@compiled
def begin_loss(loss: Array) -> None:
    """Forget all samples."""
    loss[:] = 0.0


@compiled
def is_falling(loss: Array) -> bool:
    """Whether a contact may be lost, before that is confirmed."""
    return bool(loss[LOSS_LOW] > 0.0)


@compiled
def _speed(loss: Array, at: int) -> float:
    """Mean speed over the samples up to an index in the rings [m/s]."""
    before = (at + PLACES - WINDOW) % PLACES
    return float((loss[POSITIONS + at] - loss[POSITIONS + before]) / max(loss[TIMES + at] - loss[TIMES + before], 1e-4))


@compiled
def _place(loss: Array, at: int) -> float:
    """Mean position of the samples up to an index in the rings [m]."""
    total = 0.0
    for back in range(WINDOW):
        total += loss[POSITIONS + (at + PLACES - back) % PLACES]
    return total / WINDOW


@compiled
def _is_low(loss: Array, newest: int, zero: float) -> bool:
    """Whether the newest force is below what must remain of that of a moment ago."""
    then = newest
    for _ in range(PLACES - WINDOW - 2):
        then = (then + PLACES - 1) % PLACES
        if loss[TIMES + newest] - loss[TIMES + then] >= SPAN:
            break
    before = (then + PLACES - 1) % PLACES  # the lower of two: a spike is one
    force = min(loss[FORCES + then], loss[FORCES + before])
    slowed = max(_speed(loss, then) - _speed(loss, newest), 0.0)
    outwards = max(_place(loss, then) - _place(loss, newest) + SLACK, 0.0)
    left = force - zero - DAMPED * slowed - STIFF * outwards
    return bool(left > TOUCHING and loss[FORCES + newest] - zero < KEPT * left - LEAST)


@compiled
def _disagrees(loss: Array, force: float, effort: float, period: float) -> bool:
    """Whether the effort of the drive has differed from the measured force for long."""
    if not math.isfinite(effort):
        return False
    gain = 1.0 - math.exp(-period / EFFORT_TIME)
    loss[EFFORT] += gain * (effort - loss[EFFORT])
    loss[FELT] += gain * (force - loss[FELT])
    largest = max(abs(loss[EFFORT]), abs(loss[FELT]))
    if abs(loss[EFFORT] - loss[FELT]) > max(EFFORT_LEAST, EFFORT_SHARE * largest):
        loss[DIFFERS] += period
    else:
        loss[DIFFERS] = 0.0
    return bool(loss[DIFFERS] >= EFFORT_WAIT)


@compiled
def find_loss(loss: Array, time: float, position: float, force: float, zero: float, effort: float, slid: float) -> int:
    """Take one finite sample.

    Args:
        loss: State of the watch, written, shape (LOSS_SIZE,).
        time: Time of the sample [s].
        position: Position of the probe [m].
        force: Force of the sensor, less tool weight and inertia [N].
        zero: Force of the sensor in free air, as far as that is known [N].
        effort: Inward force of the drive, less weight and inertia [N]; NaN where it is not measured.
        slid: Distance the probe has moved across the surface since the previous sample [m]: it may have left it.

    Returns:
        `AGREES`, `LOST` or `DISAGREES`.
    """
    newest, last = int(loss[AT]), (int(loss[AT]) + PLACES - 1) % PLACES
    period = time - loss[TIMES + last]
    if loss[COUNT] > 0.0 and period > LONGEST_PERIOD:
        begin_loss(loss)
        newest = 0
    if slid > 0.0:
        for place in range(PLACES):
            loss[POSITIONS + place] += slid
    loss[TIMES + newest], loss[POSITIONS + newest], loss[FORCES + newest] = time, position, force
    loss[AT] = float((newest + 1) % PLACES)
    loss[COUNT] = min(loss[COUNT] + 1.0, float(PLACES))
    if loss[COUNT] < PLACES:
        return AGREES
    loss[LOSS_LOW] = loss[LOSS_LOW] + 1.0 if _is_low(loss, newest, zero) else 0.0
    if loss[LOSS_LOW] >= LOSS_CONFIRMED:
        return LOST
    return DISAGREES if _disagrees(loss, force - zero, effort, period) else AGREES


NOISE_FACTOR = 15.0
"""Least step, as a multiple of the standard deviation of the force before it."""

LEVEL_SHARE = 0.3
"""Largest deviation after a step, as a fraction of its size: 4.5 standard deviations of the smallest."""

LONGEST_RISE = 3e-3
"""Longest time between the two samples of a step [s]: in more time a stiff contact rises as much."""

LEVEL_TIME = 0.01
"""Time constant of level and variance [s]."""

QUIET_BEFORE = 0.03
"""Time before a step without another step [s]."""

CONFIRMING = 5
"""Number of level samples that confirm a step."""

HOLD = 0.05
"""Time after which a level has stayed [s]."""

STILL = 5e-5
"""A probe that stays within this [m] is still."""

FREE_WAY = 1e-3
"""Distance outwards [m] over which a level force is that of free air: a material would give way."""

TURN = 1e-4
"""A probe that goes deeper by this distance [m] no longer goes outwards."""

FREE_FACTOR = 2.0
"""Multiple of the least step from which free air shows a wrong zero: friction of the mechanism is in it."""

FREE_SHARE = 0.5
"""A motion outwards was certainly free where its level is above the zero by at most this fraction of the least step."""

DRIFT_TIME = 60.0
"""Time constant in which the zero follows what free air shows [s of free motion]."""

LEAST_STEP, ZERO, EDGE = 0, 1, 2
"""Indices in the array of lasting values: the least step that is detected [N], the zero [N], NaN before it is known,
and the innermost position of the newest free motion [m]."""

NEWEST, NEWEST_FORCE, SECOND, SECOND_FORCE = 3, 4, 5, 6
"""Indices of positions and forces of the last two samples [m, N]; NaN for none."""

QUIET, LEVEL, VARIANCE = 7, 8, 9
"""Indices of the time without a step [s], and of level and variance of the force up to two samples ago [N, N^2]."""

AGE, BEFORE, RISE, OFFSET_CONFIRMED, LEVEL_AFTER, OFFSET_LOW, HIGH = 10, 11, 12, 13, 14, 15, 16
"""Indices of the step that is being judged: its age [s], infinite for none; the level before it and its rise [N]; the
samples that have confirmed it and their level [N]; the innermost and the outermost position since [m]."""

FREE_FROM, OUTERMOST, FREE_LOW, FREE_HIGH, FREE_AGE, GOES_ON = 17, 18, 19, 20, 21, 22
"""Indices of a motion that may be free: where it began and its outermost position [m], its lowest and highest force
[N], its age [s], and whether it continues one that was free up to there."""

OFFSET_SIZE = 23


@compiled
def _sets_out(step: Array, position: float, force: float, goes_on: bool) -> None:
    """Begin to look for free motion here, perhaps as the rest of a motion that was free up to here."""
    step[FREE_FROM] = step[OUTERMOST] = position
    step[FREE_LOW] = step[FREE_HIGH] = force
    step[FREE_AGE] = 0.0
    step[GOES_ON] = 1.0 if goes_on else 0.0


@compiled
def restart_steps(step: Array) -> None:
    """Forget the samples so far, but not the zero."""
    step[NEWEST : SECOND_FORCE + 1] = math.nan
    step[QUIET] = step[LEVEL] = step[VARIANCE] = 0.0
    step[AGE] = math.inf
    _sets_out(step, -math.inf, 0.0, False)  # the first sample lies further in


@compiled
def begin_steps(step: Array) -> None:
    """Forget everything but the least step."""
    step[ZERO], step[EDGE] = math.nan, -math.inf
    restart_steps(step)


@compiled
def _has_stepped(step: Array, force: float) -> bool:
    """Whether the force has stepped since the sample before the previous one."""
    second, spread = step[SECOND_FORCE], math.sqrt(step[VARIANCE])
    if step[QUIET] < QUIET_BEFORE or abs(force - second) < max(step[LEAST_STEP], NOISE_FACTOR * spread):
        return False
    return bool(abs(second - step[LEVEL]) <= 4.0 * spread + 0.1 * step[LEAST_STEP])


@compiled
def _learn(step: Array, period: float) -> None:
    """Update level and variance of the force up to two samples ago."""
    force = step[SECOND_FORCE]
    if step[QUIET] == 0.0:
        step[LEVEL], step[VARIANCE] = force, 0.0
    step[QUIET] += period
    share = 1.0 - math.exp(-period / min(LEVEL_TIME, step[QUIET]))
    away = force - step[LEVEL]
    step[LEVEL] += share * away
    step[VARIANCE] += share * ((1.0 - share) * away * away - step[VARIANCE])


@compiled
def has_fallen(step: Array) -> bool:
    """Whether the step being judged lowered the force: an operator who presses deeper would not feel how hard."""
    return bool(step[AGE] < math.inf and step[RISE] < 0.0)


@compiled
def _judge(step: Array, force: float) -> None:
    """Begin to judge a force that has stepped since the sample before the previous one."""
    step[BEFORE], step[RISE] = step[LEVEL], force - step[SECOND_FORCE]
    step[AGE], step[OFFSET_CONFIRMED], step[LEVEL_AFTER] = 0.0, 0.0, force
    _sets_out(step, -math.inf, 0.0, False)
    step[OFFSET_LOW] = step[HIGH] = step[SECOND]
    step[QUIET] = 0.0


@compiled
def _has_stayed(step: Array, position: float, force: float, period: float) -> bool:
    """Whether a step has stayed without a reason."""
    step[AGE] += period
    step[OFFSET_LOW], step[HIGH] = min(step[OFFSET_LOW], position), max(step[HIGH], position)
    size = abs(step[LEVEL_AFTER] - step[BEFORE])
    if step[OFFSET_CONFIRMED] > 0.0 and abs(force - step[LEVEL_AFTER]) > LEVEL_SHARE * size:
        step[AGE] = math.inf
        return False
    if step[OFFSET_CONFIRMED] < CONFIRMING:
        step[OFFSET_CONFIRMED] += 1.0
        step[LEVEL_AFTER] += (force - step[LEVEL_AFTER]) / step[OFFSET_CONFIRMED]
        return False
    if size < step[LEAST_STEP] or abs(step[RISE]) < 0.8 * size:
        step[AGE] = math.inf
    if not HOLD <= step[AGE] < math.inf:
        return False
    step[AGE] = math.inf
    return bool(step[HIGH] - step[OFFSET_LOW] <= STILL or step[LEVEL_AFTER] < step[ZERO] - step[LEAST_STEP])


@compiled
def _is_free(step: Array, position: float, force: float, period: float) -> bool:
    """Whether free air shows that the zero is wrong."""
    least = step[LEAST_STEP]
    low, high = min(step[FREE_LOW], force), max(step[FREE_HIGH], force)
    if position > step[OUTERMOST] + TURN or high - low > least:
        _sets_out(step, position, force, False)
        return False
    step[FREE_LOW], step[FREE_HIGH] = low, high
    step[OUTERMOST] = min(step[OUTERMOST], position)
    step[FREE_AGE] += period
    begin, age = step[FREE_FROM], step[FREE_AGE]
    if begin - position < FREE_WAY or age < HOLD:
        return False
    level = 0.5 * (low + high)
    if level >= step[ZERO] + FREE_FACTOR * least:
        _sets_out(step, position, force, False)
        return bool(begin <= step[EDGE])
    if not level >= step[ZERO] - least:  # the first, or the earlier level was not free air
        step[ZERO], step[EDGE] = level, begin
    elif level > step[ZERO] + FREE_SHARE * least:  # neither certainly free air nor a wrong zero
        _sets_out(step, position, force, False)
        return False
    elif step[GOES_ON] == 0.0:
        step[EDGE] = begin
    step[ZERO] = min(level, step[ZERO] + (level - step[ZERO]) * min(age / DRIFT_TIME, 1.0))
    _sets_out(step, position, force, True)
    return False


@compiled
def find_step(step: Array, position: float, force: float, period: float) -> bool:
    """Take one finite sample; return whether a step of the offset is detected now.

    Args:
        step: State of the watch, written, shape (OFFSET_SIZE,).
        position: Position of the probe [m].
        force: Force less tool weight and inertia [N].
        period: Time since the previous sample [s], positive.
    """
    if step[AGE] < math.inf:  # no zero is learnt from a step that is being judged
        found = _has_stayed(step, position, force, period)
    else:
        found = _is_free(step, position, force, period)
    if not math.isnan(step[SECOND]):
        if 2.0 * period <= LONGEST_RISE and _has_stepped(step, force):
            _judge(step, force)
        else:
            _learn(step, period)
    step[SECOND], step[SECOND_FORCE] = step[NEWEST], step[NEWEST_FORCE]
    step[NEWEST], step[NEWEST_FORCE] = position, force
    return found

r"""Watches for a force that does not belong to what the robot does, compiled: a lost contact, an offset that steps.

Two things speak against a force in contact:

- **depth**: within 8 ms it falls below 0.4 of what no material explains, for three samples:

  .. math:: F < 0.4\,\big(F_0 - b\,(v_0 - v) - K\,(x_0 - x + \epsilon)\big) - 0.2\ \mathrm{N}

  with force, place and speed of 8 ms ago, each part only where it is positive: what the probe has slowed down frees no
  more than the damping of b = 500 N s/m, what it has gone out by, on the mean of four samples and 5 um more, no
  more than a stiffness of K = 200 kN/m, and what relaxes at once is less than 0.6;
- **the drive's effort**, where the robot tells it: force and what the drive pushes with differ by more than 2 N and a
  fifth of the larger for 30 ms, both low-passed with 4 ms.

A force that changes without contact is a step of the sensor's offset. It is a fault as soon as one of these holds:

- **still**: the force steps within two samples, by at least 0.3 N and fifteen spreads of the force before
  (fading mean and variance, 10 ms), and for 50 ms both it stays level and the probe within 50 um;
- **pulling**: the force steps like that and stays for 50 ms by 0.3 N below the zero; a contact never pulls;
- **free motion**: the probe goes outwards by 1 mm for at least 50 ms, the force stays level (within 0.3 N) and is
  0.6 N above the zero, where the way out was free the last time.

The zero is the force in free air, not known at first. The lowest level of such a way out is it; those up to 0.15 N
above it draw it up slowly, in 60 s. A soft foam can be as level as free air, but not where there was free air.

Nothing is said from two samples that span more than 3 ms, nor of smaller steps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

AGREES, LOST, DISAGREES = 0, 1, 2
"""What is found: nothing, a contact that is lost, or a force that the drive does not bear out."""

SPAN, PLACES = 8e-3, 16
"""A force is compared with that of so long ago [s], of so many samples at most."""

LONGEST_PERIOD = 4e-3
"""Samples that are further apart [s] say nothing of what is sudden."""

WINDOW = 4
"""A speed is that over so many samples, and a place their mean: the force follows later than this shows it."""

KEPT = 0.4
"""Share of a force that stays for a moment in every material whose probe stays."""

LEAST = 0.2
"""What is missing is at least so much [N]: noise and zero of the sensor."""

TOUCHING = 1.0
"""What no material explains is at least so much [N]: less may be the sensor's zero."""

DAMPED, STIFF = 500.0, 2e5
"""No material is more damped [N s/m] or, on the way out, stiffer [N/m]: twice what is reckoned with on the way in."""

SLACK = 5e-6
"""The probe may have gone out by so much more than an encoder shows [m]."""

LOSS_CONFIRMED = 3
"""Samples in a row that show it: a spike is one."""

EFFORT_TIME, EFFORT_WAIT = 0.004, 0.03
"""Time constant of the low-passes, and for how long they differ [s]: longer than any impact."""

EFFORT_LEAST, EFFORT_SHARE = 2.0, 0.2
"""By how much they differ [N], and as a share of the larger: friction of the drive is in it."""

COUNT, AT, LOSS_LOW, EFFORT, FELT, DIFFERS = 0, 1, 2, 3, 4, 5
"""Places in the array: samples in the rings; where the next goes; samples in a row with a force that is too low; effort
and force, low-passed [N]; and for how long they differ [s]."""

TIMES, POSITIONS, FORCES = 6, 6 + PLACES, 6 + 2 * PLACES
"""Rings of the newest samples [s, m, N]."""

LOSS_SIZE = 6 + 3 * PLACES


@compiled
def begin_loss(loss: Array) -> None:
    """Forget all samples."""
    loss[:] = 0.0


@compiled
def is_falling(loss: Array) -> bool:
    """Whether a contact is perhaps lost: it is not certain yet."""
    return bool(loss[LOSS_LOW] > 0.0)


@compiled
def _speed(loss: Array, at: int) -> float:
    """Mean speed over the samples up to a place in the rings [m/s]."""
    before = (at + PLACES - WINDOW) % PLACES
    return float((loss[POSITIONS + at] - loss[POSITIONS + before]) / max(loss[TIMES + at] - loss[TIMES + before], 1e-4))


@compiled
def _place(loss: Array, at: int) -> float:
    """Mean position of the samples up to a place in the rings [m]."""
    total = 0.0
    for back in range(WINDOW):
        total += loss[POSITIONS + (at + PLACES - back) % PLACES]
    return total / WINDOW


@compiled
def _is_low(loss: Array, newest: int, zero: float) -> bool:
    """Whether the newest force is less than what a moment ago leaves."""
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
    """Whether the drive has pushed for long with something else than what is felt."""
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
        loss: Written, shape (LOSS_SIZE,).
        time: [s].
        position: [m].
        force: Of the sensor, less what tool weight and inertia make of it [N].
        zero: What it shows in free air, as far as that is known [N].
        effort: What the drive pushes inwards with, beyond weight and inertia [N]; NaN where it is not told.
        slid: By how much the probe has moved across the surface since the sample before [m]: it may have left it.

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
"""A step is at least this many standard deviations of the force before it."""

LEVEL_SHARE = 0.3
"""Behind a step the force stays level to this share of its size: 4.5 standard deviations of the smallest."""

LONGEST_RISE = 3e-3
"""The two samples of a step span at most this [s]: in a longer time a stiff contact rises as much."""

LEVEL_TIME = 0.01
"""Time constant of level and spread [s]."""

QUIET_BEFORE = 0.03
"""So long there was nothing unusual before a step [s]."""

CONFIRMING = 5
"""So many samples after a step lie level."""

HOLD = 0.05
"""A level has stayed when it has stayed so long [s]."""

STILL = 5e-5
"""A probe that stays within this [m] is still."""

FREE_WAY = 1e-3
"""A force that stays level over so long a way outwards [m] is that of free air: a material would give way."""

TURN = 1e-4
"""A probe that goes deeper by this [m] no longer goes outwards."""

FREE_FACTOR = 2.0
"""Free air shows a lost zero from so many times the least step: friction of the mechanism is in it."""

FREE_SHARE = 0.5
"""A way out was free for sure where its level is no further above the zero than this share of the least step."""

DRIFT_TIME = 60.0
"""Time constant in which the zero follows what free air shows [s of free motion]."""

LEAST_STEP, ZERO, EDGE = 0, 1, 2
"""Places in the array of what lasts: the least step that is looked for [N], the zero [N], NaN before it is known, and
the innermost place of the newest way that was free [m]."""

NEWEST, NEWEST_FORCE, SECOND, SECOND_FORCE = 3, 4, 5, 6
"""Positions and forces of the last two samples [m, N]; NaN for none."""

QUIET, LEVEL, VARIANCE = 7, 8, 9
"""For how long there was nothing unusual [s]; level and variance of the force up to two samples ago [N, N^2]."""

AGE, BEFORE, RISE, OFFSET_CONFIRMED, LEVEL_AFTER, OFFSET_LOW, HIGH = 10, 11, 12, 13, 14, 15, 16
"""Of the step that is being judged: its age [s], infinite for none; the level before it, and by how much it rose [N];
samples that have confirmed it and their level [N]; the innermost and the outermost position since [m]."""

FREE_FROM, OUTERMOST, FREE_LOW, FREE_HIGH, FREE_AGE, GOES_ON = 17, 18, 19, 20, 21, 22
"""Of a way that may be free: where it began and the outermost place [m], the lowest and the highest force [N], its age
[s], and whether it is the rest of one that was free so far."""

OFFSET_SIZE = 23


def _set_out(step: Array, position: float, force: float, goes_on: bool) -> None:
    """Begin to look for free motion here, perhaps as the rest of a way that was free so far."""
    step[FREE_FROM] = step[OUTERMOST] = position
    step[FREE_LOW] = step[FREE_HIGH] = force
    step[FREE_AGE] = 0.0
    step[GOES_ON] = 1.0 if goes_on else 0.0


_sets_out = compiled(_set_out)


def _restart(step: Array) -> None:
    """Forget the samples so far, but not the zero."""
    step[NEWEST : SECOND_FORCE + 1] = math.nan
    step[QUIET] = step[LEVEL] = step[VARIANCE] = 0.0
    step[AGE] = math.inf
    _sets_out(step, -math.inf, 0.0, False)  # the first sample lies further in


restart_steps = compiled(_restart)


def _begin(step: Array) -> None:
    """Forget everything but the least step."""
    step[ZERO], step[EDGE] = math.nan, -math.inf
    restart_steps(step)


begin_steps = compiled(_begin)


def _is_step(step: Array, force: float) -> bool:
    """Whether the force has stepped since the sample before last."""
    second, spread = step[SECOND_FORCE], math.sqrt(step[VARIANCE])
    if step[QUIET] < QUIET_BEFORE or abs(force - second) < max(step[LEAST_STEP], NOISE_FACTOR * spread):
        return False
    return bool(abs(second - step[LEVEL]) <= 4.0 * spread + 0.1 * step[LEAST_STEP])


_has_stepped = compiled(_is_step)


def _learn(step: Array, period: float) -> None:
    """Level and spread of the force up to two samples ago."""
    force = step[SECOND_FORCE]
    if step[QUIET] == 0.0:
        step[LEVEL], step[VARIANCE] = force, 0.0
    step[QUIET] += period
    share = 1.0 - math.exp(-period / min(LEVEL_TIME, step[QUIET]))
    away = force - step[LEVEL]
    step[LEVEL] += share * away
    step[VARIANCE] += share * ((1.0 - share) * away * away - step[VARIANCE])


_learnt = compiled(_learn)


@compiled
def has_fallen(step: Array) -> bool:
    """Whether a step is being judged that took force away: who goes deeper now would not know how hard."""
    return bool(step[AGE] < math.inf and step[RISE] < 0.0)


def _judge(step: Array, force: float) -> None:
    """Judge from now on a force that has stepped since the sample before last."""
    step[BEFORE], step[RISE] = step[LEVEL], force - step[SECOND_FORCE]
    step[AGE], step[OFFSET_CONFIRMED], step[LEVEL_AFTER] = 0.0, 0.0, force
    _sets_out(step, -math.inf, 0.0, False)
    step[OFFSET_LOW] = step[HIGH] = step[SECOND]
    step[QUIET] = 0.0


_judged = compiled(_judge)


def _stays(step: Array, position: float, force: float, period: float) -> bool:
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


_has_stayed = compiled(_stays)


def _moves_freely(step: Array, position: float, force: float, period: float) -> bool:
    """Whether free air shows that the zero is lost."""
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
    if not level >= step[ZERO] - least:  # the first, or what was taken for free air was none
        step[ZERO], step[EDGE] = level, begin
    elif level > step[ZERO] + FREE_SHARE * least:  # neither free air for sure nor a lost zero
        _sets_out(step, position, force, False)
        return False
    elif step[GOES_ON] == 0.0:
        step[EDGE] = begin
    step[ZERO] = min(level, step[ZERO] + (level - step[ZERO]) * min(age / DRIFT_TIME, 1.0))
    _sets_out(step, position, force, True)
    return False


_is_free = compiled(_moves_freely)


def _find(step: Array, position: float, force: float, period: float) -> bool:
    """Take one finite sample; whether a step of the offset is found now.

    Args:
        step: Written, shape (OFFSET_SIZE,).
        position: [m].
        force: Less what tool weight and inertia make of it [N].
        period: Since the sample before [s], positive.
    """
    if step[AGE] < math.inf:  # no zero is learnt from a step that is being judged
        found = _has_stayed(step, position, force, period)
    else:
        found = _is_free(step, position, force, period)
    if not math.isnan(step[SECOND]):
        if 2.0 * period <= LONGEST_RISE and _has_stepped(step, force):
            _judged(step, force)
        else:
            _learnt(step, period)
    step[SECOND], step[SECOND_FORCE] = step[NEWEST], step[NEWEST_FORCE]
    step[NEWEST], step[NEWEST_FORCE] = position, force
    return found


find_step = compiled(_find)

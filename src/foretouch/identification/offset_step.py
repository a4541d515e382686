r"""Watches for a force that changes without contact, compiled: a step of a force sensor's offset.

It is a fault as soon as one of these holds:

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

__all__ = ["OFFSET_SIZE", "begin_steps", "find_step", "has_fallen", "restart_steps"]

Array = NDArray[np.float64]

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

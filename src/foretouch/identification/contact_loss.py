r"""Watches for a force that does not belong to what the robot does, compiled: a sensor that loses a contact.

Two things speak against a force:

- **depth**: within 8 ms it falls below 0.4 of what no material explains, for three samples:

  .. math:: F < 0.4\,\big(F_0 - b\,(v_0 - v) - K\,(x_0 - x + \epsilon)\big) - 0.2\ \mathrm{N}

  with force, place and speed of 8 ms ago, each part only where it is positive: what the probe has slowed down frees no
  more than the damping of b = 500 N s/m, what it has gone out by, on the mean of four samples and 5 um more, no
  more than a stiffness of K = 200 kN/m, and what relaxes at once is less than 0.6;
- **the drive's effort**, where the robot tells it: force and what the drive pushes with differ by more than 2 N and a
  fifth of the larger for 30 ms, both low-passed with 4 ms.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

__all__ = ["AGREES", "DISAGREES", "EFFORT", "LOSS_SIZE", "LOST", "begin_loss", "find_loss", "is_falling"]

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

"""Finds a step of a force sensor's offset: a change of force that no contact explains."""

from __future__ import annotations

import math

__all__ = ["LEAST_STEP", "OffsetStep"]

LEAST_STEP = 0.3
"""Smaller steps than this [N] are not looked for."""

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


class OffsetStep:
    r"""Watches for a force that changes without contact.

    It is a fault as soon as one of these holds:

    - **still**: the force steps within two samples, by at least 0.3 N and fifteen spreads of the force before
      (fading mean and variance, 10 ms), and for 50 ms both it stays level and the probe within 50 um;
    - **pulling**: the force steps like that and stays for 50 ms by 0.3 N below the zero; a contact never pulls;
    - **free motion**: the probe goes outwards by 1 mm for at least 50 ms, the force stays level (within 0.3 N) and is
      0.6 N above the zero, where the way out was free the last time.

    The lowest level of such a way out is the zero; those up to 0.15 N above it draw it up slowly, in 60 s. A soft foam
    can be as level as free air, but not where there was free air.

    Nothing is said from two samples that span more than 3 ms, nor of smaller steps.

    Args:
        least_step: [N], positive.

    Attributes:
        least_step: [N].
        zero: Force in free air [N], NaN before it is known.
    """

    __slots__ = (
        "_age",
        "_before",
        "_confirmed",
        "_edge",
        "_free_age",
        "_free_from",
        "_free_high",
        "_free_low",
        "_goes_on",
        "_high",
        "_level",
        "_level_after",
        "_low",
        "_newest",
        "_outermost",
        "_quiet",
        "_rise",
        "_second",
        "_variance",
        "least_step",
        "zero",
    )

    least_step: float
    zero: float

    def __init__(self, least_step: float = LEAST_STEP) -> None:
        self.least_step = least_step
        self.zero = math.nan
        self._edge = -math.inf
        self.restart()

    def restart(self) -> None:
        """Forget the samples so far, but not the zero."""
        self._quiet = 0.0
        self._level = self._variance = 0.0
        self._newest: tuple[float, float] | None = None
        self._second: tuple[float, float] | None = None
        self._age = math.inf  # of the step that is being judged; inf for none
        self._set_out(-math.inf, 0.0, goes_on=False)  # the first sample lies further in

    def update(self, position: float, force: float, period: float) -> bool:
        """Take one finite sample; whether a step of the offset is found now.

        Args:
            position: [m].
            force: Less what tool weight and inertia make of it [N].
            period: Since the sample before [s], positive.
        """
        if self._age < math.inf:  # no zero is learnt from a step that is being judged
            found = self._stays(position, force, period)
        else:
            found = self._moves_freely(position, force, period)
        second, newest = self._second, self._newest
        if second is not None and newest is not None:
            if 2.0 * period <= LONGEST_RISE and self._is_step(second[1], force):
                self._begin(second, force)
            else:
                self._learn(second[1], period)
        self._second, self._newest = newest, (position, force)
        return found

    def _is_step(self, second: float, force: float) -> bool:
        spread = math.sqrt(self._variance)
        if self._quiet < QUIET_BEFORE or abs(force - second) < max(self.least_step, NOISE_FACTOR * spread):
            return False
        return abs(second - self._level) <= 4.0 * spread + 0.1 * self.least_step

    def _begin(self, second: tuple[float, float], force: float) -> None:
        """A force that has stepped since the sample before last."""
        self._before, self._rise = self._level, force - second[1]
        self._age, self._confirmed, self._level_after = 0.0, 0, force
        self._set_out(-math.inf, 0.0, goes_on=False)
        self._low = self._high = second[0]
        self._quiet = 0.0

    def _stays(self, position: float, force: float, period: float) -> bool:
        """Whether a step has stayed without a reason."""
        self._age += period
        self._low, self._high = min(self._low, position), max(self._high, position)
        size = self._level_after - self._before
        if self._confirmed and abs(force - self._level_after) > LEVEL_SHARE * abs(size):
            self._age = math.inf
            return False
        if self._confirmed < CONFIRMING:
            self._confirmed += 1
            self._level_after += (force - self._level_after) / self._confirmed
            return False
        if abs(size) < self.least_step or abs(self._rise) < 0.8 * abs(size):
            self._age = math.inf
        if not HOLD <= self._age < math.inf:
            return False
        self._age = math.inf
        return self._high - self._low <= STILL or self._level_after < self.zero - self.least_step

    def _learn(self, force: float, period: float) -> None:
        """Level and spread of the force up to two samples ago."""
        if self._quiet == 0.0:
            self._level, self._variance = force, 0.0
        self._quiet += period
        share = 1.0 - math.exp(-period / min(LEVEL_TIME, self._quiet))
        away = force - self._level
        self._level += share * away
        self._variance += share * ((1.0 - share) * away * away - self._variance)

    def _set_out(self, position: float, force: float, *, goes_on: bool) -> None:
        """Begin to look for free motion here, perhaps as the rest of a way that was free so far."""
        self._free_from = self._outermost = position
        self._free_low = self._free_high = force
        self._free_age = 0.0
        self._goes_on = goes_on

    def _moves_freely(self, position: float, force: float, period: float) -> bool:
        """Whether free air shows that the zero is lost."""
        low, high = min(self._free_low, force), max(self._free_high, force)
        if position > self._outermost + TURN or high - low > self.least_step:
            self._set_out(position, force, goes_on=False)
            return False
        self._free_low, self._free_high = low, high
        self._outermost = min(self._outermost, position)
        self._free_age += period
        begin, age = self._free_from, self._free_age
        if begin - position < FREE_WAY or age < HOLD:
            return False
        level = 0.5 * (low + high)
        if level >= self.zero + FREE_FACTOR * self.least_step:
            self._set_out(position, force, goes_on=False)
            return begin <= self._edge
        if not level >= self.zero - self.least_step:  # the first, or what was taken for free air was none
            self.zero, self._edge = level, begin
        elif level > self.zero + FREE_SHARE * self.least_step:  # neither free air for sure nor a lost zero
            self._set_out(position, force, goes_on=False)
            return False
        elif not self._goes_on:
            self._edge = begin
        self.zero = min(level, self.zero + (level - self.zero) * min(age / DRIFT_TIME, 1.0))
        self._set_out(position, force, goes_on=True)
        return False

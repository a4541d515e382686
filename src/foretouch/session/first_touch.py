"""Guarded contact: what the follower does where it touches what the leader does not know yet."""

from __future__ import annotations

import math

from foretouch.models.checks import require

__all__ = ["FirstTouch"]

UNKNOWN_FROM = 1e-3
"""Contact further out than the surface that the leader knows, by more than this [m], is contact with something else."""

FORESIGHT = 0.01
"""The force counts as it will be in so long [s] at the rate at which it grows: sensor and drive are late."""

RATE_CUTOFF = 40.0
"""Of the low-pass on that rate [Hz]."""

TOO_MUCH = 1.25
"""Above this many times the force that is to be held the robot goes back ..."""
YIELDING = 1e-3
"""... at so much speed for each newton too many [m/(s N)]: slow enough for the stiffest material."""


class FirstTouch:
    r"""Keeps a robot from following blindly into what only it has touched.

    Until the leader is known to render from a model that has this surface, the robot

    - goes deeper no faster than the approach speed, before any contact too;
    - stops where the force would reach the one to be held, :math:`F + t_f \dot F \ge F_h`, and goes back a little where
      it is exceeded, :math:`\dot x = -c (F - F_h)`;
    - follows outwards at once.

    Then the way back to the commands is as slow as the approach. Where nothing is guarded, commands pass as they are.

    Args:
        approach_speed: [m/s], positive.
        force: F_h [N], positive.
        sample_period: [s], positive.

    Attributes:
        guarded: Whether the newest command was held back.
    """

    __slots__ = ("_force", "_gain", "_held", "_holding_force", "_period", "_rate", "_speed", "_told", "guarded")

    def __init__(self, approach_speed: float, force: float, sample_period: float) -> None:
        require("approach_speed", approach_speed, above=0.0)
        require("guarded_force", force, above=0.0)
        require("sample_period", sample_period, above=0.0)
        self._speed = approach_speed
        self._holding_force = force
        self._period = sample_period
        self._gain = 1.0 - math.exp(-2.0 * math.pi * RATE_CUTOFF * sample_period)
        self._force = self._rate = 0.0
        self._told = math.nan
        self._held = 0.0
        self.guarded = False

    def update(self, desired: float, position: float, force: float, in_contact: bool, known_surface: float) -> float:
        """One tick: the position for the robot [m].

        Args:
            desired: What the commands say [m].
            position: Where the robot is [m].
            force: That it feels [N].
            in_contact: Whether that is contact.
            known_surface: Of the newest model that the leader is known to render from [m]; NaN while there is none.
        """
        self._rate += self._gain * ((force - self._force) / self._period - self._rate)
        self._force = force
        unknown = math.isnan(known_surface) or (in_contact and position < known_surface - UNKNOWN_FROM)
        if math.isnan(self._told):
            self._told = position
        if unknown:
            self._told = min(desired, self._told + self._allowed(in_contact) * self._period)
            self._held = desired - self._told
        else:
            back = self._speed * self._period
            self._held -= math.copysign(min(back, abs(self._held)), self._held)
            self._told = desired - self._held
        self.guarded = self._held != 0.0
        return self._told

    def _allowed(self, in_contact: bool) -> float:
        """Speed at which the robot may go deeper now, negative where it goes back [m/s]."""
        if not in_contact:
            return self._speed
        if self._force > TOO_MUCH * self._holding_force:
            return -min(YIELDING * (self._force - self._holding_force), self._speed)
        return self._speed if self._force + FORESIGHT * max(self._rate, 0.0) < self._holding_force else 0.0

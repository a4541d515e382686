"""Guarded contact: what the follower does where it touches what the leader does not know yet."""

from __future__ import annotations

import math

from foretouch.errors.checks import require
from foretouch.session.force_guard import ForceGuard

__all__ = ["FirstTouch"]

UNKNOWN_FROM = 1e-3
"""Contact further out than the surface that the leader knows, by more than this [m], is contact with something else."""


class FirstTouch:
    r"""Keeps a robot from following blindly into what only it has touched.

    Until the leader is known to render from a model that has this surface, the robot

    - goes deeper no faster than the approach speed, before any contact too;
    - in contact, goes deeper or back so that the force comes to the one to be held,
      as `foretouch.session.force_guard.ForceGuard` says, no faster than that either;
    - follows outwards at once.

    Then the way back to the commands is as slow as the approach. Where nothing is guarded, commands pass as they are.

    Args:
        approach_speed: [m/s], positive.
        force: F_h [N], positive.
        sample_period: [s], positive.

    Attributes:
        guarded: Whether the newest command was held back.
    """

    __slots__ = ("_guard", "_held", "_holding_force", "_period", "_speed", "_told", "_unknown", "guarded")

    def __init__(self, approach_speed: float, force: float, sample_period: float) -> None:
        require("approach_speed", approach_speed, above=0.0)
        require("guarded_force", force, above=0.0)
        require("sample_period", sample_period, above=0.0)
        self._speed = approach_speed
        self._holding_force = force
        self._period = sample_period
        self._guard = ForceGuard()
        self.restart()

    def restart(self) -> None:
        """Nothing is guarded, or told: it begins where the robot then is."""
        self._told = math.nan
        self._held = 0.0
        self._unknown = False
        self.guarded = False

    def update(self, desired: float, position: float, force: float, in_contact: bool, known_surface: float) -> float:
        """One tick: the position for the robot [m]. While force or position are no numbers it goes no deeper.

        Args:
            desired: What the commands say [m].
            position: Where the robot is [m].
            force: That it feels [N].
            in_contact: Whether that is contact.
            known_surface: Of the newest model that the leader is known to render from [m]; NaN while there is none.
        """
        unknown = math.isnan(known_surface) or (in_contact and position < known_surface - UNKNOWN_FROM)
        if math.isnan(self._told):
            self._told = position if math.isfinite(position) else desired
        if unknown:
            self._told = min(desired, self._told + self._allowed(position, force, in_contact) * self._period)
            self._held = desired - self._told
        else:
            if self._unknown:  # a step of the commands, as where the index has met the surface, is none of the robot's
                self._held = desired - self._told
            back = self._speed * self._period
            self._held -= math.copysign(min(back, abs(self._held)), self._held)
            self._told = desired - self._held
        self._unknown = unknown
        self.guarded = self._held != 0.0
        return self._told

    def _allowed(self, position: float, force: float, in_contact: bool) -> float:
        """Speed at which the robot may go deeper now, negative where it goes back [m/s]."""
        self._guard.observe(position, force, in_contact)
        return min(max(self._guard.speed(self._holding_force), -self._speed), self._speed)

"""How fast a robot may go deeper, or has to go back, so that a force comes to a limit and does not pass it."""

from __future__ import annotations

import math

__all__ = ["PATIENCE", "ForceGuard"]

PATIENCE = 0.01
"""Time constant in which a force is brought to its limit [s]: longer than sensor and drive are late."""

STEEPER = 2.0
"""A material counts as so many times stiffer than its secant and its tangent: it may stiffen."""

SHORTEST_DEPTH = 2e-5
"""The secant is taken over at least so far [m]."""

IMPACT_DEPTH = 1e-4
"""What an impact meets is told by the secant over at least so far [m]: no impact that counts is over before."""

SOFTEST = 50.0
"""The least stiffness that is reckoned with [N/m]."""

STRIDE, KEPT = 1e-4, 0.5
"""The tangent is taken over at least so far [m], and after it this share of what was steeper before is kept."""

STRUCK_FROM, STRUCK_FOR = 1e-2, 5
"""A contact that begins at this speed or more [m/s] tells the damping, by the force in so many ticks."""

AWAY = 1e-3
"""A contact is over once the robot is so far outside of where it began [m]."""


class ForceGuard:
    r"""Watches the contact that the robot is in.

    .. math:: \dot x = \frac{F_{limit} - F}{K \tau + b}

    with tau = 10 ms, b the damping that is reckoned with, and K twice the steepest of this contact's secant, force over
    depth since it began, and its tangent over 0.1 mm; where what follows is less steep, K is halved every 0.1 mm. The
    force then comes to its limit as by a first-order low-pass, and does not pass it, on any material that stiffens by
    no more than that. What speed and mass add at an impact is not seen here: `foretouch.session.safety.impact_speed`.

    Attributes:
        stiffness: K of this contact [N/m], at least 50.
        steepest: The steepest secant of all contacts so far over 0.1 mm or more [N/m], 0 before the first.
        damping: The largest force in the first 5 ms of a contact over the speed at which it began, of all contacts so
            far that began at 10 mm/s or more [N s/m]; NaN before the first of them.
    """

    __slots__ = ("_force", "_onset", "_reference", "_speed", "_ticks", "damping", "steepest", "stiffness")

    def __init__(self) -> None:
        self._onset = math.nan
        self._reference = (math.nan, math.nan)
        self._speed, self._ticks = 0.0, 0
        self.damping = math.nan
        self._force = math.nan
        self.stiffness = SOFTEST
        self.steepest = 0.0

    def observe(self, position: float, force: float, in_contact: bool, speed: float = 0.0) -> None:
        """One sample of the sensors; where one is no number, nothing is known of the force.

        Args:
            position: [m].
            force: [N].
            in_contact: Whether that is contact.
            speed: At which the robot is told to go deeper [m/s].
        """
        known = math.isfinite(position) and math.isfinite(force)
        self._force = force if known else math.nan
        if not known:
            return
        if in_contact:
            if math.isnan(self._onset):
                self._onset = position
                self._reference = (position, force)
                self._speed, self._ticks = speed, 0
            self._ticks += 1
            if self._speed >= STRUCK_FROM and self._ticks <= STRUCK_FOR:
                self.damping = max(force / self._speed, 0.0 if math.isnan(self.damping) else self.damping)
            self._learn_tangent(position, force)
            depth = position - self._onset
            self.stiffness = max(self.stiffness, STEEPER * force / max(depth, SHORTEST_DEPTH))
            self.steepest = max(self.steepest, force / max(depth, IMPACT_DEPTH))
        elif position < self._onset - AWAY:
            self._onset, self.stiffness = math.nan, SOFTEST

    def _learn_tangent(self, position: float, force: float) -> None:
        """The stiffness here, each time that it has gone 0.1 mm deeper."""
        way = position - self._reference[0]
        if way >= STRIDE:
            tangent = (force - self._reference[1]) / way
            self.stiffness = max(KEPT * self.stiffness, STEEPER * tangent, SOFTEST)
        if way >= STRIDE or way < 0.0:
            self._reference = (position, force)

    def speed(self, limit: float, damping: float = 0.0) -> float:
        """Speed at which the robot may go deeper now, negative where it has to go back [m/s]; 0 while nobody knows.

        Args:
            limit: Force to come to [N].
            damping: b, that it may feel where it goes deeper [N s/m].
        """
        if math.isnan(self._force):
            return 0.0
        missing = limit - self._force
        return missing / (self.stiffness * PATIENCE + (damping if missing > 0.0 else 0.0))

"""How fast a robot may go deeper, or has to go back, so that a force comes to a limit and does not pass it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["PATIENCE", "ForceGuard"]

Array = NDArray[np.float64]

PATIENCE = 0.01
"""Time constant in which a force is brought to its limit [s]: longer than sensor and drive are late."""

STEEPER = 2.0
"""A material counts as so many times stiffer than its secant and its tangent: it may stiffen."""

SHORTEST_DEPTH = 2e-5
"""The secant is taken over at least so far [m]."""

SOFTEST = 50.0
"""The least stiffness that is reckoned with [N/m]."""

STRIDE, KEPT = 1e-4, 0.5
"""The tangent is taken over at least so far [m], and after it this share of what was steeper before is kept."""

AWAY = 1e-3
"""A contact is over once the robot is so far outside of where it began [m]."""

STIFFNESS, ONSET = 0, 1
"""Places among its numbers of what it tells [N/m, m]; the others are the kernel's own."""


class ForceGuard:
    r"""Watches the contact that the robot is in.

    .. math:: \dot x = \frac{F_{limit} - F}{K \tau + b}

    with tau = 10 ms, b the damping that is reckoned with, and K twice the steepest of this contact's secant, force over
    depth since it began, and its tangent over 0.1 mm; where what follows is less steep, K is halved every 0.1 mm. The
    force then comes to its limit as by a first-order low-pass, and does not pass it, on any material that stiffens by
    no more than that. What speed and mass add at an impact is not seen here: `foretouch.models.impact_bound`.

    Args:
        contact: Where its numbers are kept, in an array that somebody else holds too, shape
            (`foretouch.session.force_guard_kernel.SIZE`,); None for one of its own.
    """

    __slots__ = ("_allowed", "_contact", "_observe")

    def __init__(self, contact: Array | None = None) -> None:
        # Imported here: it brings a compiler along, and imports the numbers above.
        from foretouch.session import force_guard_kernel as kernel

        self._observe, self._allowed = kernel.observe, kernel.allowed_speed
        self._contact = np.empty(kernel.SIZE) if contact is None else contact
        kernel.forget(self._contact)

    @property
    def stiffness(self) -> float:
        """K of this contact [N/m], at least 50."""
        return float(self._contact[STIFFNESS])

    @property
    def onset(self) -> float:
        """Where this contact began [m]; NaN once the robot was 1 mm further out without one."""
        return float(self._contact[ONSET])

    def observe(self, position: float, force: float, in_contact: bool) -> None:
        """One sample of the sensors; where one is no number, nothing is known of the force.

        Args:
            position: [m].
            force: [N].
            in_contact: Whether that is contact.
        """
        self._observe(self._contact, position, force, in_contact)

    def speed(self, limit: float, damping: float = 0.0) -> float:
        """Speed at which the robot may go deeper now, negative where it has to go back [m/s]; 0 while nobody knows.

        Args:
            limit: Force to come to [N].
            damping: b, that it may feel where it goes deeper [N s/m].
        """
        return self._allowed(self._contact, limit, damping)

"""Smooth moves between two positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["PEAK_SPEED_RATIO", "Quintic", "minimum_jerk", "quintic_move"]

PEAK_SPEED_RATIO = 1.875
"""Peak speed of a minimum-jerk move over its mean speed."""


def minimum_jerk(fraction: float) -> float:
    r"""Share of the way done after a share of the time.

    .. math:: s = 10 \tau^3 - 15 \tau^4 + 6 \tau^5

    Velocity and acceleration are zero at both ends.

    Args:
        fraction: tau [-]; what lies outside 0 to 1 counts as the nearer end.

    References:
        Flash and Hogan (1985), The coordination of arm movements, Journal of Neuroscience 5(7).
    """
    tau = 0.0 if fraction < 0.0 else 1.0 if fraction > 1.0 else fraction
    return tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0))


class Quintic(NamedTuple):
    """Coefficients of c0 + c1 t + ... + c5 t^5 [m], t [s] from the start of the move."""

    c0: float
    c1: float
    c2: float
    c3: float
    c4: float
    c5: float

    def __call__(self, t: float) -> float:
        """Position [m] at t [s]."""
        return self.c0 + t * (self.c1 + t * (self.c2 + t * (self.c3 + t * (self.c4 + t * self.c5))))


def quintic_move(start: Sequence[float], end: Sequence[float], duration: float) -> Quintic:
    """The polynomial of fifth degree that meets position, velocity and acceleration at both ends.

    Args:
        start: Position [m], velocity [m/s] and acceleration [m/s^2] at t = 0.
        end: The same at t = `duration`.
        duration: Length of the move [s], positive.
    """
    x0, v0, a0 = start
    x1, v1, a1 = end
    # What is left to do beyond carrying on with the acceleration of the start, scaled to unit time.
    dx = x1 - x0 - duration * (v0 + 0.5 * a0 * duration)
    dv = (v1 - v0 - a0 * duration) * duration
    da = (a1 - a0) * duration**2
    return Quintic(
        x0,
        v0,
        0.5 * a0,
        (10.0 * dx - 4.0 * dv + 0.5 * da) / duration**3,
        (-15.0 * dx + 7.0 * dv - da) / duration**4,
        (6.0 * dx - 3.0 * dv + 0.5 * da) / duration**5,
    )

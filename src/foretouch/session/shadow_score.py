"""How well a force is predicted while it is felt, in a few sums."""

from __future__ import annotations

import math

from foretouch.identification.conditioning.kernel import CONTACT_FLOOR

__all__ = ["SCORED_AFTER", "ShadowScore"]

SCORED_AFTER = 1.5
"""Scoring begins so long after the first tick [s], as in a session's report."""

LONGEST_TICK = 0.1
"""A tick counts for the time since the one before, at most this [s]: longer, and nobody was looking."""


class ShadowScore:
    r"""Sums of squares over the ticks in contact, and over those in which contact was predicted; memory is flat.

    .. math:: e = 100 \sqrt{\operatorname{mean}_S (\hat F - F)^2} \Big/ \sqrt{\operatorname{mean}_C F^2}

    as in a session's report, with one difference: C is what the follower takes for contact while it happens, for the
    report's threshold is known at the end alone. S is C and the ticks whose prediction is above the contact floor.

    Attributes:
        contact_time: Time in contact that was scored [s].
    """

    __slots__ = ("_before_ns", "_began_ns", "_contact", "_delayed", "_felt", "_predicted", "_scored", "contact_time")

    def __init__(self) -> None:
        self._began_ns: int | None = None
        self._before_ns = 0
        self._contact = self._scored = 0
        self._felt = self._predicted = self._delayed = 0.0
        self.contact_time = 0.0

    def add(self, now_ns: int, force: float, predicted: float, delayed: float, in_contact: bool) -> None:
        """Take one tick.

        Args:
            now_ns: Monotonic clock [ns].
            force: Felt [N].
            predicted: By the newest model that had arrived [N].
            delayed: The newest that had arrived [N]; one that is no number counts as 0.
            in_contact: Whether the robot is.
        """
        if self._began_ns is None:
            self._began_ns = now_ns
        since, self._before_ns = (now_ns - self._before_ns) * 1e-9, now_ns
        if (now_ns - self._began_ns) * 1e-9 < SCORED_AFTER or not math.isfinite(force):
            return
        if in_contact:
            self._contact += 1
            self._felt += force * force
            self.contact_time += min(since, LONGEST_TICK)
        # Not "above": a prediction that is no number is an error without bound.
        if in_contact or not predicted <= CONTACT_FLOOR:
            self._scored += 1
            self._predicted += (predicted - force) ** 2
            self._delayed += ((delayed if math.isfinite(delayed) else 0.0) - force) ** 2

    @property
    def contact_force_rms(self) -> float:
        """[N]; NaN without contact."""
        return math.sqrt(self._felt / self._contact) if self._contact else math.nan

    @property
    def prediction_error_percent(self) -> float:
        """Of the predicted force; NaN without contact."""
        return self._error(self._predicted)

    @property
    def delayed_force_error_percent(self) -> float:
        """Of the delayed force; NaN without contact."""
        return self._error(self._delayed)

    def sentence(self, delay: float) -> str:
        """The figures in a line.

        Args:
            delay: At which the models came [s].
        """
        if not self.contact_time > 0.0:
            return f"nothing was touched after the first {SCORED_AFTER:g} s: there is nothing to compare"
        return (
            f"{self.contact_time:.1f} s in contact at {self.contact_force_rms:.2f} N RMS; the predicted force was "
            f"wrong by {self.prediction_error_percent:.1f} % of that, the force {delay:g} s late by "
            f"{self.delayed_force_error_percent:.1f} %"
        )

    def _error(self, squares: float) -> float:
        felt = self.contact_force_rms
        return 100.0 * math.sqrt(squares / self._scored) / felt if felt > 0.0 else math.nan

"""From raw samples to depth, velocity and force in contact, causally."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from foretouch.identification.sensor_lag import LONGEST_LAG
from foretouch.models import MotionFilter
from foretouch.models.checks import require

__all__ = ["CONTACT_FLOOR", "OFFSET_WINDOW", "Conditioner", "ContactSample"]

OFFSET_WINDOW = 0.05
"""Length [s] of the window whose lowest mean so far is taken for the force in free air."""

CONTACT_FLOOR = 0.05
"""Least force [N] that counts as contact where nothing better is known of the sensor."""

SMALLEST_SPREAD = 0.005
"""Windows with less spread than this [N] are quiet, however quiet the quietest was."""

QUIET_FACTOR = 4.0
"""A window tells the force in free air only if its spread is at most this many times that of the quietest so far:
when the tool is jerked, the sensor may show less than nothing for a moment."""

NOISE_FACTOR = 6.0
"""Contact begins this many standard deviations of the free-air force above it."""

QUIET_SPREAD = 1.5
"""The noise is at most this many times the spread of the quietest window so far: what chatters in free air is not the
sensor's noise."""

PEAK_TIME = 0.005
"""Length of such a block [s]."""

PEAK_SHARE = 0.05
"""Contact begins at least this share of the largest force so far above free air: friction of the mechanism grows
with what presses it, and is no contact."""

RELEASE_SHARE = 0.5
"""Contact ends at this share of the threshold where it began."""

DOUBT_FACTOR = 2.0
"""A surface that was found at a threshold this many times smaller than today's is looked for again."""


class ContactSample(NamedTuple):
    """One conditioned sample.

    Attributes:
        time: [s].
        depth: Below the surface [m]; NaN before the surface is known.
        velocity: [m/s], positive while deepening.
        force: Less the offset [N].
        in_contact: Whether the probe is judged to touch.
    """

    time: float
    depth: float
    velocity: float
    force: float
    in_contact: bool


class Conditioner:
    """Finds force offset, contact and surface as the samples come.

    - **Offset**: the lowest mean force over 50 ms so far, of the windows that are not much noisier than the
      quietest. Where a recording never leaves contact this is a convention; nothing in the data can tell.
    - **Contact** begins when the force rises above a threshold, the largest of the contact floor, six standard
      deviations of the force in the window that gave the offset (at most half as much again as in the quietest window
      so far), and 5 % of the largest force so far; it ends at half of it.
    - **Surface**: the last position, before the first contact, at which the force was below the threshold of ending.
      It moves outwards when contact is felt further out, and is found anew when the threshold has at least doubled
      since, for then the first contact was none.

    - **Lag**: where the force sensor is known to be late, positions wait for it, so that the two belong together.

    Args:
        surface: Position of the surface [m], or None to find it.
        force_offset: Force in free air [N], or None to find it.
        contact_floor: Least force that counts as contact [N], by the noise of the origin; positive.
        sensor_lag: How late forces are against positions [s], not negative.

    Attributes:
        surface: [m]; NaN before it is known.
        surface_error: Standard error of the surface [m]: contact began somewhere between the last position surely
            without and the first surely with it, and begins elsewhere at another press; 0 for one that was given.
        force_offset: [N].
        in_contact: The newest judgement.
    """

    def __init__(
        self,
        *,
        surface: float | None = None,
        force_offset: float | None = None,
        contact_floor: float = CONTACT_FLOOR,
        sensor_lag: float = 0.0,
    ) -> None:
        require("contact_floor", contact_floor, above=0.0)
        require("sensor_lag", sensor_lag, at_least=0.0, at_most=LONGEST_LAG)
        self._lag = sensor_lag
        self._floor = contact_floor
        self._given_surface = surface
        self._given_offset = force_offset
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self.surface = math.nan if self._given_surface is None else self._given_surface
        self.surface_error = math.nan if self._given_surface is None else 0.0
        self._late: deque[tuple[float, float, float]] = deque()
        self._last_onset = math.nan
        self.force_offset = 0.0 if self._given_offset is None else self._given_offset
        self.in_contact = False
        self._motion = MotionFilter()
        self._window: deque[tuple[float, float]] = deque()
        self._reference = math.nan  # subtracted before squaring, so that the running sums stay small
        self._sum = 0.0
        self._square_sum = 0.0
        self._lowest_mean = math.inf
        self._noise = 0.0
        self._quietest = math.inf
        self._peak = 0.0
        self._block = (-math.inf, math.inf, math.inf)
        self._surface_threshold = math.inf
        self._free_position = math.nan

    def lose_surface(self) -> None:
        """Look for the surface again: the material has gone. One that was given stays."""
        if self._given_surface is None:
            self.surface = math.nan
        self._peak = 0.0

    def doubt_surface(self) -> None:
        """Find the surface anew where the next contact begins: the probe goes elsewhere. One that was given stays."""
        self._surface_threshold = 0.0

    def shift(self, change: float) -> None:
        """What is pressed has moved by so much [m], deeper where positive: the surface goes with it, unless given."""
        if self._given_surface is None and math.isfinite(change):
            self.surface += change
            self._free_position += change
            self._last_onset += change

    def update(self, time: float, position: float, force: float, velocity: float | None = None) -> ContactSample:
        """Take one sample; a sample that is not finite is answered with "no contact" and changes nothing."""
        if not (math.isfinite(time) and math.isfinite(position) and math.isfinite(force)):
            return ContactSample(time, math.nan, 0.0, 0.0, False)
        if velocity is None:
            velocity = self._motion.update(time, position)
        if self._lag > 0.0:
            position, velocity = self._delay(time, position, velocity)
        self._learn_offset(time, force)
        force -= self.force_offset
        self._learn_peak(time, force)
        threshold = self._threshold()
        if self.in_contact:
            self.in_contact = force > RELEASE_SHARE * threshold
        else:
            if force <= RELEASE_SHARE * threshold or math.isnan(self._free_position):
                self._free_position = position
            if force > threshold:
                self.in_contact = True
                self._learn_surface(self._free_position, threshold)
                self._learn_surface_error(position)
        if self.in_contact and self._given_surface is None and position < self.surface:
            self.surface = position
        return ContactSample(time, position - self.surface, velocity, force, self.in_contact)

    def _threshold(self) -> float:
        """Where contact begins [N]; comparisons, for calls of min and max cost more than all the rest of it."""
        noise, largest = self._noise, QUIET_SPREAD * self._quietest
        noise = NOISE_FACTOR * (largest if largest < noise else noise)
        found, share = self._floor, PEAK_SHARE * self._peak
        if noise > found:
            found = noise
        return share if share > found else found

    def _delay(self, time: float, position: float, velocity: float) -> tuple[float, float]:
        """Position and velocity of one lag ago, between the samples around it; the first ones until there are such."""
        late = self._late
        late.append((time, position, velocity))
        while len(late) > 2 and late[1][0] <= time - self._lag:
            late.popleft()
        begin, end = late[0], late[min(1, len(late) - 1)]
        span = end[0] - begin[0]
        share = min(max((time - self._lag - begin[0]) / span, 0.0), 1.0) if span > 0.0 else 0.0
        return begin[1] + share * (end[1] - begin[1]), begin[2] + share * (end[2] - begin[2])

    def _learn_surface_error(self, position: float) -> None:
        """Widen the doubt by this onset: as wide as it took, evenly, and as far as it is from the last one."""
        if self._given_surface is not None:
            return
        width = abs(position - self._free_position) / math.sqrt(12.0)
        apart = 0.0 if math.isnan(self._last_onset) else abs(self._free_position - self._last_onset) / math.sqrt(2.0)
        self._last_onset = self._free_position
        newest = math.hypot(width, apart)
        known = not math.isnan(self.surface_error)
        self.surface_error = math.sqrt(0.5 * (self.surface_error**2 + newest**2)) if known else newest

    def _learn_offset(self, time: float, force: float) -> None:
        """Keep mean and spread of the last 50 ms, and those of the quietest 50 ms so far."""
        if math.isnan(self._reference):
            self._reference = force
        shifted = force - self._reference
        window = self._window
        window.append((time, shifted))
        total, squares = self._sum + shifted, self._square_sum + shifted * shifted
        full = False
        while time - window[0][0] >= OFFSET_WINDOW:
            full = True
            _, old = window.popleft()
            total -= old
            squares -= old * old
        self._sum, self._square_sum = total, squares
        count = len(window)
        mean = total / count
        variance = squares / count - mean * mean
        spread = math.sqrt(variance) if variance > 0.0 else 0.0
        if full:
            if spread < self._quietest:
                self._quietest = spread
            if mean >= self._lowest_mean or spread > max(QUIET_FACTOR * self._quietest, SMALLEST_SPREAD):
                return
            self._lowest_mean = mean
        elif math.isfinite(self._lowest_mean):
            return
        self._noise = spread
        if self._given_offset is None:
            self.force_offset = mean + self._reference

    def _learn_peak(self, time: float, force: float) -> None:
        """The largest force that lasted: the lowest in two blocks of time, so that a spike of the sensor is none."""
        begin, lowest, before = self._block
        if time - begin >= PEAK_TIME:
            self._block = (time, force, lowest)
            self._peak = max(self._peak, min(lowest, before) if math.isfinite(before) else 0.0)
        else:
            self._block = (begin, force if force < lowest else lowest, before)

    def _learn_surface(self, position: float, threshold: float) -> None:
        """Take the surface from a contact that begins, if none is known or the known one is in doubt."""
        if self._given_surface is not None:
            return
        if math.isnan(self.surface) or threshold > DOUBT_FACTOR * self._surface_threshold:
            self.surface = position
            self._surface_threshold = threshold
        else:
            self.surface = min(self.surface, position)

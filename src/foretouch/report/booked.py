"""The work of a recorded force on a recorded motion, as an account of energy books it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import brief_text
from foretouch.rendering.energy import FASTEST_HAND, SAMPLE_PERIOD, SMALLEST_COUNT

__all__ = ["NO_DEVICE", "Booked", "BookedDevice", "book", "booked_device"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class BookedDevice(NamedTuple):
    """What an account has to know of the device.

    Attributes:
        resolution: One count of its encoder [m]; less than a micrometre counts as one.
        delay: From reading a position until the force computed from it acts [s].
        watchdog: Time for which it gives a force that nobody renews [s]; 0 for no end.
    """

    resolution: float = 0.0
    delay: float = 0.0
    watchdog: float = 0.0


NO_DEVICE = BookedDevice()
"""In an open loop nobody holds one."""


def booked_device(settings: Mapping[str, str]) -> BookedDevice | None:
    """The device of a session; None where its settings do not say all of it.

    Args:
        settings: Of the log.
    """
    if settings.get("grip") == "none" and settings.get("felt") != "yes":
        return NO_DEVICE
    try:
        return BookedDevice(*(float(settings[f"device_{name}"]) for name in BookedDevice._fields))
    except (KeyError, ValueError):
        return None


class Booked(NamedTuple):
    """What is booked in each tick; columns of shape (n,).

    Attributes:
        work: Of the nominal period [J].
        late: Of what a tick was longer, and of positions that were missing [J].
        reach: The nominal step under a force, and one count [m].
    """

    work: Array
    late: Array
    reach: Array

    def __repr__(self) -> str:
        """In a few lines, however long the session was."""
        return brief_text(type(self).__name__, self._asdict().items())


def book(force: Array, place: Array, period: Array, device: BookedDevice) -> Booked:
    """Sum up tick by tick what a hand did against a force that acts as late as the device says: see `Ledger`.

    Args:
        force: On the hand, held from each tick on [N], shape (n, axes).
        place: Of the hand in each tick [m], the same shape; no number where it was missing.
        period: Since the tick before [s], shape (n,); 0 counts as nominal.
        device: The hand's.
    """
    count = math.sqrt(place.shape[1]) * max(device.resolution, SMALLEST_COUNT)
    delta, nothing = device.delay / SAMPLE_PERIOD, np.zeros_like(force[:1])
    held, before = (np.concatenate((nothing,) * back + (force,))[: len(force)] for back in (1, 2))
    period = np.where(period > 0.0, period, SAMPLE_PERIOD)
    there = np.isfinite(place).all(axis=1)
    row = np.arange(len(force))
    places = np.maximum.accumulate(np.where(there, row, -1))
    last = np.concatenate(([-1], places))[: len(force)]  # the newest position before each row, -1 for none
    ends = device.delay + (device.watchdog or math.inf)  # of a force, after its tick began
    lasts = np.concatenate(([device.delay], np.clip(ends - period, 0.0, device.delay)))[: len(force)]  # of the former
    seen, until = last == row - 1, np.minimum(period, ends)
    former = np.where(seen, 0.0, np.minimum(lasts, period))
    newest = np.maximum(until - np.where(seen, SAMPLE_PERIOD, device.delay), 0.0)
    impulse = np.cumsum(before * former[:, None] + held * newest[:, None], axis=0)
    known = there & (last >= 0)
    here, first = row[known], last[known]
    elapsed = np.where(here == first + 1, period[here], np.cumsum(period)[here] - np.cumsum(period)[first])
    elapsed = np.maximum(elapsed, SAMPLE_PERIOD)
    acted = (lasts[first + 1] / SAMPLE_PERIOD)[:, None] * before[first + 1] + (1.0 - delta) * held[first + 1]
    moved = place[here] - place[first]
    distance = np.linalg.norm(moved, axis=1)
    even, longest = SAMPLE_PERIOD / elapsed, FASTEST_HAND * SAMPLE_PERIOD
    with np.errstate(divide="ignore"):
        part = np.where(even * distance > longest, longest / distance, even)
    nominal, after = -(acted * moved).sum(axis=1), -((impulse[here] - impulse[first]) * moved).sum(axis=1)
    work, late, reach = np.zeros((3, len(force)))
    work[here], late[here] = part * nominal, (even - part) * nominal + after / elapsed
    reach[here] = np.where(acted.any(axis=1), part * distance, 0.0)
    return Booked(work, late, reach + count)

"""The swings of the hand against those that the same hand would make had it felt nothing: whether it oscillates."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS, Device, DeviceSpecification, Hand
from foretouch.errors import ForetouchError
from foretouch.messages import SessionLog
from foretouch.quantities import Rows

Array = NDArray[np.float64]


class _Intention(Device):
    """What a hand wanted, read again."""

    name = "recorded intention"
    closed_loop = False

    def __init__(self, positions: Array) -> None:
        self._positions = iter(positions.tolist())

    def read(self, now_ns: int) -> float:
        return float(next(self._positions))

    def render(self, force: float) -> float:
        return 0.0


def free_hand(log: SessionLog) -> Array | None:
    """Where the hand that the settings name would have been by its intention alone, without any force [m].

    Args:
        log: The session.

    Returns:
        Positions, shape (n,), NaN where the intention is unknown; None where the operator or the device is unknown.
    """
    try:
        grip = GRIPS[log.settings["grip"]]
        mass, damping, friction = (float(log.settings[f"device_{name}"]) for name in ("mass", "damping", "friction"))
        device = DeviceSpecification(mass=mass, damping=damping, friction=friction, resolution=0.0)
    except (KeyError, ValueError, ForetouchError):
        return None
    wanted = log.leader["intended_position"]
    known = np.isfinite(wanted)
    hand = Hand(_Intention(wanted[known]), grip, device)
    places = np.full(wanted.size, np.nan)
    places[known] = [hand.read(now) for now in log.leader["time_ns"][known].tolist()]
    return places


SWING = 5e-4
"""Smallest swing that counts [m]: fifty encoder counts, and less than a hand means by a press."""

DYING = 0.5
"""A swing shorter than this fraction of the one before it in the same direction dies away by itself: a hand that hits
something stiff rebounds once or twice, and longer the stiffer the material is."""

EXTRA, EXTRA_SHARE = 2, 0.1
"""Swings that a hand may make beside those that it makes without force, and as a fraction of those."""

BURST, LARGEST_BURST = 2.0, 4
"""In any time of this length [s] it may make this many more: it lags behind by one or two."""

FIGURES = ("swings", "free_swings", "extra_swings", "largest_burst", "largest_burst_at_s", "oscillates")


def oscillation(leader: Rows, free: Array | None = None) -> dict[str, Any]:
    r"""The swings of the hand against those that it would make without any force.

    A heavy device without damping swings in the hand by itself, and that is no oscillation of hand and force. With n
    `swings` of the hand and m `turning_points` of the same hand without force, both counted over the whole session, in
    the air as well, because contact is what an oscillating hand keeps losing, it oscillates where

    .. math:: n - m > 2 + 0.1\,m

    or where in any 2 s it makes more than 4 swings more than without force: no long session hides a short burst.

    Evidence, from 38 sessions of 20 and 30 s over all materials, grips and operators, round trips of 0.1 to 5 s and bad
    networks: models made n - m at most 1, and 3 in 2 s, but for one session with a burst of 7 that looks like an
    oscillation. The delayed force, rendered into the same hands on foam and bone at round trips of 0.02 to 1 s, made it
    3 to 117 in all sessions that break the certificate of energy, but for one whose hand swings as slowly as it means
    to. The hand without force swings as often as it means to in these sessions, and with 10 kg and hardly any damping
    in the hand up to three times as often.

    Args:
        leader: Rows of `SessionLog.leader`.
        free: Where the hand would have been without force [m], shape (n,), as `free_hand` gives it; None for where it
            meant to be.

    Returns:
        ``swings``, ``free_swings``, ``extra_swings`` (never below 0), ``largest_burst`` and when it begins after
        the first tick, ``largest_burst_at_s`` (None where there is none), and ``oscillates``; all None where the hand,
        or what it means, is not known.
    """
    hand, free = leader["exact_hand_position"], leader["intended_position"] if free is None else free
    known = np.isfinite(hand) & np.isfinite(free)
    if not known.any():
        return dict.fromkeys(FIGURES)
    time = leader["time_ns"][known] * 1e-9
    made, without = time[swings(hand[known])], time[turning_points(free[known])]
    extra = max(made.size - without.size, 0)
    burst, begins = _largest_burst(made, without)
    return {
        "swings": int(made.size),
        "free_swings": int(without.size),
        "extra_swings": int(extra),
        "largest_burst": burst,
        "largest_burst_at_s": None if begins is None else begins - float(leader["time_ns"][0]) * 1e-9,
        "oscillates": bool(extra > EXTRA + EXTRA_SHARE * without.size or burst > LARGEST_BURST),
    }


def swings(position: Array) -> NDArray[np.int64]:
    r"""Samples at which a swing ends that counts: longer than 0.5 mm, and not one that dies away.

    With l_j the way to the j-th of the `turning_points` from the one before, the j-th counts if
    :math:`l_j \ge l_{j-2} / 2`: if it is not much shorter than the swing before it in the same direction.

    Args:
        position: Finite [m], shape (n,).

    Returns:
        Their indices, increasing.
    """
    turns = turning_points(position)
    ways = np.abs(np.diff(position[np.concatenate(([0], turns))])) if turns.size else np.zeros(0)
    lasting = np.ones(turns.size, dtype=np.bool_)
    lasting[2:] = ways[2:] >= DYING * ways[:-2]
    return np.asarray(turns[lasting])


def turning_points(position: Array, swing: float = SWING) -> NDArray[np.int64]:
    """Samples at which a position turns, with a way of more than one swing between any two, and before and after.

    Args:
        position: Finite [m], shape (n,).
        swing: Smallest way that counts [m], positive.

    Returns:
        Their indices, increasing.
    """
    found = []
    direction = low = high = 0  # low and high: samples of the extremes since the last turn
    values = position.tolist()
    for index, here in enumerate(values):
        low = index if here < values[low] else low
        high = index if here > values[high] else high
        if direction >= 0 and here < values[high] - swing:
            found += [high] if direction else []
            direction, low = -1, index
        elif direction <= 0 and here > values[low] + swing:
            found += [low] if direction else []
            direction, high = 1, index
    return np.array(found, dtype=np.int64)


def _largest_burst(made: Array, without: Array) -> tuple[int, float | None]:
    """The largest surplus of the first times over the second in `BURST` seconds from one of the first on, and which."""
    ends = made + BURST
    in_it = np.searchsorted(made, ends) - np.arange(made.size)
    surplus = in_it - (np.searchsorted(without, ends) - np.searchsorted(without, made))
    if not (surplus > 0).any():
        return 0, None
    return int(surplus.max()), float(made[surplus.argmax()])

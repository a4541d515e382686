"""Effects that an operator would notice: jumps of force by new models, time until a prediction is right, oscillations.

A hand oscillates if it swings more than the same hand would, had it felt nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS, Device, DeviceSpecification, Hand
from foretouch.errors import ForetouchError
from foretouch.messages import SessionLog
from foretouch.quantities import Array, Flags, Rows

ACCURATE_WITHIN = 0.10
"""Error of an accurate prediction, as a fraction of the force RMS: people tell forces apart at 7 to 10 %."""

ACCURATE_FOR = 0.5
"""Time in contact over which the error is taken [s]: about one press, so that no crossing of two curves counts."""


class LargestJump(NamedTuple):
    """The largest of the changes of force that new models made at once; None where there is nothing to look at.

    Attributes:
        force: Its size [N], 0 where no model changed the force.
        rate: The largest size divided by the time since the sample before [N/s]; with uneven times it may be another
            jump than that of `force`.
        time: Time of `force` since the first sample [s]; None where no model changed the force.
    """

    force: float | None
    rate: float | None
    time: float | None

    def figures(self, name: str) -> dict[str, float | None]:
        """The same as named figures for JSON: ``name_N``, ``name_N_per_s`` and ``name_at_s``."""
        return {f"{name}_N": self.force, f"{name}_N_per_s": self.rate, f"{name}_at_s": self.time}


def largest_jump(time: Array, jump: Array, period: Array) -> LargestJump:
    r"""The largest jump, whichever its sign.

    .. math:: \max_k |J_k|, \quad \max_k |J_k| / T_k

    All samples count, those before the scoring window too, and so does the first model: where it comes in the middle
    of a press, the force appears from nothing.

    All have the shape (n,): increasing times [s]; J [N], the force less that of the model before, had it been kept, 0
    where no model came, left out where not finite; and T, the time since the sample before [s], with no rate for 0.
    """
    finite = np.isfinite(jump)
    if not finite.any():
        return LargestJump(None, None, None)
    size = np.where(finite, np.abs(jump), 0.0)
    where = int(size.argmax())
    force = float(size[where])
    if not force > 0.0:
        return LargestJump(0.0, 0.0, None)
    known = finite & (period > 0.0)
    rate = float((size[known] / period[known]).max()) if known.any() else None
    return LargestJump(force, rate, float(time[where] - time[0]))


def rendered_jump(sequence: NDArray[np.int64], wanted: Array, rendered: Array, jump: Array) -> Array:
    r"""The part of a model's jump of the wanted force that was rendered in the tick in which it came.

    .. math:: J'_k = (R_k - R_{k-1}) - (F_k - J_k - F_{k-1}), \quad \text{held between } 0 \text{ and } J_k

    In words: what the rendered force R changed by in this tick, less what the wanted force F, the mediated or else the
    predicted one, would have changed by, had the model before been kept. Where no clamp cuts either tick, that is J. A
    jump that the clamps spread over several ticks counts with its first, so the rate that is made of it is the one that
    the hand was given; its size in the end is that of the wanted force. What clamps would have made of the model before
    is not observed: while they cut, up to what it would have changed by in one tick can be counted wrongly, never more
    than J.

    All have the shape (n,) of the numbers of the ticks; J' [N] is NaN where J is not 0 and the tick before is missing.
    """
    part = np.zeros(jump.size)
    came = np.flatnonzero(jump != 0.0)
    follows = (came > 0) & (sequence[came] - sequence[came - 1] == 1)
    part[came[~follows]] = np.nan
    k = came[follows]
    change = (rendered[k] - rendered[k - 1]) - (wanted[k] - jump[k] - wanted[k - 1])
    part[k] = np.clip(change, np.minimum(jump[k], 0.0), np.maximum(jump[k], 0.0))
    return part


def update_jumps(leader: Rows) -> dict[str, float | None]:
    """The largest jumps that new models made in a session, over all ticks of the leader.

    Three forces are looked at: the predicted one, which a new model changes at once (``largest_model_jump``); the
    mediated one, into which the change is let in tick by tick (``largest_update_jump``); and what the limits left of
    that (``largest_rendered_update_jump``). Where nothing mediates, as in old recordings, the first two are the same.
    """
    time, period, sequence = leader["time_ns"] * 1e-9, leader["period_ns"] * 1e-9, leader["sequence"]
    mediated = leader["mediated_force"].any() or not leader["rendered_force"].any()
    wanted, jump = leader["mediated_force"], leader["update_step"]
    if not mediated:
        wanted, jump = leader["predicted_force"], leader["model_jump"]
    behind = rendered_jump(sequence, wanted, leader["rendered_force"], jump)
    return {
        **largest_jump(time, leader["model_jump"], period).figures("largest_model_jump"),
        **largest_jump(time, jump, period).figures("largest_update_jump"),
        **largest_jump(time, behind, period).figures("largest_rendered_update_jump"),
    }


def time_to_accuracy(
    time: Array,
    true_force: Array,
    predicted_force: Array,
    in_contact: Flags,
    *,
    within: float = ACCURATE_WITHIN,
    lasting: float = ACCURATE_FOR,
) -> float | None:
    r"""Time from the first touch until the prediction is accurate for half a second of contact [s].

    The first touch is the first sample in contact. The prediction is accurate from that sample in contact on, say the
    i-th, for which over the N samples in contact that begin with it

    .. math:: \sum_{j=i}^{i+N-1} (\hat F_j - F_j)^2 \;\le\; 0.1^2 \sum_{j=i}^{i+N-1} F_j^2

    where N samples last 0.5 s at the median sample period. Samples out of contact are skipped, so that N samples
    may be several short touches; that it stays accurate afterwards is not asked. The time is that on the clock, free
    air included.

    All columns have the shape (n,): the time [s] increases; F [N] is finite and less its zero; a predicted force [N]
    that is not finite is as wrong as can be. Other limits are given as the largest error, a fraction of the force RMS,
    and the contact over which it is taken [s]. None where neither accuracy nor contact ever lasts for so long.
    """
    if time.size < 2:
        return None
    count = max(1, round(lasting / float(np.median(np.diff(time)))))
    clock, force = time[in_contact], true_force[in_contact]
    if clock.size < count:
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        power = force**2
        wrong = (predicted_force[in_contact] - force) ** 2
    if not np.isfinite(power.sum()):
        return None  # forces without bound: nothing to be within ten percent of
    # One error as large as all force together spoils its window for certain; larger ones would spoil the sums' digits.
    wrong = np.fmin(np.where(np.isnan(wrong), np.inf, wrong), power.sum())
    accurate = _window_sums(wrong, count) <= within**2 * _window_sums(power, count) * (1.0 + 1e-9)
    return float(clock[np.argmax(accurate)] - clock[0]) if accurate.any() else None


def _window_sums(values: Array, count: int) -> Array:
    sums = np.concatenate(([0.0], np.cumsum(values)))
    return np.asarray(sums[count:] - sums[:-count])


class _Intention(Device):
    name = "recorded intention"
    closed_loop = False

    def __init__(self, positions: Array) -> None:
        self._positions = iter(positions.tolist())

    def read(self, now_ns: int) -> float:
        return float(next(self._positions))

    def render(self, force: float) -> float:
        return 0.0


def free_hand(log: SessionLog) -> Array | None:
    """Position that the hand of the settings would have had by its intention alone, without any force [m], shape (n,).

    NaN where the intention is unknown; None where the operator or the device is.
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
    hands = np.full(wanted.size, np.nan)
    hands[known] = [hand.read(now) for now in log.leader["time_ns"][known].tolist()]
    return hands


SWING = 5e-4  # Smallest swing that counts [m]: fifty encoder counts, and less than a hand means by a press

DYING = 0.5
"""A swing shorter than this fraction of the one before it in the same direction dies away by itself: a hand that hits
something stiff rebounds once or twice, and longer the stiffer the material is."""

EXTRA, EXTRA_SHARE = 2, 0.1
"""Swings that a hand may make beside those that it makes without force, and as a fraction of those."""

BURST, LARGEST_BURST = 2.0, 4  # In any time of this length [s] it may make this many more: it lags behind by one or two

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

    The position of the hand without force is as `free_hand` gives it [m], shape (n,); None for where it meant to be.

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

    The position [m], shape (n,), is finite; the indices increase.
    """
    turns = turning_points(position)
    ways = np.abs(np.diff(position[np.concatenate(([0], turns))])) if turns.size else np.zeros(0)
    lasting = np.ones(turns.size, dtype=np.bool_)
    lasting[2:] = ways[2:] >= DYING * ways[:-2]
    return np.asarray(turns[lasting])


def turning_points(position: Array, swing: float = SWING) -> NDArray[np.int64]:
    """Samples at which a finite position [m], shape (n,), turns, increasing.

    Between any two, and before and after, there is a way of more than one swing [m].
    """
    turns = []
    direction = low = high = 0  # low and high: samples of the extremes since the last turn
    values = position.tolist()
    for index, here in enumerate(values):
        low = index if here < values[low] else low
        high = index if here > values[high] else high
        if direction >= 0 and here < values[high] - swing:
            turns += [high] if direction else []
            direction, low = -1, index
        elif direction <= 0 and here > values[low] + swing:
            turns += [low] if direction else []
            direction, high = 1, index
    return np.array(turns, dtype=np.int64)


def _largest_burst(made: Array, without: Array) -> tuple[int, float | None]:
    """The largest surplus of the first times over the second in `BURST` seconds from one of the first on, and which."""
    ends = made + BURST
    in_it = np.searchsorted(made, ends) - np.arange(made.size)
    surplus = in_it - (np.searchsorted(without, ends) - np.searchsorted(without, made))
    if not (surplus > 0).any():
        return 0, None
    return int(surplus.max()), float(made[surplus.argmax()])

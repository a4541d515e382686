"""The hand in the loop: what it was given and spared, where it was and wanted to be, whether it oscillates.

Swings that the force makes are counted beside those of the same hand had it felt nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS, Device, DeviceSpecification, Hand
from foretouch.errors import ForetouchError
from foretouch.messages import SessionLog
from foretouch.quantities import Rows
from foretouch.report.energy import booked_device, energy_figures
from foretouch.report.pairs import Pairs, not_scored, pair
from foretouch.report.statuses import guarded_figures
from foretouch.report.withheld import FIGURES as FIGURES_OF_WITHHELD
from foretouch.report.withheld import withheld_figures

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
        Positions, shape (n,), NaN where nobody knows what the hand wanted; None where nobody knows whose hand it is, or
        what device it holds.
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
"""A swing that is shorter than this share of the one before it in the same direction dies away by itself: whoever hits
something stiff rebounds once or twice, and the stiffer the material the longer."""

EXTRA, EXTRA_SHARE = 2, 0.1
"""Swings that a hand may make beside those that it makes without force, and as a share of those."""

BURST, LARGEST_BURST = 2.0, 4
"""In any time so long [s] it may make so many more: it lags behind by one or two."""


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


NO_GRIP = NO_BASELINE = "none"

AS_IT_COMES = "delayed"
"""The baseline that renders the delayed force itself."""

OPEN_LOOP = "open loop: the force does not move the hand"
OWN_HAND = "closed loop: a hand of its own holds the device {} and feels the force"

FELT = 0.05
"""Rendered force from which on a tick counts as contact at the hand [N]."""

PHANTOM = 0.3
"""Force from which on it is told that a hand felt what the robot did not touch [N] ..."""
PHANTOM_TICKS = 50
"""... for more than so many commands in a row: the edge of a contact is never quite where it was."""


def hand_figures(log: SessionLog, pairs: Pairs | None = None) -> dict[str, Any]:
    """Stability, energy and the hand, as `session_report` puts them among its own.

    A session is stable if

    1. the certificate of energy holds in every tick (`energy_figures`),
    2. every rendered and every contact force is a finite number, and
    3. the hand does not oscillate (`oscillation`), compared with what it would do without any force (`free_hand`);
       where it is not known what the hand means to do, as in an open loop, this is not asked.

    A baseline renders no model: what a device could not carry of one and what the ceiling of energy cut is None there.

    Args:
        log: One stretch of a session (`SessionLog.stretches`).
        pairs: Its rows at equal command; None to pair them here.

    Returns:
        ``stable`` (None where nobody kept an account of energy, as in recordings of old, and for a baseline in an open
        loop, where nobody holds what could be unstable), the figures of the energy, ``guarded_contacts``,
        ``guarded_s``, ``engaged_percent`` and the object ``hand``.
    """
    leader, models = log.leader, renders_models(log.settings)
    grip = setting(log.settings, "grip", NO_GRIP)
    energy = energy_figures(leader, booked_device(log.settings))
    guarded, swings = guarded_figures(log), oscillation(leader, free_hand(log))
    finite, holds = _finite(log), energy.pop("certificate_holds")
    own = {name: energy.pop(name) for name in ("energy_agrees", "largest_energy_cut_N")}
    if not models:
        own["largest_energy_cut_N"] = None
    unasked = holds is None or (grip == NO_GRIP and not models)
    return {
        "stable": None if unasked else bool(holds and finite and not swings["oscillates"]),
        **energy,
        "guarded_contacts": guarded.pop("guarded_contacts"),
        "guarded_s": guarded.pop("guarded_s"),
        "engaged_percent": 100.0 * float(leader["engaged"].mean()) if leader.size else None,
        "hand": {
            "grip": grip,
            "certificate_holds": holds,
            **own,
            "forces_finite": finite,
            "peak_force_hand_N": largest(leader["rendered_force"]),
            "peak_force_robot_N": largest(contact_force(log)),
            "peak_force_guarded_N": largest(contact_force(log)[log.follower["guarded"]]),
            **guarded,
            "largest_index_mm": _in_mm(largest(np.abs(apart(log)))),
            "largest_phantom_N": _largest_phantom(pair(log) if pairs is None else pairs),
            **_device_bound(log),
            **_given_way(leader),
            **_withheld(log),
            "oscillation": swings,
        },
    }


def setting(settings: Mapping[str, str], name: str, otherwise: str) -> str:
    """A setting of a session as text; sessions of old do not have all."""
    return settings.get(name) or otherwise


def renders_models(settings: Mapping[str, str]) -> bool:
    """Whether models were rendered, and not a delayed force as by the baselines."""
    return setting(settings, "baseline", NO_BASELINE) == NO_BASELINE


def number_of(settings: Mapping[str, str], name: str, otherwise: float) -> float:
    """A positive number among the settings of a session; what is none counts as not said."""
    try:
        value = float(settings.get(name, otherwise))
    except ValueError:
        return otherwise
    return value if 0.0 < value < math.inf else otherwise


def loop_sentence(settings: Mapping[str, str]) -> str:
    """Whether the force moves a hand, whose, and which device it holds."""
    grip = setting(settings, "grip", NO_GRIP)
    if settings.get("replay") == "open loop":
        return OPEN_LOOP
    if grip == NO_GRIP:
        return (
            OWN_HAND.format(setting(settings, "operator", "a device")) if settings.get("felt") == "yes" else OPEN_LOOP
        )
    mass, damping, friction, resolution = (
        number_of(settings, f"device_{name}", 0.0) for name in ("mass", "damping", "friction", "resolution")
    )
    return (
        f"closed loop: a hand with a {grip} grip holds a device of {mass:g} kg, {damping:g} N s/m, "
        f"{friction:g} N of friction and {1e6 * resolution:g} um a count"
    )


def apart(log: SessionLog) -> Array:
    r"""How far the proxy has been taken back from the hand, in the follower's lengths [m], shape (n,).

    .. math:: i_k - i_0, \quad i = p\,x - y

    with the position scale p, the hand x and the proxy y; the reference i_0 is where hand and proxy were coupled, anew
    each time that the clutch is let go. It holds what was indexed away at first touch, and what yielded because the
    device could not carry the model. NaN where they are not coupled.
    """
    leader = log.leader
    scale = number_of(log.settings, "position_scale", 1.0)
    between = scale * leader["hand_position"] - leader["position"]
    coupled = leader["engaged"] & np.isfinite(between)
    begins = coupled & ~np.concatenate((np.zeros(min(1, coupled.size), dtype=np.bool_), coupled[:-1]))
    newest = np.maximum.accumulate(np.where(begins, np.arange(coupled.size), 0))
    return np.where(coupled, between - between[newest], np.nan)


def _finite(log: SessionLog) -> bool:
    """Whether all forces are numbers: those for the hand and, where they are known, those at the probe."""
    exact = log.follower["exact_force"]
    wrong = np.isinf(exact) | (np.isnan(exact) & ~np.isnan(exact).all())  # on a robot it is known nowhere
    return bool(np.isfinite(log.leader["rendered_force"]).all() and not wrong.any())


def contact_force(log: SessionLog) -> Array:
    """Force between probe and material in all ticks [N]: the simulator's where it is known, else the sensor's."""
    exact = log.follower["exact_force"]
    return np.asarray(exact if np.isfinite(exact).any() else log.follower["force"])


def _largest_phantom(pairs: Pairs) -> float | None:
    """The largest force that the hand felt for a while where the robot touched nothing, at equal command [N]."""
    leader, follower = pairs.leader, pairs.follower
    felt = leader["rendered_force"]
    wrong = ~follower["in_contact"] & ~not_scored(pairs) & (felt > PHANTOM)
    edges = np.flatnonzero(np.diff(wrong, prepend=False, append=False))
    runs = (felt[start:end] for start, end in zip(edges[::2], edges[1::2], strict=True) if end - start > PHANTOM_TICKS)
    return max((float(run.max()) for run in runs), default=0.0) if felt.size else None


def _device_bound(log: SessionLog) -> dict[str, float | None]:
    """How much of the contact by the model the device could not carry in full, and the least share that it could."""
    leader, force_scale = log.leader, number_of(log.settings, "force_scale", 1.0)
    share = leader["rendered_share"][leader["engaged"] & (force_scale * leader["predicted_force"] > FELT)]
    if not share.size or not renders_models(log.settings):
        return {"device_bound_percent": None, "smallest_rendered_share": None}
    return {
        "device_bound_percent": 100.0 * float(np.mean(share < 1.0)),
        "smallest_rendered_share": float(share.min()),
    }


def _withheld(log: SessionLog) -> dict[str, Any]:
    """How long the hand was not given the model's force; nothing where no hand felt one."""
    felt = setting(log.settings, "grip", NO_GRIP) != NO_GRIP or log.settings.get("felt") == "yes"
    if not felt or not renders_models(log.settings):
        return dict.fromkeys(FIGURES_OF_WITHHELD)
    return withheld_figures(log.leader, number_of(log.settings, "force_scale", 1.0))


def _given_way(leader: Rows) -> dict[str, float | None]:
    """How far the hand was from where it meant to be, RMS: in contact by the force, in the air by its own lag."""
    away = leader["intended_position"] - leader["exact_hand_position"]
    known, felt = np.isfinite(away), leader["rendered_force"] > FELT
    return {
        "given_way_mm": _in_mm(_rms(away[known & felt])),
        "given_way_in_air_mm": _in_mm(_rms(away[known & ~felt])),
    }


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def largest(values: Array) -> float | None:
    """The largest finite value, None where there is none."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def _in_mm(length: float | None) -> float | None:
    return None if length is None else 1e3 * length

"""The energy account of a session, summed up again from the recorded forces and motion as the leader books them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from foretouch.quantities import Array, Flags, Rows, brief_text
from foretouch.rendering.energy import FASTEST_HAND, SAMPLE_PERIOD, SMALLEST_COUNT
from foretouch.rendering.tick import FARTHEST, PHANTOM
from foretouch.report.numbers import finite_or_none, largest


class BookedDevice(NamedTuple):
    """Properties of the device that the energy account depends on."""

    resolution: float = 0.0  # one count of its encoder [m]; less than a micrometre counts as one
    delay: float = 0.0  # from reading a position until the force computed from it acts [s]
    watchdog: float = 0.0  # time for which it holds a force that is not renewed [s]; 0 for no end


NO_DEVICE = BookedDevice()  # The device of an open loop, which no hand holds


def booked_device(settings: Mapping[str, str]) -> BookedDevice | None:
    """The device of a session; None where its settings are incomplete."""
    if settings.get("grip") == "none" and settings.get("felt") != "yes":
        return NO_DEVICE
    try:
        return BookedDevice(*(float(settings[f"device_{name}"]) for name in BookedDevice._fields))
    except (KeyError, ValueError):
        return None


class Booked(NamedTuple):
    """Work booked in each tick; columns of shape (n,)."""

    work: Array
    """Work in the nominal period [J]."""
    late: Array
    """Work in the time by which a tick was longer, and over missing positions [J]."""
    reach: Array
    """Nominal step under a force, plus one count [m]."""


def book(force: Array, position: Array, period: Array, device: BookedDevice) -> Booked:
    """Sum up tick by tick the work of a hand against a force delayed by the device: see `Ledger`.

    The force on the hand [N], shape (n, axes), is held from each tick on; its position [m], of the same shape, is NaN
    where it was missing; a period [s], shape (n,), of 0 counts as nominal.
    """
    count = math.sqrt(position.shape[1]) * max(device.resolution, SMALLEST_COUNT)
    delta, nothing = device.delay / SAMPLE_PERIOD, np.zeros_like(force[:1])
    held, before = (np.concatenate((nothing,) * back + (force,))[: len(force)] for back in (1, 2))
    period = np.where(period > 0.0, period, SAMPLE_PERIOD)
    there = np.isfinite(position).all(axis=1)
    row = np.arange(len(force))
    read = np.maximum.accumulate(np.where(there, row, -1))
    last = np.concatenate(([-1], read))[: len(force)]  # the newest position before each row, -1 for none
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
    moved = position[here] - position[first]
    distance = np.linalg.norm(moved, axis=1)
    even, longest = SAMPLE_PERIOD / elapsed, FASTEST_HAND * SAMPLE_PERIOD
    with np.errstate(divide="ignore"):
        part = np.where(even * distance > longest, longest / distance, even)
    nominal, after = -(acted * moved).sum(axis=1), -((impulse[here] - impulse[first]) * moved).sum(axis=1)
    work, late, reach = np.zeros((3, len(force)))
    work[here], late[here] = part * nominal, (even - part) * nominal + after / elapsed
    reach[here] = np.where(acted.any(axis=1), part * distance, 0.0)
    return Booked(work, late, reach + count)


ROUNDING = 1e-9  # Largest error of sums of floating-point numbers [J]

SAME = 1e-9
"""Products of the same numbers differ by no more than this fraction: forces that fade pass through every size."""


class Account(NamedTuple):
    """The account of energy in every tick of the leader; columns of shape (n,)."""

    energy: Array  # E, the hand's work against the rendered force, with all debts, no surplus of former contacts [J]
    bound: Array  # largest amount by which E may be below zero [J]
    late: Array  # L, the energy lost beside it in late ticks and missing positions, never positive [J]

    def __repr__(self) -> str:
        """In a few lines, however long the session was."""
        return brief_text(type(self).__name__, self._asdict().items())


def has_account(leader: Rows) -> bool:
    """Whether the account was kept: some bound was stated, or no force had time to do work."""
    return bool(leader.size) and bool((leader["energy_bound"] > 0.0).any() or not leader["rendered_force"][:-1].any())


def energy_account(leader: Rows, device: BookedDevice | None = NO_DEVICE) -> Account:
    """The account of a session (`SessionLog.leader`), summed up again from the recorded forces and positions.

    As in `foretouch.rendering.energy.Ledger`. Only where a surplus was forgiven is taken from the leader's columns:
    where nothing was carried over and no more than 0.05 N was rendered. After lost rows, energy goes on from the value
    that the leader recorded there, and its recorded bound is used from then on. Without a known device (None) the whole
    account is the leader's.
    """
    if device is None:
        return Account(*(leader[name].copy() for name in ("energy", "energy_bound", "late_energy")))
    return _summed_again(leader, device)[0]


def _summed_again(leader: Rows, device: BookedDevice) -> tuple[Account, Array]:
    position, pressing = leader["hand_position"][:, None], leader["rendered_force"]
    position = np.where(np.abs(position) <= FARTHEST, position, np.nan)
    lost = lost_rows(leader, np.isfinite(position[:, 0]))

    def account(period: Array) -> Account:
        booked = book(-pressing[:, None], position, period, device)
        return summed_account(leader, booked, np.abs(pressing), pressing, lost, device)

    return recorded_account(leader, leader, account)


def recorded_account(leader: Rows, recorded: Rows, account: Callable[[Array], Account]) -> tuple[Account, Array]:
    """The account as the leader kept it, and the time in which the hand moved in each tick [s], as it took that.

    A simulated hand is sampled at the nominal time of the tick, a human hand when the tick really began:
    see `foretouch.session.steps.leader.step`. Former leaders took the latter for both; their accounts are
    summed up in that way.
    """
    began = 1e-9 * leader["period_ns"]
    since = 1e-9 * np.diff(leader["time_ns"], prepend=leader["time_ns"][:1])
    moved = np.where(np.isfinite(leader["exact_hand_position"]) & (since > 0.0), since, began)
    summed = account(moved)
    if _agree(summed, recorded) or np.array_equal(moved, began):
        return summed, moved
    formerly = account(began)
    return (formerly, began) if _agree(formerly, recorded) else (summed, moved)


def _agree(account: Account, recorded: Rows) -> bool:
    pairs = zip(account, (recorded[name] for name in ("energy", "energy_bound", "late_energy")), strict=True)
    return all(bool((np.abs(one - other) <= ROUNDING).all()) for one, other in pairs)


def summed_account(
    recorded: Rows, booked: Booked, force: Array, pressing: Array, lost: Flags, device: BookedDevice
) -> Account:
    """The account of the booked work, beside ``energy``, ``energy_bound`` and ``late_energy`` as recorded.

    The size of the force [N] is held from each row on; above 0.05 N of its part along the normal, either way and
    without friction, no surplus is forgiven. A row is lost where the one before is missing or unusable.
    """
    largest = np.maximum.accumulate(_before(force))
    farthest = np.maximum.accumulate(booked.reach)
    bound = (1.0 + 2.0 * device.delay / SAMPLE_PERIOD) * largest * farthest
    bound = np.where(np.logical_or.accumulate(lost), recorded["energy_bound"], bound)
    begins = _begins(recorded["energy"], booked.work, _before(np.abs(pressing)) > PHANTOM, lost)
    late = _owed(np.where(lost, 0.0, booked.late), recorded["late_energy"], lost)
    return Account(_summed(recorded["energy"], booked.work, begins, lost), bound, late)


def account_figures(account: Account, recorded: Rows) -> dict[str, Any]:
    """Whether an account kept its bound in every tick, and whether the leader recorded the same.

    Returns:
        ``net_energy_J``: the smallest E, 0 where it was never negative. ``energy_margin_J``: the smallest distance of E
        from its bound. ``energy_bound_J``: the bound in the tick of the smallest E, or the largest where E was never
        negative. ``late_energy_J``: the smallest L, which has no bound and enters no verdict. ``energy_agrees``:
        whether the leader recorded the same, within 1e-9 J. ``certificate_holds``: it did, and no tick had E below its
        bound by 1e-9 J.
    """
    energy, bound, late = account
    agrees = _agree(account, recorded)
    least_late = finite_or_none(min(float(late.min(initial=0.0)), 0.0))
    known = ~((bound == 0.0) & (energy >= 0.0))  # what is given out without any bound is beyond it
    net = largest = margin = 0.0
    if known.any():
        energy, bound = energy[known], bound[known]
        lowest = int(energy.argmin()) if not energy.min() >= 0.0 else int(bound.argmax())
        net, largest = min(float(energy[lowest]), 0.0), float(bound[lowest])
        margin = float((energy + bound).min())  # of a number that is none it is none
    return {
        "net_energy_J": finite_or_none(net),
        "energy_margin_J": finite_or_none(0.0 if -ROUNDING <= margin < 0.0 else margin),
        "energy_bound_J": finite_or_none(largest),
        "late_energy_J": least_late,
        "energy_agrees": agrees,
        "certificate_holds": agrees and bool(margin >= -ROUNDING),
    }


def energy_figures(leader: Rows, device: BookedDevice | None = NO_DEVICE) -> dict[str, Any]:
    """The certificate of a session, over all ticks in contact; every figure is None where no account was kept.

    The leader's rows are those of `SessionLog.leader`; the device in the hand is None where it is unknown.

    Returns:
        The figures of `account_figures`. ``energy_used_percent``: the largest part of its bound that E took.
        ``net_energy_exact_J``: the smallest of `exact_energy`, None on a device. ``largest_energy_cut_N``: how much
        further the rendered force fell in one tick than the mediated force, at most, and never more than it fell: what
        the ceiling of energy cut.
    """
    if not has_account(leader):
        return dict.fromkeys(_FIGURES)
    account = energy_account(leader, device)
    figures = account_figures(account, leader)
    given = largest(-exact_energy(leader, device))
    used = float((-account.energy / np.where(account.bound > 0.0, account.bound, np.inf)).max())
    figures |= {
        "energy_used_percent": finite_or_none(100.0 * max(0.0, used)),
        "net_energy_exact_J": None if given is None else min(-given, 0.0),
        "largest_energy_cut_N": _largest_cut(leader),
    }
    return {name: figures[name] for name in _FIGURES}


_FIGURES = (
    *("certificate_holds", "energy_agrees", "net_energy_J", "energy_bound_J", "energy_margin_J"),
    *("energy_used_percent", "late_energy_J", "net_energy_exact_J", "largest_energy_cut_N"),
)


def exact_energy(leader: Rows, device: BookedDevice | None = NO_DEVICE) -> Array:
    r"""The same account with the positions of the simulated hand, which no encoder has rounded [J].

    With e the rounding, half a count c at most, both differ by

    .. math:: \Big|\sum_k f_k (e_{k+1} - e_k)\Big| \le \frac{c}{2} \Big(f_0 + f_n + \sum_k |f_k - f_{k-1}|\Big)

    so that a force that goes up and down often can take more energy than the encoder shows: friction and damping of the
    device dissipate that, as they do the other energy that sampling generates.

    It has the shape (n,) of `SessionLog.leader`, and is NaN where the hand's own position or its device is not known.
    """
    position, force = leader["exact_hand_position"][:, None], leader["rendered_force"]
    if device is None:
        return np.full(force.size, np.nan)
    period, lost = _summed_again(leader, device)[1], lost_rows(leader, np.isfinite(leader["hand_position"]))
    shown, exact = (book(-force[:, None], x, period, device) for x in (leader["hand_position"][:, None], position))
    begins = _begins(leader["energy"], shown.work, _before(np.abs(force)) > PHANTOM, lost)
    return np.where(np.isfinite(position[:, 0]), _summed(leader["energy"], exact.work, begins, lost), np.nan)


def lost_rows(recorded: Rows, there: Flags) -> Flags:
    """Rows in which only the leader's account is available: after missing rows, or another process, and shortly beyond.

    Each process keeps its account. The force that acted after a gap is known from the second position on.
    """
    lost = np.diff(recorded["sequence"], prepend=0) != 1  # a leader counts from 1
    lost |= np.diff(recorded["epoch"], prepend=recorded["epoch"][:1]) != 0
    for row in np.flatnonzero(lost).tolist():
        known = np.flatnonzero(there[row:])
        lost[row : row + int(known[0]) + 2 if known.size else None] = True
    return np.asarray(lost)


def _before(values: Array) -> Array:
    """Values of the row before, 0 at the first: a force acts until the next row."""
    return np.concatenate((np.zeros(min(1, values.size)), values[:-1]))


def _begins(recorded: Array, work: Array, firm: Flags, lost: Flags) -> Flags:
    """Ticks in which a surplus was forgiven: the work of one tick is all there is, after a surplus, no firm force."""
    with np.errstate(invalid="ignore"):
        fresh = np.abs(recorded - work) <= SAME * np.abs(work)
    return np.asarray(fresh & (_before(recorded) > 0.0) & ~firm & ~lost)


def _summed(recorded: Array, work: Array, begins: Flags, lost: Flags) -> Array:
    """Sum the work up, anew where a surplus was forgiven; after a gap, from the value that the leader recorded."""
    base = np.where(lost, recorded, work)
    total = np.cumsum(np.where(lost, 0.0, work))
    newest = np.maximum.accumulate(np.where(begins | lost, np.arange(total.size), -1))
    anew = np.where(newest >= 0, base[newest] - total[newest], 0.0)
    return np.asarray(anew + total)


def _owed(late: Array, recorded: Array, lost: Flags) -> Array:
    """Sum up what late ticks took: a surplus is forgiven at once, a debt is kept."""
    owed, total = 0.0, np.zeros(late.size)
    for row, (work, kept, gone) in enumerate(zip(late.tolist(), recorded.tolist(), lost.tolist(), strict=True)):
        owed = kept if gone else min(owed + work, 0.0)
        total[row] = owed
    return total


def _largest_cut(leader: Rows) -> float:
    """How much further the rendered force fell in one tick than the mediated force, and below it, at most [N].

    Where the mediated force rose meanwhile, the hand was spared no more than what it felt before.
    """
    rendered, mediated = leader["rendered_force"], leader["mediated_force"]
    fell = -np.diff(rendered)
    cut = fell + np.minimum(np.diff(mediated), 0.0)
    counted = (np.diff(leader["sequence"]) == 1) & (fell > 0.0) & (rendered < mediated)[1:] & np.isfinite(cut)
    return max(float(cut[counted].max()), 0.0) if counted.any() else 0.0

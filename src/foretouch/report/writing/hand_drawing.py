"""The figures of the hand: its energy account, and where it was against where it meant to be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import Rows, new_figure
from foretouch.report.energy import ROUNDING, Account
from foretouch.report.hand import FELT, apart, number_of
from foretouch.report.pairs import Pairs
from foretouch.report.statuses import away
from foretouch.report.writing.drawing import DELAYED, ERROR, PREDICTED, RENDERED, TRUE, finished, legend, shade
from foretouch.report.writing.thinning import NARROW, extremes, thinned

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CLOSE_UP = 4.0
"""Length of the close-up [s]."""

WIDE = 4.0
"""Width of a curve that lies under another one."""


def energy_figure(leader: Rows, account: Account) -> Any:
    """The energy account of all contacts, and the same near its bound, which it may not cross.

    Args:
        leader: Rows of `SessionLog.leader`, at least one.
        account: What `energy_account` made of them.
    """
    figure = new_figure(6.4)
    whole, near = figure.subplots(2, 1, sharex=True)
    time = _time(leader)
    energy, bound = 1e3 * account.energy, 1e3 * account.bound
    shade(whole, time, leader["rendered_force"] > FELT, "0.5", "in contact")
    for axes in (whole, near):
        axes.plot(*thinned(time, energy), color=PREDICTED, linewidth=1.0, label="energy that the hand has put in")
        axes.set_ylabel("energy [mJ]")
    whole.set_title("Energy account: debts are kept, surplus is forgiven after each contact")
    legend(whole, columns=2)
    near.plot(
        *thinned(time, -bound), color=ERROR, linewidth=1.0, label="its bound: a tick, the delay, an encoder count"
    )
    deepest = _largest(bound) or max(_largest(-energy), 1e-6)
    near.set_ylim(-1.4 * deepest, 1.4 * deepest)
    kept = extremes(bound, NARROW)
    near.fill_between(
        time[kept], -bound[kept], -1.4 * deepest, color=ERROR, alpha=0.15, linewidth=0.0, label="not allowed"
    )
    broken = np.where(energy + bound < -1e3 * ROUNDING, energy, np.nan)
    if np.isfinite(broken).any():
        kept = extremes(broken, NARROW)  # with dots, for a single tick makes no line
        near.plot(time[kept], broken[kept], ".-", color=TRUE, linewidth=2.2, markersize=4.4, label="bound broken")
    near.set_title("The same, close to the bound")
    near.locator_params(axis="y", nbins=5)
    near.set_xlabel("time [s]")
    legend(near, columns=5)
    return finished(figure, 2)


def hand_figure(log: SessionLog, pairs: Pairs, burst_at: float | None = None) -> Any:
    """What the hand meant, what it did, and where it was for the follower, with the force that it was given.

    Args:
        log: The session, with at least one row of the leader.
        pairs: Its rows at equal command: they tell which commands the follower held back.
        burst_at: Where the close-up is to begin, because the hand oscillates there [s]; None for the first contact.
    """
    leader = log.leader
    time = _time(leader)
    figure = new_figure(9.5)
    place, near, force = figure.subplots(3, 1)
    hand = leader["exact_hand_position"]
    hand = np.where(np.isfinite(hand), hand, leader["hand_position"])
    proxy = hand - apart(log) / number_of(log.settings, "position_scale", 1.0)
    held = np.isin(leader["sequence"], pairs.leader["sequence"][pairs.follower["guarded"]])
    elsewhere = _heard_away(log)
    curves = (
        ("meant", leader["intended_position"], ERROR, 1.4),
        ("hand", hand, TRUE, WIDE),  # under the proxy, which is mostly where the hand is
        ("proxy: where the robot is told to be", proxy, PREDICTED, 1.2),
    )
    inside = _close_up(time, leader["rendered_force"], burst_at)
    for axes, chosen in ((place, np.ones(time.size, dtype=np.bool_)), (near, inside), (force, inside)):
        shade(axes, time[chosen], held[chosen], DELAYED, "robot held back by the guard")
        shade(axes, time[chosen], ~leader["engaged"][chosen], "0.5", "not coupled")
        shade(axes, time[chosen], elsewhere[chosen], "#CC79A7", "told that the robot does not follow")
        if axes is not force:
            for label, values, colour, width in curves:
                alpha = 0.45 if width == WIDE else 1.0
                curve = thinned(time[chosen], 1e3 * values[chosen])
                axes.plot(*curve, color=colour, linewidth=width, alpha=alpha, label=label)
            axes.set_ylabel("position [mm]")
            axes.set_xlabel("time [s]")
    place.axvspan(time[inside][0], time[inside][-1], color="#56B4E9", alpha=0.15, linewidth=0.0, label="close-up below")
    place.set_title("The hand")
    legend(place, columns=6 if not elsewhere.any() else 4)
    near.set_title("Close-up")
    given = leader["rendered_force"][inside]
    rendered = "rendered: what the hand was given"
    force.plot(*thinned(time[inside], given), color=RENDERED, linewidth=WIDE, alpha=0.45, label=rendered)
    asked = leader["mediated_force"][inside]
    force.plot(*thinned(time[inside], asked), color=PREDICTED, linewidth=1.1, label="asked for, before the limits")
    top = 1.1 * max(_largest(given), _largest(asked), 0.1)
    force.set_ylim(-0.05 * top, top)
    force.set_title("Force in the close-up")
    force.set_ylabel("force [N]")
    force.set_xlabel("time [s]")
    legend(force, columns=4)
    for axes in (near, force):
        axes.set_xlim(time[inside][0], time[inside][-1])
    return finished(figure, 3, above=0.8 if elsewhere.any() else 0.6, gap=1.1)


def _heard_away(log: SessionLog) -> Flags:
    """At which ticks of the leader the newest that it had heard of the robot was that it does not follow."""
    leader, follower = log.leader, log.follower
    if not follower.size:
        return np.zeros(leader.size, dtype=np.bool_)
    newest = np.searchsorted(follower["sequence"], leader["telemetry_sequence"], side="right") - 1
    return np.asarray((newest >= 0) & (away(follower) & (follower["command_sequence"] > 0))[newest])


def _time(leader: Rows) -> Array:
    """Since the leader's first tick [s]."""
    return np.asarray((leader["time_ns"] - leader["time_ns"][0]) * 1e-9)


def _close_up(time: Array, force: Array, burst_at: float | None) -> Flags:
    """From shortly before an oscillation on, or else before the first contact: there models and hand meet."""
    felt = time[force > FELT]
    first = felt[0] if felt.size else time[0]
    begin = max((first if burst_at is None else burst_at) - 0.2 * CLOSE_UP, time[0])
    return np.asarray((time >= begin) & (time <= begin + CLOSE_UP))


def _largest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0

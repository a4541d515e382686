"""The figures of the hand: its energy account, and where it was against where it meant to be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.report.drawing import DELAYED, ERROR, PREDICTED, RENDERED, TRUE, finished, legend, new_figure
from foretouch.report.energy import ROUNDING
from foretouch.report.hand import FELT, apart, number_of
from foretouch.report.pairs import Pairs
from foretouch.report.thinning import thinned

__all__ = ["energy_figure", "hand_figure"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Rows = NDArray[np.void]

CLOSE_UP = 4.0
"""Length of the close-up [s]."""


def energy_figure(leader: Rows) -> Any:
    """The energy account of every contact, and the same near its bound, which it may not cross.

    Args:
        leader: Rows of `SessionLog.leader`, at least one.
    """
    figure = new_figure(6.4)
    whole, near = figure.subplots(2, 1, sharex=True)
    time = _time(leader)
    energy, bound = 1e3 * leader["energy"], 1e3 * leader["energy_bound"]
    _shade(whole, time, leader["rendered_force"] > FELT, "0.5", "in contact")
    for axes in (whole, near):
        axes.plot(*thinned(time, energy), color=PREDICTED, linewidth=1.0, label="energy that the hand has put in")
        axes.set_ylabel("energy [mJ]")
    whole.set_title("Energy account, contact by contact")
    legend(whole, columns=2)
    near.plot(*thinned(time, -bound), color=ERROR, linewidth=1.0, label="its bound: one tick and one encoder count")
    deepest = max(_largest(bound), _largest(-energy), 1e-6)
    near.set_ylim(-1.4 * deepest, 1.4 * deepest)
    near.fill_between(time, -bound, -1.4 * deepest, color=ERROR, alpha=0.15, linewidth=0.0, label="not allowed")
    broken = energy + bound < -1e3 * ROUNDING
    if broken.any():
        near.plot(time, np.where(broken, energy, np.nan), color=TRUE, linewidth=2.2, label="bound broken")
    near.set_title("The same, close to the bound")
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
    curves = (
        ("meant", leader["intended_position"], DELAYED, 1.4),
        ("hand", hand, TRUE, 1.4),
        ("proxy: where the robot is told to be", proxy, PREDICTED, 1.0),
    )
    inside = _close_up(time, leader["rendered_force"], burst_at)
    for axes, chosen in ((place, np.ones(time.size, dtype=np.bool_)), (near, inside), (force, inside)):
        _shade(axes, time[chosen], held[chosen], ERROR, "robot held back by the guard")
        _shade(axes, time[chosen], ~leader["engaged"][chosen], "0.5", "not coupled")
        if axes is not force:
            for label, values, colour, width in curves:
                axes.plot(*thinned(time[chosen], 1e3 * values[chosen]), color=colour, linewidth=width, label=label)
            axes.set_ylabel("position [mm]")
    place.axvspan(time[inside][0], time[inside][-1], color="#56B4E9", alpha=0.15, linewidth=0.0, label="close-up below")
    place.set_title("The hand")
    legend(place, columns=6)
    near.set_title("Close-up")
    given = leader["rendered_force"][inside]
    force.plot(*thinned(time[inside], given), color=RENDERED, linewidth=1.3, label="rendered: what the hand was given")
    asked = leader["mediated_force"][inside]
    force.plot(*thinned(time[inside], asked), color=PREDICTED, linewidth=0.8, label="asked for, before the limits")
    top = 1.35 * max(_largest(given), 0.1)
    force.set_ylim(-0.05 * top, top)
    force.set_title("Force in the close-up")
    force.set_ylabel("force [N]")
    force.set_xlabel("time [s]")
    legend(force, columns=4)
    for axes in (near, force):
        axes.set_xlim(time[inside][0], time[inside][-1])
    return finished(figure, 3)


def _time(leader: Rows) -> Array:
    """Since the leader's first tick [s]."""
    return np.asarray((leader["time_ns"] - leader["time_ns"][0]) * 1e-9)


def _close_up(time: Array, force: Array, burst_at: float | None) -> Flags:
    """From shortly before an oscillation on, or else before the first contact: there models and hand meet."""
    felt = time[force > FELT]
    first = felt[0] if felt.size else time[0]
    begin = max((first if burst_at is None else burst_at) - 0.2 * CLOSE_UP, time[0])
    return np.asarray((time >= begin) & (time <= begin + CLOSE_UP))


def _shade(axes: Any, time: Array, flags: Flags, colour: str, label: str) -> None:
    """Shade the times at which a flag is set, over the whole height."""
    if not flags.any():
        return
    axes.fill_between(
        time,
        0.0,
        1.0,
        where=flags,
        step="post",
        transform=axes.get_xaxis_transform(),
        color=colour,
        alpha=0.15,
        linewidth=0.0,
        label=label,
    )


def _largest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0

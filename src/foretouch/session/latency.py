"""Where the time goes between a motion of the hand and the answer to it, stage by stage."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from foretouch.quantities import Array, Rows

STEP, FINE = 0.002, 0.0001  # Steps of the search for a shift of time, at first and in the end [s]
MOST_POINTS = 1000  # Points of a motion that are compared
TOUCHES = 0.05  # A force above is contact [N]
LEAST_MOTION = 1e-4  # A hand that moves less says nothing of time [m]
SHORTEST = 1.0  # [percent] of the messages count as those that waited nowhere

LONGEST_LAG, LONGEST_LOOP = 0.2, 10.0
"""Longest lag of a robot or sensor, and longest loop, that is looked for [s]."""

STAGES = {
    "device": "hand to the device's count, and force to the hand: as stated for the device",
    "leader": "the leader's tick: from the device's count to the command",
    "link_there": "the shortest way of a command to the follower's tick",
    "playout": "what commands wait beyond that: jitter, and the playout that evens it out",
    "robot": "from the applied command to the motion by the encoders",
    "sensor": "from the contact force to the sensor's: known of simulated robots only",
    "learner": "from a tick until the model that has learnt from it is sent",
    "link_back": "from the follower's tick to the leader that knows of it",
}
"""The stages of the loop, and what each is. Without `device`, `sensor` and `learner` they make the age of the delayed
motion that a leader knows; the force that is rendered waits for none of them."""

IN_THE_LOOP = ("leader", "link_there", "playout", "robot", "link_back")

ONE_CLOCK, HALVES = "one clock", "half of the shortest loop each way: the clocks of both machines differ"


def latency_figures(leader: Rows, follower: Rows, settings: Mapping[str, str]) -> dict[str, Any]:
    r"""Times of a session's stages, and the loop that is measured beside them.

    A command's number comes back with the telemetry of the tick that applied it. So each leader tick n knows a pair

    .. math:: t_F(k) - t_L(s) = a, \qquad t_L(n) - t_F(k) = b

    of a way there and a way back, with the difference of two clocks in both: their sum has none. Where neither is ever
    negative it is one clock; else half of the shortest loop is taken for each way, which is a guess. Where even that is
    negative nothing is known of the ways: over a thin link a side counts on while the other's ticks are late. The
    loop is measured beside that as the shift of time between the leader's motion and the robot's as the leader knows
    it, by `time_shift`: it goes by positions alone, the sum by clocks.

    Args:
        leader: Ticks of one leader's process, as of `foretouch.messages.SessionLog`, without a change of settings.
        follower: Of one follower's process, likewise.
        settings: Of the session, as text.

    Returns:
        - ``stages_ms``: of each of `STAGES` its median, None where it is not known; ``worst_ms``: 99 % are below.
        - ``sum_ms``: leader, links, playout and robot; ``loop_ms``: the same as measured by the motion, None where the
          hand hardly moved; ``clocks``: how the ways there and back were told apart.
    """
    stages: dict[str, Array | None] = dict.fromkeys(STAGES)
    known, clocks, loop = answered(leader, follower), None, None
    if known.now.size:
        there, back, clocks = _ways(known)
        shortest = float(np.percentile(there, SHORTEST))
        if shortest >= 0.0:
            own = np.minimum(known.sent["compute_ns"] * 1e-9, shortest)
            stages |= {"leader": own, "playout": np.maximum(there - shortest, 0.0), "link_back": back}
            stages["link_there"] = np.array([shortest - float(np.median(own))])
        else:
            clocks = None
        longest = min(float(np.percentile(there + back, 100.0 - SHORTEST)) + LONGEST_LAG, LONGEST_LOOP)
        stages["robot"] = _shift(known.told, known.sent["position"], known.told["position"], LONGEST_LAG)
        shift = _shift(known.now, known.now["position"], known.told["position"], longest)
        loop = None if shift is None else float(shift[0])
    stages["device"] = _stated(settings)
    stages["sensor"] = _shift(follower, follower["exact_force"], follower["sensor_force"], LONGEST_LAG)
    stages["learner"] = _until_told(follower)
    medians = {name: _percentile(values, 50.0) for name, values in stages.items()}
    summed = [medians[name] for name in IN_THE_LOOP]
    return {
        "stages_ms": medians,
        "worst_ms": {name: _percentile(values, 99.0) for name, values in stages.items()},
        "sum_ms": None if None in summed else sum(filter(None, summed)),
        "loop_ms": None if loop is None else 1e3 * loop,
        "clocks": clocks,
    }


def _percentile(values: Array | None, percent: float) -> float | None:
    return None if values is None or not values.size else 1e3 * float(np.percentile(values, percent))


def _stated(settings: Mapping[str, str]) -> Array | None:
    with suppress(KeyError, ValueError):
        return np.array([float(settings["device_delay"])])
    return None


def _ways(known: Answered) -> tuple[Array, Array, str]:
    """Times of the ways there and back [s], and how they were told apart."""
    there = (known.told["time_ns"] - known.sent["time_ns"]) * 1e-9
    back = (known.now["time_ns"] - known.told["time_ns"]) * 1e-9
    if min(there.min(), back.min()) >= 0.0:
        return there, back, ONE_CLOCK
    apart = 0.5 * float(np.percentile(there, SHORTEST) - np.percentile(back, SHORTEST))
    return there - apart, back + apart, HALVES


def _until_told(follower: Rows) -> Array | None:
    """Times from each tick in contact until the next model is sent [s]."""
    news = np.flatnonzero(np.diff(follower["model_sequence"]) > 0) + 1
    ticks = np.flatnonzero(follower["force"] > TOUCHES)
    after = np.searchsorted(news, ticks)
    ticks, after = ticks[after < news.size], after[after < news.size]
    if not ticks.size:
        return None
    return np.asarray((follower["time_ns"][news[after]] - follower["time_ns"][ticks]) * 1e-9)


def _shift(rows: Rows, before: Array, later: Array, longest: float) -> Array | None:
    finite = np.isfinite(before) & np.isfinite(later)
    time = (rows["time_ns"][finite] - rows["time_ns"][0]) * 1e-9 if rows.size else np.empty(0)
    shift = time_shift(time, before[finite], later[finite], longest)
    return None if shift is None else np.array([shift])


class Answered(NamedTuple):
    """Ticks of the leader that know an answer to a command of its own, one row each."""

    now: Rows  # the leader's tick that knows it
    told: Rows  # the follower's tick that said it
    sent: Rows  # the leader's tick that sent the command


def answered(leader: Rows, follower: Rows) -> Answered:
    """For each telemetry that reached the leader, the first tick that knew it."""
    _, first = np.unique(leader["telemetry_sequence"], return_index=True)
    now = leader[first]
    told, known = _with(follower, now["telemetry_sequence"])
    now, told = now[known], told[known]
    sent, known = _with(leader, told["command_sequence"])
    return Answered(now[known], told[known], sent[known])


def _with(table: Rows, sequence: Array) -> tuple[Rows, Array]:
    """Rows of a table with these numbers, and for which of them there is one; others have a row of another number."""
    if not table.size:
        return np.resize(table, sequence.size) if sequence.size else table, np.zeros(sequence.size, np.bool_)
    order = np.argsort(table["sequence"], kind="stable")
    at = order[np.minimum(np.searchsorted(table["sequence"][order], sequence), table.size - 1)]
    return table[at], table["sequence"][at] == sequence


def time_shift(time: Array, motion: Array, later: Array, longest: float) -> float | None:
    r"""The time tau [s] by which one motion follows another: it makes ``later(t) - motion(t - tau)`` least in squares.

    A constant between the two does not count.

    Args:
        time: Of both [s], increasing, shape (n,).
        motion: [m], shape (n,).
        later: [m], shape (n,).
        longest: Longest tau that is looked for [s].

    Returns:
        None where there are less than 100 samples for it, or the motion is smaller than 0.1 mm.
    """
    inside = time >= time[0] + longest if time.size else np.zeros(0, np.bool_)
    if inside.sum() < 100 or np.ptp(motion[inside]) < LEAST_MOTION:
        return None
    thin = max(1, int(inside.sum()) // MOST_POINTS)
    when, where = time[inside][::thin], later[inside][::thin]

    def leftover(shift: float) -> float:
        return float(np.var(where - np.interp(when - shift, time, motion)))

    grid = np.arange(0.0, longest, STEP)
    for _ in range(2):
        best = float(grid[np.argmin([leftover(shift) for shift in grid])])
        grid = best + np.arange(-STEP, STEP, FINE)
    return max(best, 0.0)

"""States of the follower other than following, faults of its sensors, guarded touches, and the sides present."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import plural
from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import STATUS_SENTENCES, WITH_THE_COMMANDS, SessionLog, Status
from foretouch.quantities import Array, Rows
from foretouch.report.numbers import Finding, largest, number
from foretouch.report.rows import guarded_runs, joining, runs_of, seconds_of, since_first_command, usual_period
from foretouch.report.sections import Section


def guarded_figures(log: SessionLog) -> dict[str, Any]:
    """Actions of the guard, over all ticks of the follower.

    Returns:
        ``guarded_contact_percent``: fraction of the ticks in contact that were guarded; None without contact.
        ``guarded_contacts``: guarded segments with contact in them. ``guarded_s``: all guarded ticks, those of an
        approach that it slowed down too. ``depth_lost_mm``: the largest distance of the applied command beyond that
        sent to the robot, in guarded ticks in contact. ``time_lost_s``: the longest time from a guarded contact's
        beginning until commands were followed again, or the session was over.
    """
    follower, period = log.follower, usual_period(log.follower)
    commands = np.ascontiguousarray(log.leader["sequence"])  # as a column it is copied at every search
    depth = time = 0.0
    contacts = 0
    for run in guarded_runs(follower):
        rows = follower[run]
        touching = np.flatnonzero(rows["in_contact"])
        if not touching.size:
            continue
        contacts += 1
        rows = rows[touching[0] :]
        time = max(time, float(np.ptp(rows["time_ns"])) * 1e-9 + period)
        depth = max(depth, _depth_lost(log.leader, commands, rows[rows["guarded"] & rows["in_contact"]]))
    touching, held = follower["in_contact"], follower["in_contact"] & follower["guarded"]
    return {
        "guarded_contact_percent": 100.0 * float(held.sum() / touching.sum()) if touching.any() else None,
        "guarded_contacts": contacts,
        "guarded_s": seconds_of(follower, follower["guarded"]),
        "depth_lost_mm": 1e3 * depth,
        "time_lost_s": time,
    }


def _depth_lost(leader: Rows, commands: NDArray[np.int64], rows: Rows) -> float:
    """Largest depth of the applied commands beyond those sent to the robot [m]."""
    if not leader.size:
        return 0.0
    row = np.searchsorted(commands, rows["command_sequence"])
    row = np.minimum(row, leader.size - 1)
    known = commands[row] == rows["command_sequence"]
    lost = leader["position"][row[known]] - rows["desired_position"][known]
    lost = lost[np.isfinite(lost)]
    return max(float(lost.max()), 0.0) if lost.size else 0.0


def contact_force(log: SessionLog) -> Array:
    """Force between probe and material in all ticks [N]: the simulator's where it is known, else the sensor's."""
    exact = log.follower["exact_force"]
    return np.asarray(exact if np.isfinite(exact).any() else log.follower["force"])


REFUSALS = ("stale", "overtaken", "future", "of_others", "before_release")
"""Reasons of refused commands, by the names of their counters."""


def segment_figures(log: SessionLog) -> dict[str, Any]:
    """Number of starts of each side, and the part of the session that the figures are of.

    Returns:
        ``leader_starts``, ``follower_starts``: processes received from. ``changes``: number of changes of settings in
        between. ``count``: number of `SessionLog.phases`.
        ``max_rendered_force_N``, ``max_follower_force_N``: over all of them.
    """
    phases = len(log.phases())
    return {
        "leader_starts": int(np.unique(log.leader["epoch"]).size),
        "follower_starts": int(np.unique(log.follower["run"]).size),
        "changes": phases - len(log.segments()),
        "count": phases,
        "max_rendered_force_N": largest(log.leader["rendered_force"]),
        "max_follower_force_N": largest(contact_force(log)),
    }


def safety_figures(log: SessionLog) -> dict[str, Any]:
    """Events other than following, over all processes of the follower; those that did not happen are left out.

    From the first command on; a robot that joins that within 0.1 s does not count as returned. An emergency stop in
    which one process ended and the next began is one: it had not been released.

    Returns:
        ``statuses`` and ``sensor_faults``: by name the ``times``, the ``seconds`` and the ``sentence``; what is less
        than 0.1 s apart is one time. ``refused_commands``: by reason, where there were any. ``control``: leaders
        that held it, in turn, by the follower's report, ``contests``: others that asked. ``emergency_stops``: reasons.
        ``step_failures``: exceptions in the steps of the follower.
    """
    runs, first = np.unique(log.follower["run"], return_index=True)
    parts = [since_first_command(log.follower[log.follower["run"] == run]) for run in runs[np.argsort(first)]]
    refused = {reason: log.counts.get(f"commands_{reason}", 0) for reason in REFUSALS}
    reasons = [*(stop.reason for stop in log.emergencies), *log.news.get("stopped", ())]
    return {
        "statuses": _summed(parts, "status", WITH_THE_COMMANDS),
        "sensor_faults": _summed(parts, "validity", (SensorState.GOOD,)),
        "refused_commands": {reason: count for reason, count in refused.items() if count},
        "control": list(log.news.get("control", ())),
        "contests": list(log.news.get("contest", ())),
        "emergency_stops": list(dict.fromkeys(reasons)),
        "step_failures": log.counts.get("step_failures", 0),
    }


def _summed(parts: list[Rows], column: str, ordinary: tuple[int, ...]) -> dict[str, Any]:
    """Times and seconds of each value of a column that is not ordinary, over the processes of the follower."""
    faults: dict[str, Any] = {}
    for value in sorted({int(value) for rows in parts for value in np.unique(rows[column])} - set(map(int, ordinary))):
        times = ticks = 0
        seconds, held = 0.0, False
        for rows in parts:
            flags = rows[column] == value
            if column == "status":
                flags &= ~joining(rows)
            goes_on = held and column == "status" and value == Status.STOPPED and bool(flags[:1].any())
            ticks += int(flags.sum())
            times += len(runs_of(rows, flags)) - goes_on
            seconds += seconds_of(rows, flags)
            held = bool(flags[-1]) if flags.size else held
        if ticks:
            name, sentence = _named(column, value)
            faults[name] = {"times": times, "seconds": seconds, "sentence": sentence}
    return faults


def fault_name(value: int) -> str:
    """Of a fault of the sensors, also one that this version does not know."""
    return _named("validity", value)[0]


def _named(column: str, value: int) -> tuple[str, str]:
    """Name and sentence of a status, or of a validity of the sensors."""
    sentences: Mapping[Any, str] = STATUS_SENTENCES if column == "status" else SENSOR_SENTENCES
    for known, sentence in sentences.items():
        if known == value:
            return known.name.lower(), sentence
    return f"{'status' if column == 'status' else 'fault'} {value}", "is not known to this version of foretouch"


REFUSED = {
    "stale": "stale",
    "overtaken": "overtaken or copied",
    "future": "from the future",
    "of_others": "of others",
    "before_release": "from before a release",
}
"""Commands that were refused, in words."""

MOST_LISTED = 5  # Number of segments above which only their number is given


def safety_findings(report: Mapping[str, Any]) -> Iterator[Finding]:
    """Emergency stops of the whole session in one sentence, and one for each fault of the sensors."""
    safety = report["safety"]
    if safety["emergency_stops"] or "stopped" in safety["statuses"]:
        yield Finding(_stops(report))
    for fault in safety["sensor_faults"].values():
        yield Finding(f"Faulty sensors for {number(fault['seconds'], 's')}: {fault['sentence']}.")


def _stops(report: Mapping[str, Any]) -> str:
    safety = report["safety"]
    stops = safety["statuses"].get("stopped")
    began = [str(index) for index, one in enumerate(report["segments"]["each"], 1) if one["emergency_stop"]]
    several = bool(stops and stops["times"] > 1)
    many = f"{stops['times']} emergency stops" if stops and several else "Emergency stop"
    where = f" in {_listed(began)}" if began else ""
    long = f", for {number(stops['seconds'], 's')}{' in all' if several else ''}" if stops else ""
    why = "; ".join(reason.rstrip(".") for reason in safety["emergency_stops"]) or "no reason was given"
    return f"{many}{where}{long}: {why}."


def _listed(numbers: list[str]) -> str:
    if len(numbers) > MOST_LISTED:
        return f"{len(numbers)} segments"
    *before, last = numbers
    return f"segments {', '.join(before)} and {last}" if before else f"segment {last}"


def safety_lines(report: Mapping[str, Any]) -> list[str]:
    """The block of the report about all that was not following."""
    safety, segments = report["safety"], report["segments"]
    lines = [
        f"  {name.replace('_', ' '):<10} {_lasted(one)}"
        for name, one in safety["statuses"].items()
        if not (safety["sensor_faults"] and name.startswith("sensor_fault"))  # named with its kind
    ]
    lines += [f"  sensors    {name.replace('_', ' ')}: {_lasted(one)}" for name, one in safety["sensor_faults"].items()]
    if safety["refused_commands"]:
        counts = ", ".join(f"{count:,} {REFUSED[why]}" for why, count in safety["refused_commands"].items())
        lines.append(f"  refused    commands: {counts}")
    if len(safety["control"]) > 1 or "of_others" in safety["refused_commands"]:
        lines.append(f"  control    was held by {', then '.join(safety['control']) or 'one whose name is not known'}")
    lines += [f"  contested  {sentence}" for sentence in safety["contests"]]
    if safety["step_failures"]:
        lines.append(f"  failures   {plural(safety['step_failures'], 'exception')} in the follower's step")
    if segments["count"] > 1:
        hand, robot = (number(segments[f"max_{side}_force_N"], "N") for side in ("rendered", "follower"))
        lines.append(f"  forces     in all {segments['count']} segments at most {hand} rendered, {robot} at the robot")
    whole = " in the whole session" if segments["count"] > 1 else ""
    return [f"What the robot did beside following{whole}", *lines, ""] if lines else []


def _lasted(one: Mapping[str, Any]) -> str:
    return f"{plural(one['times'], 'time')}, {number(one['seconds'], 's')}: {one['sentence']}"


SAFETY = Section("safety", safety_findings, safety_lines)

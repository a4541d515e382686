"""What happened beside following, as plain text; nothing where nothing did."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from foretouch.errors import plural, was_or_were
from foretouch.recordings import FollowerSamples
from foretouch.report.numbers import figure, number
from foretouch.report.statuses import fault_name

REFUSED = {
    "stale": "stale",
    "overtaken": "overtaken or copied",
    "future": "from the future",
    "of_others": "of others",
    "before_release": "from before a release",
}
"""Commands that were refused, in words."""

MOST_PLACES = 5
"""Where there are more stretches than this, their number is said alone."""


def lasted(report: Mapping[str, Any]) -> str:
    """How long the whole session was, and the stretch whose figures these are, as the beginning of a line.

    Args:
        report: What `session_report` gave.
    """
    found, own = report["stretches"], f"{report['duration_s']:.1f} s"
    if found["count"] < 2:
        return own
    return f"{found['duration_s']:.1f} s in {found['count']} stretches, of which the longest: {own}"


def stretch_sentence(report: Mapping[str, Any]) -> str:
    """Which part of a session the figures are of, where a side began again or settings changed; else empty.

    Args:
        report: What `session_report` gave.
    """
    found = report["stretches"]
    if found["count"] < 2:
        return ""
    began = _begun(found)
    if found["changes"]:
        began += f", and settings changed {_times(found['changes'])}"
    own, whole = (number(seconds, "s") for seconds in (report["duration_s"], found["duration_s"]))
    place = next((f" (number {place})" for place, one in enumerate(found["each"], 1) if one["reported"]), "")
    errors = [one["rendered_error_percent"] for one in found["each"] if one["rendered_error_percent"] is not None]
    spread = ""
    if len(errors) > 1:
        spread = f" The rendered force was wrong by {figure(min(errors))} to {number(max(errors), '%')}, by stretch."
    return f"{began[:1].upper()}{began[1:]}; figures are of the longest stretch{place}, {own} of {whole}.{spread}"


def left_out(samples: FollowerSamples) -> list[str]:
    """What those leave out who learn from a session or predict on it, one sentence each; none for most.

    Args:
        samples: Of the whole session.
    """
    said = []
    if samples.stretches > 1:
        begun = _begun({"leader_starts": samples.leader_starts, "follower_starts": samples.follower_starts})
        said.append(f"{begun}; used is the longest stretch, {number(samples.seconds, 's')}")
    if samples.faults.size:
        kinds = ", ".join(fault_name(kind) for kind in samples.faults.tolist()).replace("_", " ")
        faulty = int(samples.fault_counts.sum())
        count = f"{plural(faulty, 'sample')} {was_or_were(faulty)} left out"
        said.append(f"{count}: the sensors were not to be trusted ({kinds})")
    return said


def safety_sentences(report: Mapping[str, Any]) -> list[str]:
    """Emergency stops of the whole session in one sentence, and one for each fault of the sensors."""
    safety = report["safety"]
    said = [_stops(report)] if safety["emergency_stops"] or "stopped" in safety["statuses"] else []
    for fault in safety["sensor_faults"].values():
        said.append(f"Faulty sensors for {number(fault['seconds'], 's')}: {fault['sentence']}.")
    return said


def _stops(report: Mapping[str, Any]) -> str:
    """How many emergency stops there were, in which stretches they began, how long they lasted in all, and why."""
    safety = report["safety"]
    found = safety["statuses"].get("stopped")
    began = [str(place) for place, one in enumerate(report["stretches"]["each"], 1) if one["emergency_stop"]]
    many = f"{found['times']} emergency stops" if found and found["times"] > 1 else "Emergency stop"
    where = f" in {_listed(began)}" if began else ""
    long = f", {number(found['seconds'], 's')}{' in all' if found['times'] > 1 else ''}" if found else ""
    why = "; ".join(reason.rstrip(".") for reason in safety["emergency_stops"]) or "nobody said why"
    return f"{many}{where}{long}: {why}."


def _listed(places: list[str]) -> str:
    if len(places) > MOST_PLACES:
        return f"{len(places)} stretches"
    *before, last = places
    return f"stretches {', '.join(before)} and {last}" if before else f"stretch {last}"


def safety_lines(report: Mapping[str, Any]) -> list[str]:
    """The block of the report about all that was not following."""
    safety, stretches = report["safety"], report["stretches"]
    lines = [f"  {name.replace('_', ' '):<10} {_lasted(one)}" for name, one in safety["statuses"].items()]
    if safety["sensor_faults"]:
        lines = [line for line in lines if not line.startswith("  sensor fault")]  # said with its kind
    lines += [f"  sensors    {name.replace('_', ' ')}: {_lasted(one)}" for name, one in safety["sensor_faults"].items()]
    if safety["refused_commands"]:
        counts = ", ".join(f"{count:,} {REFUSED[why]}" for why, count in safety["refused_commands"].items())
        lines.append(f"  refused    commands: {counts}")
    if len(safety["control"]) > 1 or "of_others" in safety["refused_commands"]:
        lines.append(f"  control    was held by {', then '.join(safety['control']) or 'one whose name is not known'}")
    lines += [f"  contested  {sentence}" for sentence in safety["contests"]]
    if safety["step_failures"]:
        lines.append(f"  failures   {plural(safety['step_failures'], 'exception')} in the follower's step")
    if stretches["count"] > 1:
        hand, robot = (number(stretches[f"max_{side}_force_N"], "N") for side in ("rendered", "follower"))
        lines.append(
            f"  forces     in all {stretches['count']} stretches at most {hand} rendered, {robot} at the robot"
        )
    whole = " in the whole session" if stretches["count"] > 1 else ""
    return [f"What the robot did beside following{whole}", *lines, ""] if lines else []


def _begun(found: Mapping[str, Any]) -> str:
    leader, follower = (_times(found[f"{side}_starts"]) for side in ("leader", "follower"))
    return f"the leader began {leader}, the follower {follower}"


def _lasted(one: Mapping[str, Any]) -> str:
    return f"{_times(one['times'])}, {number(one['seconds'], 's')}: {one['sentence']}"


def _times(count: int) -> str:
    return plural(count, "time")

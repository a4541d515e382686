"""Description of a session, and its parts between restarts and changes of settings, each with its figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from foretouch.errors import plural, was_or_were
from foretouch.messages import SessionLog, Status
from foretouch.quantities import Array
from foretouch.recordings import FollowerSamples
from foretouch.report.numbers import AS_IT_COMES, Finding, figure, filled, largest, number, number_of, sentence, setting
from foretouch.report.rows import Pairs, not_scored, pair
from foretouch.report.scores import Scores, score_prediction
from foretouch.report.sections import Section
from foretouch.report.sections.hand import hand_figures
from foretouch.report.sections.safety import fault_name
from foretouch.settings import NO_BASELINE, NO_GRIP, SIMULATED, is_simulated

INSECURE = "INSECURE: nothing was encrypted and nobody was checked; anybody on the network could command."

OPEN_LOOP = "open loop: the force does not move the hand"
OWN_HAND = "closed loop: a hand of its own holds the device {} and feels the force"


def pressed(settings: Mapping[str, str]) -> dict[str, str]:
    """``scene`` and ``material``, as far as they are known, which a robot of another package has itself; ``robot``."""
    robot = settings.get("robot", SIMULATED)
    names = ["scene"] + ["material"] * is_simulated(robot) + ["robot"] * (robot != SIMULATED)
    return {name: settings[name] for name in names if settings.get(name)}


def session_findings(report: Mapping[str, Any]) -> Iterator[Finding]:
    """A warning where anybody could have commanded."""
    if report["settings"].get("insecure") == "yes":
        yield Finding(INSECURE)


def heading(report: Mapping[str, Any]) -> list[str]:
    """The first lines of the report: the operator, what was pressed, the part reported, and what the force moved."""
    chosen = report["settings"]
    words = [lasted(report), *(f"{name} {what}" for name, what in pressed(chosen).items())]
    words += [f"{name.replace('_', ' ')} {chosen[name]}{unit}" for name, unit in _SHOWN.items() if chosen.get(name)]
    sentences = segment_sentence(report), sentence(report["loop"]), baseline_sentence(report)
    return [f"Session: {', '.join(words)}", *filter(None, sentences)]


_SHOWN = {"operator": "", "estimator": "", "network": "", "position_delay": " s", "force_delay": " s"}


def loop_sentence(settings: Mapping[str, str]) -> str:
    """Whether the force moves a hand, whose, and which device it holds."""
    grip = setting(settings, "grip", NO_GRIP)
    if settings.get("replay") == "open loop" or (grip == NO_GRIP and settings.get("felt") != "yes"):
        return OPEN_LOOP
    if grip == NO_GRIP:
        return OWN_HAND.format(setting(settings, "operator", "a device"))
    names = ("mass", "damping", "friction", "resolution")
    mass, damping, friction, resolution = (number_of(settings, f"device_{name}", 0.0) for name in names)
    return (
        f"closed loop: a hand with a {grip} grip holds a device of {mass:g} kg, {damping:g} N s/m, "
        f"{friction:g} N of friction and {1e6 * resolution:g} um a count"
    )


def baseline_sentence(report: Mapping[str, Any]) -> str:
    """The force that was rendered without a model; empty where models were."""
    if report["baseline"] == NO_BASELINE:
        return ""
    part = "" if report["baseline"] == AS_IT_COMES else ", as far as a passivity controller let it"
    return f"Baseline {report['baseline']}: the delayed force was rendered{part}, for comparison."


def lasted(report: Mapping[str, Any]) -> str:
    """Length of the whole session, and the segment whose figures these are, as the beginning of a line."""
    if report["segments"]["count"] < 2:
        return filled("{duration_s:.1f} s", report)
    several = "{segments.duration_s:.1f} s in {segments.count} segments, of which the longest: {duration_s:.1f} s"
    return filled(several, report)


def segment_sentence(report: Mapping[str, Any]) -> str:
    """The part of a session that the figures are of, where a side began again or settings changed; else empty."""
    segments = report["segments"]
    if segments["count"] < 2:
        return ""
    began = sentence(_begun(segments)).rstrip(".")
    if segments["changes"]:
        began += filled(", and settings changed {changes:#time}", segments)
    which = next((f" (number {index})" for index, one in enumerate(segments["each"], 1) if one["reported"]), "")
    errors = [one["rendered_error_percent"] for one in segments["each"] if one["rendered_error_percent"] is not None]
    spread = ""
    if len(errors) > 1:
        spread = f" The rendered force was wrong by {figure(min(errors))} to {number(max(errors), '%')}, by segment."
    parts = filled("{duration_s:s} of {segments.duration_s:s}", report)
    return f"{began}; figures are of the longest segment{which}, {parts}.{spread}"


def left_out(samples: FollowerSamples) -> list[str]:
    """Samples of a session that are left out of learning and predicting, one sentence each; none for most."""
    sentences = []
    if samples.segments > 1:
        begun = _begun({"leader_starts": samples.leader_starts, "follower_starts": samples.follower_starts})
        sentences.append(f"{begun}; used is the longest segment, {number(samples.seconds, 's')}")
    if samples.faults.size:
        kinds = ", ".join(fault_name(kind) for kind in samples.faults.tolist()).replace("_", " ")
        faulty = int(samples.fault_counts.sum())
        count = f"{plural(faulty, 'sample')} {was_or_were(faulty)} left out"
        sentences.append(f"{count}: the sensors were not to be trusted ({kinds})")
    return sentences


def _begun(segments: Mapping[str, Any]) -> str:
    return filled("the leader began {leader_starts:#time}, the follower {follower_starts:#time}", segments)


MOST_LINES = 12  # Phases that are listed in the text, the longest of them; all are in the JSON


def duration(log: SessionLog) -> float:
    """Time between the first and the last tick of the leader, or of the follower without a leader [s]."""
    table = log.leader if log.leader.size else log.follower
    return float(np.ptp(table["time_ns"])) * 1e-9 if table.size else 0.0


def scored(pairs: Pairs, force: Array, true: str = "sensor_force", **window: Any) -> Scores:
    """Scores of a force at equal command against one of the follower's; the sender took the delayed one's zero off."""
    columns = pairs.follower[true], force, pairs.leader["delayed_force"]
    window |= {"position": pairs.follower["position"], "skipped": not_scored(pairs), "delayed_offset": 0.0}
    return score_prediction(pairs.time, *columns, **window)


def rendered_scores(log: SessionLog, pairs: Pairs, **window: Any) -> Scores:
    """Scores of the rendered force, in the robot's forces."""
    return scored(pairs, pairs.leader["rendered_force"] / number_of(log.settings, "force_scale", 1.0), **window)


def phase_figures(whole: SessionLog, chosen: SessionLog, **window: Any) -> list[dict[str, Any]]:
    """One object for each phase of a session, none where it is one alone.

    Returns:
        For each: ``begin_s`` since the leader's first message, ``duration_s``, ``reported`` (whether it is the chosen
        one), ``emergency_stop`` (whether the robot was stopped in it, and not before), ``settings``: those that are not
        the same in all phases, and what was pressed; ``rendered_error_percent``, ``prediction_error_percent``,
        ``delayed_force_error_percent``, ``rendered_within_jnd_percent``, ``stable`` and
        ``max_rendered_force_N``.
    """
    phases = whole.phases()
    if len(phases) < 2:
        return []
    names = dict.fromkeys(name for phase in phases for name in phase.settings)
    telling = [name for name in names if len({phase.settings.get(name) for phase in phases}) > 1]
    # Every start of a leader takes a new name and address.
    telling = [name for name in telling if name not in ("leader", "settings_since_ns")]
    began = int(whole.leader["time_ns"][0]) if whole.leader.size else 0
    segments, was_stopped = [], False
    for phase in phases:
        stopped = np.append(was_stopped, phase.follower["status"] == Status.STOPPED)
        was_stopped = bool(stopped[-1])
        pairs = pair(phase)
        rendered = rendered_scores(phase, pairs, **window)
        predicted = scored(pairs, pairs.leader["predicted_force"], **window)
        shown = pressed(phase.settings) | {name: phase.settings.get(name, "") for name in telling}
        segments.append(
            {
                "begin_s": float(phase.leader["time_ns"][0] - began) * 1e-9 if phase.leader.size else None,
                "duration_s": duration(phase),
                "reported": _same(phase, chosen),
                "emergency_stop": bool((stopped[1:] & ~stopped[:-1]).any()),
                "settings": shown,
                "rendered_error_percent": rendered.prediction_error_percent,
                "prediction_error_percent": predicted.prediction_error_percent,
                "delayed_force_error_percent": rendered.delayed_force_error_percent,
                "rendered_within_jnd_percent": rendered.within_jnd_percent,
                "stable": hand_figures(phase, pairs)["stable"],
                "max_rendered_force_N": largest(phase.leader["rendered_force"]),
            }
        )
    return segments


def phase_lines(report: Mapping[str, Any]) -> list[str]:
    """The block of the report that lists the phases; nothing where there is one alone."""
    phases = report["segments"]["each"]
    if not phases:
        return []
    order = sorted(range(len(phases)), key=lambda index: -phases[index]["duration_s"])
    listed = sorted(order[:MOST_LINES])
    lines = ["Segments, each with its own settings (* is the one whose figures these are)"]
    for index in listed:
        one = phases[index]
        settings = ", ".join(f"{name.replace('_', ' ')} {text or 'unknown'}" for name, text in one["settings"].items())
        sign, begin = "*" if one["reported"] else " ", number(one["begin_s"], "s")
        lines.append(f"  {sign} {index + 1:<3} from {begin} for {number(one['duration_s'], 's')}: {settings}")
        errors = ", ".join(
            f"{word} {number(one[f'{name}_error_percent'], '%')}"
            for name, word in (("rendered", "rendered"), ("prediction", "predicted"), ("delayed_force", "delayed"))
        )
        stable = {True: "stable", False: "not stable", None: "stability unknown"}[one["stable"]]
        lines.append(f"        error {errors}; {stable}")
    if len(phases) > len(listed):
        lines.append(f"    and {plural(len(phases) - len(listed), 'part')} more, all of them shorter: --json has them")
    return [*lines, ""]


def _same(phase: SessionLog, chosen: SessionLog) -> bool:
    """Whether two phases of one session are the same: no row is in two of them."""
    for one, other in ((phase.leader, chosen.leader), (phase.follower, chosen.follower)):
        if one.size and other.size:
            return all(int(one[name][0]) == int(other[name][0]) for name in ("epoch", "run", "sequence", "time_ns"))
    return False


SESSION = Section("session", session_findings, phase_lines)

"""The parts of a session between restarts and changes of settings, each with its own figures, settings and words.

The words say what a session pressed, who could reach it, and what its machines were too slow for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foretouch.errors import plural
from foretouch.messages import SessionLog, Status
from foretouch.report.hand import hand_figures, largest, number_of
from foretouch.report.numbers import figure, number
from foretouch.report.pairs import not_scored, pair
from foretouch.report.scores import score
from foretouch.session.operators import STAYS_IN_THE_AIR
from foretouch.session.settings import SIMULATED

OFTEN_LATE = 0.1
"""A loop that is late in more than this share of its ticks does not keep its rate."""


def pressed(settings: Mapping[str, str]) -> dict[str, str]:
    """What was pressed, by the name of the setting that says so: a robot of another package has a material of its own.

    Args:
        settings: Of the session, as texts.

    Returns:
        ``scene`` and ``material``, as far as they are known, or ``robot`` in place of the material.
    """
    robot = settings.get("robot", SIMULATED)
    names = ("scene", "material") if robot == SIMULATED else ("scene", "robot")
    return {name: settings[name] for name in names if settings.get(name)}


def out_of_reach(report: Mapping[str, Any]) -> str:
    """Why nothing was touched, where the operator was a script that did not know where; else empty.

    Args:
        report: What `session_report` gave.
    """
    settings = report["settings"]
    robot = settings.get("robot", SIMULATED)
    unknown = robot != SIMULATED and "surface" not in settings
    if report["status"] != "no_contact" or not unknown or settings.get("operator") != "browser":
        return ""
    return f"Robot {robot!r} {STAYS_IN_THE_AIR}."


def late_sentences(report: Mapping[str, Any]) -> list[str]:
    """One sentence for each loop that was late in more than a tenth of its ticks."""
    said = []
    for side in ("leader", "follower"):
        timing = report["timing"][side]
        late, ticks = timing["late_ticks"], timing["ticks"]
        if late > OFTEN_LATE * ticks and timing["ticks_per_s"] is not None:
            share, rate = figure(100.0 * late / ticks), f"{timing['ticks_per_s']:.0f} of {timing['rate']:.0f} a second"
            said.append(f"The {side}'s loop was late in {share} % of its ticks: {rate}.")
    return said


def nowhere_sentence(report: Mapping[str, Any]) -> str:
    """How often the operator's device gave no position; empty where it always gave one."""
    count, ticks = report["nowhere_samples"], report["timing"]["leader"]["ticks"]
    if not count:
        return ""
    share = figure(100.0 * count / ticks)
    return f"The device gave no position in {count:,} of {ticks:,} ticks ({share} %): the last one was held."


MOST_LINES = 12
"""So many phases are listed in the text, the longest of them; all stand in the JSON."""


def contact_scores(log: SessionLog, **window: Any) -> dict[str, Any]:
    """Scores of the rendered and of the predicted force of one phase, at equal command.

    Args:
        log: Of `SessionLog.phases`.
        **window: As for `score`: ``contact_floor``, ``score_from``, ``score_to``.
    """
    pairs = pair(log)
    sensor, known = pairs.follower["sensor_force"], pairs.leader["delayed_force"]
    felt = pairs.leader["rendered_force"] / number_of(log.settings, "force_scale", 1.0)
    window |= {"position": pairs.follower["position"], "skipped": not_scored(pairs), "delayed_offset": 0.0}
    forces = {"rendered": felt, "predicted": pairs.leader["predicted_force"]}
    return {name: score(pairs.time, sensor, force, known, **window) for name, force in forces.items()}


def phase_figures(whole: SessionLog, chosen: SessionLog, **window: Any) -> list[dict[str, Any]]:
    """One object for each phase of a session, none where it is one alone.

    Args:
        whole: The session.
        chosen: The phase whose figures the report gives in full.
        **window: As for `score`.

    Returns:
        Of each: ``begin_s`` since the leader was first heard, ``duration_s``, ``reported`` (whether it is the chosen
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
    # Every start of a leader takes a name and a place of its own.
    telling = [name for name in telling if name not in ("leader", "settings_since_ns")]
    began = int(whole.leader["time_ns"][0]) if whole.leader.size else 0
    found, was_stopped = [], False
    for phase in phases:
        stopped = np.append(was_stopped, phase.follower["status"] == Status.STOPPED)
        was_stopped = bool(stopped[-1])
        scores = contact_scores(phase, **window)
        rendered, predicted = scores["rendered"], scores["predicted"]
        table = phase.leader if phase.leader.size else phase.follower
        shown = pressed(phase.settings) | {name: phase.settings.get(name, "") for name in telling}
        found.append(
            {
                "begin_s": float(phase.leader["time_ns"][0] - began) * 1e-9 if phase.leader.size else None,
                "duration_s": float(np.ptp(table["time_ns"])) * 1e-9 if table.size else 0.0,
                "reported": _same(phase, chosen),
                "emergency_stop": bool((stopped[1:] & ~stopped[:-1]).any()),
                "settings": shown,
                "rendered_error_percent": rendered.prediction_error_percent,
                "prediction_error_percent": predicted.prediction_error_percent,
                "delayed_force_error_percent": rendered.delayed_force_error_percent,
                "rendered_within_jnd_percent": rendered.within_jnd_percent,
                "stable": hand_figures(phase)["stable"],
                "max_rendered_force_N": largest(phase.leader["rendered_force"]),
            }
        )
    return found


def phase_lines(report: Mapping[str, Any]) -> list[str]:
    """The block of the report that lists the phases; nothing where there is one alone.

    Args:
        report: What `session_report` gave.
    """
    phases = report["stretches"]["each"]
    if not phases:
        return []
    order = sorted(range(len(phases)), key=lambda index: -phases[index]["duration_s"])
    listed = sorted(order[:MOST_LINES])
    lines = ["Stretches, each with its own settings (* is the one whose figures these are)"]
    for index in listed:
        one = phases[index]
        said = ", ".join(f"{name.replace('_', ' ')} {text or 'not said'}" for name, text in one["settings"].items())
        sign, begin = "*" if one["reported"] else " ", number(one["begin_s"], "s")
        lines.append(f"  {sign} {index + 1:<3} from {begin} for {number(one['duration_s'], 's')}: {said}")
        errors = ", ".join(
            f"{word} {number(one[f'{name}_error_percent'], '%')}"
            for name, word in (("rendered", "rendered"), ("prediction", "predicted"), ("delayed_force", "delayed"))
        )
        stable = {True: "stable", False: "not stable", None: "nobody knows whether stable"}[one["stable"]]
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

"""What a session pressed, who could reach it, and what its machines were too slow for, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from foretouch.report.numbers import figure
from foretouch.session.operators import STAYS_IN_THE_AIR
from foretouch.session.settings import SIMULATED

__all__ = ["late_sentences", "nowhere_sentence", "out_of_reach", "pressed"]

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

"""A sweep as one object of numbers, and as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from foretouch.sweep.curves import crossovers, said_of_crossovers
from foretouch.sweep.outcome import Outcome
from foretouch.sweep.totals import of, totals

__all__ = ["KINDS", "TOTALS", "objections", "render_table", "said", "summary"]

KINDS = {"none": "ours", "delayed": "delayed", "delayed-tdpa": "delayed-tdpa"}
"""Names of what was rendered, by name of the baseline."""

TOTALS = {
    "sessions": ("", "sessions"),
    "failed": ("", "failed"),
    "unstable": ("", "unstable"),
    "oscillating": ("", "of these the hand oscillates"),
    "bound_broken": ("", "of these give out more energy than the bound"),
    "largest_energy_surplus_J": ("J", "largest energy surplus over the bound"),
    "largest_jump_N": ("N", "largest change of force by a model in one tick"),
    "median_error_percent": ("%", "error of the felt force, median"),
    "median_prediction_error_percent": ("%", "error of the predicted force, median"),
    "median_felt_stiffness_percent": ("%", "felt stiffness, median"),
    "median_device_bound_percent": ("%", "of contact bounded by the device, median"),
    "largest_phantom_N": ("N", "largest force felt where there is nothing"),
    "median_phantom_N": ("N", "the same, median of the sessions"),
    "largest_hand_force_N": ("N", "largest force at the hand"),
    "largest_robot_force_N": ("N", "largest force at the robot"),
    "held_s": ("s", "in which the robot was held, or on its way back"),
    "false_alarms": ("", "sessions in which sensors were not believed"),
    "guarded_contacts": ("", "guarded contacts"),
    "median_depth_lost_mm": ("mm", "depth lost by guarding, median"),
    "median_time_lost_s": ("s", "time lost by guarding, median"),
    "simulated_s": ("s", "simulated"),
    "elapsed_s": ("s", "computed"),
}
"""Unit and words of each of `totals`."""


def summary(rows: Sequence[Outcome]) -> dict[str, Any]:
    """What came of a sweep, ready for JSON.

    ``ours`` are all sessions that rendered models, ``compared`` those of them that were run with the baselines too,
    which are beside them; ``objections`` are what is wrong with ours, with the command that runs each again.
    """
    numbers = {row.number for row in rows if row.baseline != "none"}
    content: dict[str, Any] = {"ours": totals(of(rows, "none"))}
    if numbers:
        content["compared"] = totals([row for row in of(rows, "none") if row.number in numbers])
        content |= {name: totals(of(rows, name)) for name in KINDS if name != "none"}
        content["crossovers"] = crossovers(rows)
    content["objections"] = objections(of(rows, "none"))
    return content


def objections(rows: Sequence[Outcome]) -> list[dict[str, Any]]:
    """What is wrong with these sessions."""
    return [
        {"number": row.number, "objection": text, "command": row.command} for row in rows for text in row.objections
    ]


def render_table(content: dict[str, Any]) -> str:
    """A summary for a terminal.

    Returns:
        Lines without a last line break.
    """
    columns = {name: content[name] for name in ("ours", "compared", *list(KINDS)[1:]) if name in content}
    width = max(len(words) for _, words in TOTALS.values())
    lines = [" " * width + "".join(f"{name:>14}" for name in columns)]
    for name, (unit, words) in TOTALS.items():
        cells = (said(column[name], unit) for column in columns.values())
        lines.append(f"{words:{width}}" + "".join(f"{cell:>14}" for cell in cells))
    lines += said_of_crossovers(content.get("crossovers", ()))
    for found in content["objections"]:
        lines += [f"session {found['number']}: {found['objection']}", f"  {found['command']}"]
    return "\n".join(lines)


def said(value: float | None, unit: str) -> str:
    """A figure with its unit, a dash for None."""
    return "-" if value is None else f"{value:.3g} {unit}" if unit else str(value)

"""A sweep as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

from foretouch.report import embedded, table, tiles, write_html
from foretouch.sweep.curves import AXES, said_of_crossovers
from foretouch.sweep.figures import condition_figure, energy_figure, error_figure, jump_figure, stiffness_figure
from foretouch.sweep.outcome import FORCE_CEILING, LARGEST_JUMP, Outcome
from foretouch.sweep.summary import TOTALS, said, summary

__all__ = ["write_sweep_page"]

MOST_SHOWN = 100
"""So many objections are listed."""

ERROR_CAPTIONS = (
    "Both ways together, without what else holds messages up.",
    "Models that are rendered, by the second; baselines render none.",
    "How long ago the hand was where the newest knowledge comes from; of a baseline, the force.",
)
"""Of the errors, by axis."""

HEADS = {
    "ours": "models (ours)",
    "compared": "ours, where compared",
    "delayed": "delayed force",
    "delayed-tdpa": "delayed, passivity controller",
}


def write_sweep_page(
    directory: str | PathLike[str], rows: Sequence[Outcome], made: Mapping[str, Any] | None = None
) -> Path:
    """Write tables and plots of a sweep as ``index.html``; it makes no request to anywhere.

    Args:
        directory: Made if it is not there.
        rows: As `run_sweep` gave them, at least one.
        made: What made it, for the end of the page, as `write_html` takes it.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    content = summary(rows)
    body = [
        "<h1>Sweep of simulated sessions</h1>",
        f'<p class="quiet">{escape(_what(rows, content))}</p>',
        _verdict(content),
        *(f"<p>{escape(sentence)}</p>" for sentence in said_of_crossovers(content.get("crossovers", ()))),
        _tiles(content["ours"]),
        "<h2>How it feels</h2>",
        "<p>The error is that of the felt force: the rendered one over the force scale, less the true one, at equal "
        "command, in contact, as a share of the true one. Dots are sessions; lines are medians and bands quartiles, "
        "where there are enough. Shown are networks that do nothing but delay, materials that usual devices can carry, "
        "and hands without a clutch; dashed, materials that are stiffer.</p>",
        *(embedded(error_figure(rows, axis), caption) for axis, caption in zip(AXES, ERROR_CAPTIONS, strict=True)),
        embedded(
            stiffness_figure(rows, AXES[0]),
            "Median of the presses of a session that are long and deep enough to tell; 100 % is as stiff as it is.",
        ),
        "<h2>Stability</h2>",
        embedded(
            condition_figure(rows),
            "Full colour: stable. Pale: the hand does not oscillate, but is given more energy than the bound allows.",
        ),
        embedded(energy_figure(rows), "Each session counts once, by its worst tick."),
        embedded(jump_figure(rows), f"Each session counts once, by its worst tick; {LARGEST_JUMP:g} N is allowed."),
        "<h2>Totals</h2>",
        _totals(content),
        "<h2>Sessions that are not as they should be</h2>",
        *_objections(content["objections"]),
    ]
    return write_html(directory, "foretouch sweep", body, made)


def _what(rows: Sequence[Outcome], content: dict[str, Any]) -> str:
    compared = content.get("compared", {"sessions": 0})["sessions"]
    hours = content["ours"]["simulated_s"] / 3600.0
    return (
        f"{content['ours']['sessions']} sessions, {hours:.3g} h of simulated time; {compared} of them with baselines "
        f"too. All materials and grips, round trips from 0 to {max(row.round_trip_s for row in rows):.2g} s."
    )


def _verdict(content: dict[str, Any]) -> str:
    if content["objections"]:
        wrong = len({found["number"] for found in content["objections"]})
        return f'<p class="bad">{wrong} of our sessions are not as they should be: see the end of this page.</p>'
    return (
        '<p class="good">No session of ours is unstable, none gives out more energy than its bound, no model changes '
        f"the force by more than {LARGEST_JUMP:g} N in one tick, and no robot presses with more than "
        f"{FORCE_CEILING:g} N.</p>"
    )


def _tiles(ours: dict[str, Any]) -> str:
    shown = ("sessions", "unstable", "largest_energy_surplus_J", "largest_jump_N", "median_error_percent")
    return tiles([(said(ours[name], TOTALS[name][0]), TOTALS[name][1]) for name in shown])


def _totals(content: dict[str, Any]) -> str:
    columns = [name for name in HEADS if name in content]
    lines = [
        [words, *(said(content[name][figure], unit) for name in columns)] for figure, (unit, words) in TOTALS.items()
    ]
    return table(["", *(HEADS[name] for name in columns)], lines)


def _objections(found: list[dict[str, Any]]) -> list[str]:
    if not found:
        return ["<p>None.</p>"]
    lines = [
        f"session {one['number']}: {escape(one['objection'])}\n  {escape(one['command'])}" for one in found[:MOST_SHOWN]
    ]
    rest = len(found) - MOST_SHOWN
    more = [f"<p>and {rest} more</p>"] if rest > 0 else []
    return [f"<pre>{chr(10).join(lines)}</pre>", *more]

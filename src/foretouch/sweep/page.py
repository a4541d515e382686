"""A sweep as one self-contained HTML page with its plots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.quantities import Array
from foretouch.report import COLOURS, embedded, finished, legend, new_figure, table, tiles, write_html
from foretouch.sweep.cases import NETWORKS, STIFF
from foretouch.sweep.curves import (
    AXES,
    LABEL,
    TOTALS,
    Axis,
    Curve,
    crossover_sentences,
    curve,
    error_of,
    figure_text,
    objection_lines,
    plain,
    stiff,
    summary,
)
from foretouch.sweep.outcome import FORCE_CEILING, LARGEST_JUMP, Outcome, of

COLOUR = {"none": COLOURS[0], "delayed": COLOURS[1], "delayed-tdpa": COLOURS[3]}
MARKER = {"none": "o", "delayed": "s", "delayed-tdpa": "^"}
"""Markers by baseline; they distinguish them without colour too."""

JND = (7.0, 10.0)  # Just noticeable differences of force for people [%]


def error_figure(rows: Sequence[Outcome], axis: Axis) -> Any:
    """Error of the felt force against one axis."""
    drawing, axes = _dots_and_curves(rows, error_of, axis)
    axes.axhspan(*JND, color="0.88", linewidth=0.0, zorder=0)
    style = {"ha": "right", "fontsize": "x-small", "color": "0.3", "transform": axes.get_yaxis_transform()}
    axes.text(0.99, 1.06 * JND[0], "what a hand tells apart", **style)
    axes.set(yscale="log", ylim=(1.0, 300.0))
    marks = (1, 2, 5, 10, 20, 50, 100, 200)
    axes.set_yticks(marks, [f"{mark}" for mark in marks])
    axes.minorticks_off()
    axes.set_ylabel("error of the felt force [%]")
    return _named(drawing, axes, f"Error of the felt force against {axis.name}")


def stiffness_figure(rows: Sequence[Outcome], axis: Axis) -> Any:
    """Felt stiffness against one axis; 100 % is that of the material."""
    drawing, axes = _dots_and_curves(rows, lambda row: row.felt_stiffness_percent, axis)
    axes.axhline(100.0, color="0.3", linewidth=0.8)
    axes.set(ylim=(-50.0, 200.0), ylabel="felt stiffness [% of the true one]")
    return _named(drawing, axes, f"Felt stiffness against {axis.name}")


def condition_figure(rows: Sequence[Outcome]) -> Any:
    """Fraction of stable sessions by network, grip and round trip; pale: no oscillation, but energy given out."""
    kinds = [kind for kind in LABEL if of(rows, kind)]
    networks = dict.fromkeys((*NETWORKS, *(row.network for row in rows)))  # those that are named come last
    every: list[tuple[str, Callable[[Outcome], bool]]] = [
        *((name, lambda row, name=name: row.network == name) for name in networks),
        *(
            (f"grip: {grip}", lambda row, grip=grip: row.options["grip"] == grip)
            for grip in ("soft", "normal", "stiff")
        ),
        ("round trip below 50 ms", lambda row: row.round_trip_s < 0.05),
        ("round trip from 50 ms to 1 s", lambda row: 0.05 <= row.round_trip_s < 1.0),
        ("round trip from 1 s on", lambda row: row.round_trip_s >= 1.0),
    ]
    groups = [(name, inside) for name, inside in every if any(inside(row) for row in rows)]
    drawing = new_figure(1.3 + 0.42 * len(groups))
    axes = drawing.subplots()
    height = 0.8 / len(kinds)
    for index, kind in enumerate(kinds):
        axes.barh([0.0], [0.0], color=COLOUR[kind], label=LABEL[kind])
        for line, (_, inside) in enumerate(groups):
            sessions = [row for row in of(rows, kind) if inside(row) and not row.error]
            if not sessions:
                continue
            stable, still = sum(bool(row.stable) for row in sessions), sum(not row.oscillating for row in sessions)
            where = line + (index - 0.5 * (len(kinds) - 1)) * height
            axes.barh(where, 100.0 * still / len(sessions), 0.9 * height, color=COLOUR[kind], alpha=0.35)
            axes.barh(where, 100.0 * stable / len(sessions), 0.9 * height, color=COLOUR[kind])
            text = f"{stable} of {len(sessions)}" + (f"; {still} do not oscillate" if still > stable else "")
            axes.text(100.0 * still / len(sessions) + 0.7, where, text, va="center", fontsize=6.5)
    axes.set_yticks(range(len(groups)), [name for name, _ in groups], fontsize="small")
    axes.set(ylim=(len(groups) - 0.5, -0.5), xlim=(0.0, 120.0))
    axes.set_xticks(range(0, 101, 20))
    axes.set(xlabel="stable sessions [%]", title="Stable sessions by network, grip and round trip")
    legend(axes, len(kinds))
    finished(drawing, 1)
    drawing.subplots_adjust(left=0.18)
    axes.grid(axis="y", visible=False)
    return drawing


def energy_figure(rows: Sequence[Outcome]) -> Any:
    """The largest ratio of the energy taken to its bound in each session; beyond 100 % the bound is broken."""
    edges = np.concatenate([np.linspace(0.0, 100.0, 21), [120.0]])

    def value(row: Outcome) -> float | None:
        if row.energy_used_percent is None or row.energy_margin_J is None:
            return None
        return min(row.energy_used_percent, 99.9) if row.energy_margin_J >= 0.0 else 110.0

    kinds = [kind for kind in LABEL if of(rows, kind)]
    title = "Energy that was given out, against the bound for one tick and one encoder count"
    axes, drawing = _histograms(rows, value, edges, kinds, title)
    axes.axvline(100.0, color="black", linewidth=1.2, linestyle=(0, (4, 2)))
    axes.set_xticks([0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 110.0], ["0", "20", "40", "60", "80", "bound", "beyond"])
    axes.set_xlabel("largest energy in a session, as a fraction of its bound [%]")
    return finished(drawing, 1)


def jump_figure(rows: Sequence[Outcome]) -> Any:
    """The largest change of force that a model made in one tick of each session."""
    edges = np.linspace(0.0, 0.12, 25)

    def value(row: Outcome) -> float | None:
        return None if row.largest_jump_N is None else min(row.largest_jump_N, 0.1199)

    axes, drawing = _histograms(rows, value, edges, ["none"], "What models change at once")
    axes.axvline(LARGEST_JUMP, color="black", linewidth=1.2, linestyle=(0, (4, 2)))
    axes.text(LARGEST_JUMP, 0.95, " not allowed", transform=axes.get_xaxis_transform(), fontsize="small", va="top")
    axes.set_xlabel("largest change of force by a model in one tick [N]")
    return finished(drawing, 1)


def _dots_and_curves(rows: Sequence[Outcome], figure: Callable[[Outcome], float | None], axis: Axis) -> tuple[Any, Any]:
    """All plain sessions: each a dot, medians and quartiles in bins; a baseline's have no model rate."""
    drawing = new_figure(4.6)
    axes = drawing.subplots()
    for kind in LABEL:
        sessions = plain(of(rows, kind))
        if not sessions or (kind != "none" and axis is AXES[1]):
            continue
        points = [(axis.value(row), figure(row)) for row in sessions]
        known = np.array([(x, y) for x, y in points if x is not None and y is not None]).reshape(-1, 2)
        drawn = curve(sessions, axis.value, figure, axis.edges)
        dots = {"markersize": 2.5, "alpha": 0.3} if drawn.x.size else {"markersize": 5.0, "label": LABEL[kind]}
        if known.size:
            axes.plot(known[:, 0], known[:, 1], MARKER[kind], color=COLOUR[kind], zorder=1, **dots)
        if drawn.x.size:
            _draw(axes, drawn, kind)
    beside = curve(stiff(of(rows, "none")), axis.value, figure, axis.edges)
    if beside.x.size > 1:
        style = {"color": COLOUR["none"], "linewidth": 1.2, "linestyle": (0, (4, 2))}
        axes.plot(beside.x, beside.middle, label=f"ours on {' and '.join(STIFF)}", **style)
    _scale(axes, axis)
    axes.set_xlabel(f"{axis.name} [{axis.unit}]")
    return drawing, axes


def _named(drawing: Any, axes: Any, title: str) -> Any:
    axes.set_title(title)
    _legend(axes)
    return finished(drawing, 1)


def _legend(axes: Any) -> None:
    if drawn := len(axes.get_legend_handles_labels()[1]):
        legend(axes, drawn)


def _draw(axes: Any, drawn: Curve, kind: str) -> None:
    axes.fill_between(drawn.x, drawn.low, drawn.high, color=COLOUR[kind], alpha=0.18, linewidth=0.0, zorder=2)
    axes.plot(
        drawn.x, drawn.middle, marker=MARKER[kind], color=COLOUR[kind], linewidth=2.0, label=LABEL[kind], zorder=3
    )


def _scale(axes: Any, axis: Axis) -> None:
    """Logarithmic, with 0 where there is one."""
    if axis is AXES[1]:
        axes.set(xscale="log", xlim=(1.0, 220.0))
        marks: Sequence[float] = (1, 2, 5, 10, 20, 50, 100, 200)
    else:
        axes.set_xscale("symlog", linthresh=0.01, linscale=0.4)
        axes.set_xlim(-0.001, 6.0 if axis is AXES[0] else 12.0)
        marks = (0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
    axes.set_xticks(marks, [f"{mark:g}" for mark in marks])


def _histograms(
    rows: Sequence[Outcome], figure: Callable[[Outcome], float | None], edges: Array, kinds: list[str], title: str
) -> tuple[Any, Any]:
    drawing = new_figure(3.4)
    axes = drawing.subplots()
    for kind in kinds:
        values = [value for value in map(figure, of(rows, kind)) if value is not None]
        if not values:
            continue
        counts, _ = np.histogram(values, edges)
        percent = 100.0 * counts / len(values)
        axes.stairs(percent, edges, color=COLOUR[kind], fill=True, alpha=0.35)
        axes.stairs(percent, edges, color=COLOUR[kind], linewidth=1.5, label=f"{LABEL[kind]}: {len(values)} sessions")
    axes.set(ylabel="sessions [%]", title=title)
    _legend(axes)
    return axes, drawing


MOST_SHOWN = 100  # Largest number of objections listed

ERROR_CAPTIONS = (
    "Both ways together, without what else holds messages up.",
    "Models that are rendered, by the second; baselines render none.",
    "How long ago the hand was where the newest knowledge comes from; of a baseline, the force.",
)
"""Captions below the plots of the errors, by axis."""

HEADS = {
    "ours": "models (ours)",
    "compared": "ours, where compared",
    "delayed": "delayed force",
    "delayed-tdpa": "delayed, passivity controller",
}


def write_sweep_page(
    directory: str | PathLike[str], rows: Sequence[Outcome], made: Mapping[str, Any] | None = None
) -> Path:
    """Write tables and plots of a sweep as ``index.html`` in a folder, which is made if it is not there.

    Rows are as `run_sweep` gave them, at least one; `made` and the errors are those of `write_html`.
    """
    content = summary(rows)
    body = [
        "<h1>Sweep of simulated sessions</h1>",
        f'<p class="quiet">{escape(_what(rows, content))}</p>',
        _verdict(content),
        *(f"<p>{escape(sentence)}</p>" for sentence in crossover_sentences(content.get("crossovers", ()))),
        _tiles(content["ours"]),
        "<h2>How it feels</h2>",
        "<p>The error is that of the felt force: the rendered one over the force scale, less the true one, at equal "
        "command, in contact, as a fraction of the true one. Dots are sessions; lines are medians and bands quartiles, "
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
        wrong = len({one["number"] for one in content["objections"]})
        return f'<p class="bad">{wrong} of our sessions are not as they should be: see the end of this page.</p>'
    return (
        '<p class="good">No session of ours is unstable, none gives out more energy than its bound, no model changes '
        f"the force by more than {LARGEST_JUMP:g} N in one tick, and no robot presses with more than "
        f"{FORCE_CEILING:g} N.</p>"
    )


def _tiles(ours: dict[str, Any]) -> str:
    shown = ("sessions", "unstable", "largest_energy_surplus_J", "largest_jump_N", "median_error_percent")
    return tiles([(figure_text(ours[name], TOTALS[name][0]), TOTALS[name][1]) for name in shown])


def _totals(content: dict[str, Any]) -> str:
    columns = [name for name in HEADS if name in content]
    lines = [
        [words, *(figure_text(content[name][key], unit) for name in columns)] for key, (unit, words) in TOTALS.items()
    ]
    return table(["", *(HEADS[name] for name in columns)], lines)


def _objections(rows: list[dict[str, Any]]) -> list[str]:
    if not rows:
        return ["<p>None.</p>"]
    lines = "\n".join(objection_lines(rows[:MOST_SHOWN]))
    rest = len(rows) - MOST_SHOWN
    return [f"<pre>{escape(lines)}</pre>", *([f"<p>and {rest} more</p>"] if rest > 0 else [])]

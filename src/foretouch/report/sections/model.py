"""The contact model: what was learnt at the end of a session, and its parameters over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.messages import ModelUpdate
from foretouch.models import LAWS
from foretouch.quantities import QUANTITIES, Array, new_figure
from foretouch.report.drawing import ERROR, NARROW, PREDICTED, extremes, finished, legend, mark, note
from foretouch.report.numbers import Finding, figure, number, parameter_text
from foretouch.report.rows import Segment
from foretouch.report.sections import Drawing, Section, View

IDLE_LAW = "the law's weight in the force is 0 %: these numbers play no part in it"
"""Remark beside the numbers of a contact map's law where that holds."""


def _useless(report: Mapping[str, Any]) -> Iterator[Finding]:
    if report["samples"] and not report["models"]["valid"]:
        yield Finding("No valid contact model was ever identified: nothing could be predicted.")


def model_lines(report: Mapping[str, Any]) -> list[str]:
    """The last model: the law's numbers, and what a contact map is beside them."""
    if report["parameters"] is None:
        return []
    numbers = parameter_text(report["parameters"], report["standard_errors"])
    lines = ["What was learnt, at the end", f"  law        {numbers}"]
    if report["map"] is not None:
        lines += [f"{'':<13}({IDLE_LAW})"] if law_is_idle(report["map"]) else []
        lines += [f"  map        {line}" for line in map_lines(report["map"])]
    return [*lines, ""]


def law_is_idle(figures: Mapping[str, Any]) -> bool:
    """Whether the law's fraction in the figures of a `foretouch.models.MapSummary` is 0 % as printed."""
    return f"{100.0 * figures['shares'].get('law', 1.0):.0f}" == "0"


def map_lines(figures: Mapping[str, Any]) -> list[str]:
    """A contact map, by its `foretouch.models.MapSummary.figures`, as lines for a terminal.

    Weights of the experts and the region visited; local stiffness; uncertainty.
    """
    weights = ", ".join(f"{name} {100.0 * weight:.0f} %" for name, weight in figures["shares"].items())
    depth, speed = 1e3 * figures["depth_visited_m"], 1e3 * figures["speed_visited_m_per_s"]
    lines = [f"weights: {weights}; visited: {figure(depth)} mm, {figure(speed)} mm/s"]
    at = zip(figures["depths_m"], figures["local_stiffness_N_per_m"], figures["forces_N"], strict=True)
    points = [f"{figure(k)} N/m at {figure(1e3 * x)} mm ({figure(force)} N)" for x, k, force in at]
    if points:
        lines.append(f"at rest: {', '.join(points)}")
    if any(k < 0.0 for k in figures["local_stiffness_N_per_m"]):
        falls = "where the stiffness is negative the map's force falls with depth: too few presses, or it gives way"
        lines.append(falls)
    if figures["standard_deviation_N"] is not None:
        lines.append(f"standard deviation of the last force in contact: {number(figures['standard_deviation_N'], 'N')}")
    return lines


def _parameters(view: View) -> Iterator[Drawing]:
    models = view.log.models
    if any(model.law in LAWS for model in models):
        yield Drawing(model_figure(models, view.start_ns, view.away), "Identified parameters over time")


def model_figure(models: tuple[ModelUpdate, ...], start_ns: int, segments: Sequence[Segment] = ()) -> Any:
    """Identified parameters of the most frequent known law, each in own axes; the layout of the paper's Fig. 10."""
    laws = [model.law for model in models if model.law in LAWS]
    law = max(sorted(set(laws)), key=laws.count)
    shown = [model for model in models if model.law == law]
    names = LAWS[law].parameter_names
    time = np.array([(model.time_ns - start_ns) * 1e-9 for model in shown])
    valid = np.array([model.valid for model in shown])
    rows = (len(names) + 1) // 2
    figure = new_figure(1.0 + 2.3 * rows)
    grid = figure.subplots(rows, 2, squeeze=False, sharex=True)
    for column, name in enumerate(names):
        axes = grid.flat[column]
        values = np.array([model.parameters[column] for model in shown])
        kept = extremes(np.where(valid, values, np.nan))
        drawn = np.where(valid, values, np.nan)[kept]
        axes.plot(time[kept], drawn, color=PREDICTED, linewidth=1.2, label="valid")
        if not valid.all():
            dots = np.flatnonzero(~valid)[extremes(values[~valid], NARROW)]
            axes.plot(time[dots], values[dots], ".", color=ERROR, markersize=3.0, label="not valid")
        _robust_range(axes, values[valid] if valid.any() else values)
        mark(axes, segments)
        symbol, unit = next(((one.symbol, one.unit) for one in QUANTITIES if one.name == name), ("", "SI"))
        axes.set_title(f"{name} [{unit}]" if symbol in ("", name) else f"{name} {symbol} [{unit}]")
    for axes in grid.flat[len(names) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    legend(grid.flat[0], columns=4)
    figure.suptitle(f"Identified parameters: {law}", y=1.0 - 0.25 / figure.get_figheight(), va="center")
    return finished(figure, rows, above=0.95, gap=0.6)


def _robust_range(axes: Any, values: Array) -> None:
    """Let the outermost hundredths go beyond the axis where they would flatten the rest, with a note."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    low, high = np.percentile(finite, [2.0, 98.0])
    room = 0.25 * (high - low) or 0.1 * max(abs(high), 1e-9)
    low, high = low - room, high + room
    outside = 100.0 * float(np.mean((finite < low) | (finite > high)))
    if outside > 0.0:
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2.0}
        text = f"{outside:.2g} % beyond the axis"
        note(axes, 0.99, 0.03, text, ha="right", va="bottom", fontsize="small", bbox=box)
    else:
        low, high = min(low, finite.min()), max(high, finite.max())
    axes.set_ylim(low, high)


MODEL = Section("model", _useless, model_lines, _parameters)

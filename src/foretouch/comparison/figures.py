"""The figures of a comparison: a matrix with a number for every combination and recording, and error against delay."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from foretouch.comparison.result import NEVER, Prediction, Result, middle
from foretouch.identification import DEFAULT_ESTIMATORS
from foretouch.quantities import Array
from foretouch.report import finished, new_figure
from foretouch.report.drawing import COLOURS, PREDICTED, RENDERED, TRUE

MOST_RECORDINGS = 16
"""Largest number of recordings in the figures of a page, which would grow without bound; its tables have all."""


def matrix_figure(
    results: Sequence[Result],
    figure_of: Callable[[Result], float | None],
    title: str,
    *,
    first_row: tuple[str, Callable[[Result], float | None]] | None = None,
    limits: tuple[float, float] = (1.0, 100.0),
) -> Any:
    """A number for each combination (rows) and recording (columns), coloured on a logarithmic scale between the limits.

    The number is None where there is none, infinite where it was never reached; its size is coloured. The first row is
    above all others: its name, and the number whose median over the combinations it shows.
    """
    names = list(dict.fromkeys(result.recording for result in results))
    pairs = list(dict.fromkeys((result.model, result.estimator) for result in results))
    values = np.full((len(pairs), len(names)), np.nan)
    texts = [["-"] * len(names) for _ in pairs]
    for result in results:
        row, column = pairs.index((result.model, result.estimator)), names.index(result.recording)
        value = None if result.status != "ok" else figure_of(result)
        values[row, column] = np.nan if value is None else abs(value)
        texts[row][column] = "failed" if result.status != "ok" else _short(value)
    labels = [f"{model} / {estimator}" for model, estimator in pairs]
    if first_row is not None:
        label, above = first_row
        medians = [middle([above(r) for r in results if r.recording == name and r.status == "ok"]) for name in names]
        values = np.vstack([[np.nan if value is None else value for value in medians], values])
        texts, labels = [[_short(value) for value in medians], *texts], [label, *labels]
    return _draw(values, texts, labels, short_names(names), title, limits)


def _draw(
    values: Array, texts: list[list[str]], labels: list[str], names: list[str], title: str, limits: tuple[float, float]
) -> Any:
    low, high = np.log(limits)
    figure = new_figure(1.9 + 0.27 * len(labels))
    axes = figure.subplots()
    shade = np.clip((np.log(np.maximum(values, 1e-12)) - low) / (high - low), 0.0, 1.0)
    shade = np.where(np.isnan(values), np.nan, shade)
    axes.imshow(np.ma.masked_invalid(shade), cmap="YlOrRd", vmin=0.0, vmax=1.15, aspect="auto")
    size = 8.5 if len(names) <= 10 else 7.0 if len(names) <= 16 else 5.5
    for row, line in enumerate(texts if len(names) <= MOST_RECORDINGS else ()):  # of more no number could be read
        for column, text in enumerate(line):
            dark = np.isfinite(shade[row, column]) and shade[row, column] > 0.75
            colour = "white" if dark else "0.45" if text in ("failed", "-") else "black"
            axes.text(column, row, text, ha="center", va="center", fontsize=size, color=colour)
    every = -(-len(names) // MOST_RECORDINGS)
    axes.set_xticks(range(0, len(names), every), names[::every], rotation=35, ha="right", fontsize="small")
    axes.set_yticks(range(len(labels)), labels, fontsize="small")
    axes.set(title=title, xlabel="recording", ylabel="law / estimator")
    finished(figure, 1)
    axes.grid(False)
    axes.spines[["bottom", "left"]].set_visible(False)
    axes.tick_params(length=0)
    height = figure.get_figheight()
    figure.subplots_adjust(left=0.32, right=0.99, bottom=1.25 / height, top=1.0 - 0.4 / height)
    return figure


def short_names(names: Sequence[str]) -> list[str]:
    """Names without what all have in common: folder, and the beginning and the ending of the file names."""
    stems = [Path(name).stem if "/" in name or "." in name else name for name in names]
    if len(set(stems)) < len(stems):
        return list(names)
    short = [stem if len(stem) <= 24 else f"...{stem[-21:]}" for stem in stems]
    return stems if len(set(short)) < len(short) else short


def _short(value: float | None) -> str:
    if value is None:
        return "-"
    if np.isinf(value):
        return NEVER
    return f"{value:.0e}" if abs(value) >= 1e4 else f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


Pair = tuple[str, str]
Key = TypeVar("Key")

JND: Final = (7.0, 10.0)  # Just noticeable difference of two forces felt by a hand [%]

COLUMNS: Final = 3
PROMINENT: Final[dict[Pair, tuple[str, str]]] = {
    ("continuous-switching", "fprls"): (COLOURS[1], "paper"),
    ("continuous-switching", "exact"): (PREDICTED, "exact"),
    ("contact-map", DEFAULT_ESTIMATORS.get("contact-map", "contact-map")): (RENDERED, "map"),
}
"""Laws and estimators drawn prominently, with colour and short name: the paper's, its exact form, and the map."""

LAW_COLOURS: Final = {
    "continuous-switching": "#8c8c8c",
    "kelvin-voigt": "#CC79A7",
    "hunt-crossley": "#56B4E9",
    "contact-map": RENDERED,
}
"""Colours of the laws, for thin curves and floors."""
OTHER_COLOUR: Final = COLOURS[3]
JND_COLOUR: Final = "#f0e9c8"
LOWEST: Final = 0.2  # Smallest error on the panels [%]
LABEL_HEIGHT: Final = 0.075  # Height of a curve's name as a fraction of the panel's height


class Curve(NamedTuple):
    """Errors against delays.

    Attributes:
        delay: [s], increasing, shape (n,).
        error: [% of the contact-force RMS], NaN where there is none, shape (n,).
    """

    delay: Array
    error: Array


def delay_curves(results: Sequence[Result]) -> dict[Pair, Curve]:
    """Prediction error of each law and estimator, by law and estimator; the median where there are several recordings.

    Failed results are left out, and on simulated recordings the samples that nothing before t - delay could tell.
    """
    return _curves(results, "prediction_error_percent")


def floors(results: Sequence[Result]) -> dict[Pair, Curve]:
    """Error of each fit of the whole file, which knows no delay, by law and estimator; else as `delay_curves`."""
    fits = [row for row in results if any(p.whole_file_error_percent is not None for p in row.predictions)]
    return _curves(fits, "whole_file_error_percent")


def delayed_force_curve(results: Sequence[Result]) -> Curve:
    """Error of the delayed force: the median over all results, for each is scored on samples of its own too."""
    return _curve(results, "delayed_force_error_percent")


def delay_figure(results: Sequence[Result], title: str = "Prediction error against delay") -> Any:
    """Small multiples: the median over all recordings, if there are several, and each of the first `MOST_RECORDINGS`.

    Ceiling is the delayed force, floors are the fits of whole files. The delay has a scale of square roots, so
    that 0 is on it and short delays are apart. Curves that leave the panel above are far beyond the delayed force.

    Results are as `compare` gave them, with at least two delays in one that did not fail. A MissingExtraError says that
    Matplotlib is not installed.
    """
    drawn = [row for row in results if row.status == "ok" and row.predictions]
    recordings = _by(drawn, lambda row: row.recording)
    panels = dict(zip(short_names(list(recordings)), recordings.values(), strict=True))
    if len(panels) > 1:
        first = dict(list(panels.items())[:MOST_RECORDINGS])
        panels = {f"median of {len(panels)} recordings": drawn, **first}
    rows = math.ceil(len(panels) / COLUMNS)
    limits = _limits(drawn)
    handles = _handles(list(delay_curves(drawn)), bool(floors(drawn)))
    above = 0.75 + 0.2 * math.ceil(len(handles) / COLUMNS)
    figure = new_figure(above + 2.75 * rows)
    axes = figure.subplots(rows, min(COLUMNS, len(panels)), squeeze=False).ravel()
    for index, (panel, (name, chosen)) in enumerate(zip(axes, panels.items(), strict=False)):
        _draw_panel(panel, chosen, limits)
        panel.set_title(name)
        if index % COLUMNS == 0:
            panel.set_ylabel("error [% of contact RMS]")
        if index + COLUMNS >= len(panels):
            panel.set_xlabel("delay of the forces [ms]")
    for panel in axes[len(panels) :]:
        panel.remove()
    height = figure.get_figheight()
    figure.suptitle(title, x=0.08, y=1.0 - 0.12 / height, ha="left", va="top", fontweight="bold")
    corner = (0.07, 1.0 - 0.33 / height)
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=corner, ncols=COLUMNS, frameon=False, fontsize="small"
    )
    return finished(figure, rows, above=above, gap=0.6, right=0.90, between=0.44)


def _error(prediction: Prediction, name: str) -> float | None:
    """The error of this name; on a simulated recording that of the foreseeable samples."""
    prefix = "" if prediction.unforeseeable_percent is None else "foreseeable_"
    error: float | None = getattr(prediction, prefix + name)
    return error


def _curves(results: Sequence[Result], name: str) -> dict[Pair, Curve]:
    predicted = [row for row in results if row.predictions]
    return {pair: _curve(rows, name) for pair, rows in _by(predicted, lambda row: (row.model, row.estimator)).items()}


def _curve(rows: Sequence[Result], name: str) -> Curve:
    columns: dict[float, list[float | None]] = {}
    for row in rows:
        for prediction in row.predictions:
            columns.setdefault(prediction.delay_s, []).append(_error(prediction, name))
    delays = sorted(columns)
    return Curve(np.array(delays), np.array([middle(columns[delay]) for delay in delays], dtype=np.float64))


def _by(results: Sequence[Result], key_of: Callable[[Result], Key]) -> dict[Key, list[Result]]:
    groups: dict[Key, list[Result]] = {}
    for row in results:
        groups.setdefault(key_of(row), []).append(row)
    return groups


def _draw_panel(panel: Any, results: Sequence[Result], limits: tuple[float, float]) -> None:
    panel.set_xscale("function", functions=(_root, lambda root: np.sign(root) * np.square(root)))
    panel.set_yscale("log")
    panel.axhspan(*JND, color=JND_COLOUR, linewidth=0.0, zorder=0)
    labels: list[tuple[float, str, str]] = []

    def line(curve: Curve, colour: str, label: str | None = None, **style: Any) -> None:
        none = curve.error < 1e-6  # on a logarithmic scale nowhere: shown as just below the panel
        shown = np.where(none, 0.9 * limits[0], curve.error)
        panel.plot(1e3 * curve.delay, shown, color=colour, **style)
        known = shown[np.isfinite(shown)]
        if label is not None and known.size:
            beyond = shown > limits[1]
            panel.plot(1e3 * curve.delay[beyond], np.full(beyond.sum(), limits[1]), "^", color=colour, clip_on=False)
            labels.append((float(known[-1]), label, colour))

    for (model, _), curve in floors(results).items():
        line(curve, _law_colour(model), linestyle=(0, (4, 2)), linewidth=0.9)
    lowest = _lowest(floors(results))
    if lowest is not None:
        line(lowest, TRUE, "floor", linestyle=(0, (4, 2)), linewidth=1.3)
    curves = delay_curves(results)
    for pair, curve in curves.items():
        if pair not in PROMINENT:
            line(curve, _law_colour(pair[0]), linewidth=0.8, alpha=0.8)
    line(delayed_force_curve(results), TRUE, "delayed", linewidth=2.2)
    for pair, (colour, label) in PROMINENT.items():
        if pair in curves:
            line(curves[pair], colour, label, linewidth=2.0, marker="o", markersize=3.5)
    delays = 1e3 * delayed_force_curve(results).delay
    panel.set(xlim=(delays[0], delays[-1]), ylim=limits)
    _ticks(panel, delays)
    _name(panel, labels, limits)


def _root(delay: Array) -> Array:
    """Square root, odd: an empty panel has delays below 0 before its limits are set."""
    return np.sign(delay) * np.sqrt(np.abs(delay))


def _lowest(curves: Mapping[Pair, Curve]) -> Curve | None:
    known = [curve for curve in curves.values() if np.isfinite(curve.error).any()]
    return min(known, key=lambda curve: float(np.nanmedian(curve.error)), default=None)


def _limits(results: Sequence[Result]) -> tuple[float, float]:
    """Limits of the errors on all panels [%]: curves far beyond the delayed force must not press the others flat."""
    late = [prediction for row in results for prediction in row.predictions if prediction.delay_s > 0.0]
    errors = [_error(p, name) for p in late for name in ("prediction_error_percent", "whole_file_error_percent")]
    ceiling = float(np.nanmax(delayed_force_curve(results).error, initial=100.0))
    return max(LOWEST, 0.8 * min([JND[0], *(error for error in errors if error is not None)])), 1.5 * ceiling


def _ticks(panel: Any, delays: Array) -> None:
    """Names of the delays, as many as do not overlap."""
    span = math.sqrt(delays[-1])
    kept = [float(delays[-1])]
    for delay in reversed(delays[:-1].tolist()):
        if math.sqrt(kept[-1]) - math.sqrt(delay) > 0.13 * span:
            kept.append(delay)
    panel.set_xticks(kept, [f"{delay:g}" for delay in kept], fontsize="small")
    panel.minorticks_off()
    low, high = panel.get_ylim()
    marks = [mark for mark in (0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if low <= mark <= high]
    panel.set_yticks(marks, [f"{mark:g}" for mark in marks], fontsize="small")


def _name(panel: Any, labels: Sequence[tuple[float, str, str]], limits: tuple[float, float]) -> None:
    """The prominent curves' names right of their ends, moved apart where they would overlap."""
    low, high = np.log(limits)
    upwards = sorted(labels)
    heights = [(math.log(min(max(error, limits[0]), limits[1])) - low) / (high - low) for error, _, _ in upwards]
    for index in range(1, len(heights)):
        heights[index] = max(heights[index], heights[index - 1] + LABEL_HEIGHT)
    heights[-1:] = [min(height, 1.0) for height in heights[-1:]]
    for index in reversed(range(len(heights) - 1)):
        heights[index] = min(heights[index], heights[index + 1] - LABEL_HEIGHT)
    for height, (_, label, colour) in zip(heights, upwards, strict=True):
        panel.text(1.03, height, label, color=colour, transform=panel.transAxes, va="center", fontsize="small")


def _law_colour(model: str) -> str:
    return LAW_COLOURS.get(model, OTHER_COLOUR)


def _handles(pairs: Sequence[Pair], with_floors: bool) -> list[Any]:
    lines, patches = import_module("matplotlib.lines"), import_module("matplotlib.patches")
    shown = [lines.Line2D([], [], color=TRUE, linewidth=2.2, label="delayed force: the ceiling")]
    for pair, (colour, _) in PROMINENT.items():
        if pair in pairs:
            shown.append(lines.Line2D([], [], color=colour, linewidth=2.0, marker="o", label=" / ".join(pair)))
    others = [pair for pair in pairs if pair not in PROMINENT]
    for model in dict.fromkeys(model for model, _ in others):
        names = [name for law, name in others if law == model]
        label = f"{model} / {names[0]}" if len(names) == 1 else f"{model}, {len(names)} others"
        shown.append(lines.Line2D([], [], color=_law_colour(model), linewidth=0.8, label=label))
    if with_floors:
        shown.append(
            lines.Line2D([], [], color=TRUE, linestyle=(0, (4, 2)), linewidth=1.3, label="fit of the whole file: floor")
        )
    shown.append(patches.Patch(color=JND_COLOUR, label=f"a hand tells apart from {JND[0]:g} to {JND[1]:g} %"))
    return shown

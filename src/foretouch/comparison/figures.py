"""The plots of a comparison that show a number for every combination and recording, as matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.comparison.result import NEVER, Result, middle
from foretouch.report import finished, new_figure

Array = NDArray[np.float64]

MOST_RECORDINGS = 16
"""Of more recordings the figures of a page would grow without bound: the rest stands in its tables."""


def matrix_figure(
    results: Sequence[Result],
    figure_of: Callable[[Result], float | None],
    title: str,
    *,
    first_row: tuple[str, Callable[[Result], float | None]] | None = None,
    limits: tuple[float, float] = (1.0, 100.0),
) -> Any:
    """A number for each combination (rows) and recording (columns), coloured on a logarithmic scale.

    Args:
        results: As `compare` gave them.
        figure_of: The number, None where there is none, infinite where it was never reached; its size is coloured.
        title: What the numbers are, with unit.
        first_row: Name of a row above all others, and what its median over the combinations is taken of.
        limits: Numbers at the ends of the colours, positive.
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
    axes.set_title(title)
    axes.set_xlabel("recording")
    axes.set_ylabel("law / estimator")
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

"""The drawing of Fig. 10."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.report import COLOURS, finished, new_figure
from foretouch.reproduction.experiment import Array, History

ESTIMATOR_COLOURS = {"printed": COLOURS[4], "choice": COLOURS[3], "robust": COLOURS[0], "exact": COLOURS[2]}
"""Of the estimators, in Fig. 10 and Fig. 11 alike; black and vermillion are left for true and delayed force."""

ROWS = (
    ("k", "k [N/m$^s$]", (1e1, 1e8)),
    ("s", "s [-]", (-1.0, 5.0)),
    ("b1", "$b_1$ [s/m]", (-40.0, 40.0)),
    ("b2", "$b_2$ [s]", (-0.5, 0.5)),
    ("damping", "$\\lambda$ [N s/m$^{n+1}$]", (1e1, 1e7)),
    ("exponent", "n [-]", (-0.5, 2.5)),
    ("switching", "$\\alpha$ [-]", (-0.05, 1.05)),
)
"""Parameter, label, and the range that is drawn: the same for all materials, so that they can be compared."""

LOGARITHMIC = ("k", "damping")
LONGEST_LINE = 0.1
"""Notes further apart than this are not joined [s]: nothing was learnt between."""


def parameters_figure(
    courses: Mapping[str, Sequence[History]], labels: Sequence[str], deepest: Mapping[str, Sequence[float]]
) -> Any:
    """Materials side by side, parameters one below the other, over time; grey lines where the probe is deepest.

    Args:
        courses: By material, one of each estimator.
        labels: Of the estimators.
        deepest: By material, times of greatest depth [s].
    """
    figure = new_figure(13.5)
    grid = figure.subplots(len(ROWS), len(courses), sharex=True, sharey="row")
    for column, (material, histories) in enumerate(courses.items()):
        for row, (name, label, limits) in enumerate(ROWS):
            axes = grid[row][column]
            for time in deepest[material]:
                axes.axvline(time, color="0.75", linewidth=0.8)
            for history, colour, estimator in zip(histories, ESTIMATOR_COLOURS.values(), labels, strict=True):
                axes.plot(*_line(history, name), label=estimator, color=colour, linewidth=1.2)
            if name in LOGARITHMIC:
                axes.set_yscale("log")
            axes.set_ylim(*limits)
            if column == 0:
                axes.set_ylabel(label)
            if row == 0:
                axes.set_title(f"({'abc'[column]}) {material.capitalize()}")
            if row == len(ROWS) - 1:
                axes.set_xlabel("time [s]")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=2)
    return finished(figure, len(ROWS), above=0.95, gap=0.25, between=0.08)


def _line(history: History, name: str) -> tuple[Array, Array]:
    """Time and values, broken where nothing was learnt."""
    time = history["time"]
    with np.errstate(over="ignore"):
        values = np.exp(history["ln_k"]) if name == "k" else history[name]
    breaks = np.flatnonzero(np.diff(time) > max(LONGEST_LINE, 1.5 * float(np.median(np.diff(time))))) + 1
    return np.insert(time, breaks, np.nan), np.insert(values, breaks, np.nan)

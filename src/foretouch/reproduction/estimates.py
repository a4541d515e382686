"""What the figures of estimated parameters have in common: four panels over the iterations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import Brief
from foretouch.report import finished, new_figure
from foretouch.reproduction.presses import Trace
from foretouch.reproduction.section import Table

Array = NDArray[np.float64]

PANELS = (("k", "k [N/m$^s$]"), ("s", "s"), ("b1", "b$_1$ [s/m]"), ("b2", "b$_2$ [s]"))
"""Attribute and axis of each panel, in the paper's order."""


@dataclass(frozen=True, eq=False)
class Curve(Brief):
    """One line in all four panels.

    Attributes:
        label: In the legend.
        values: k, s, b1 and b2 at each iteration, shape (4, m).
        colour: Of the line.
        style: Of the line, as Matplotlib names it.
        width: Of the line [points].
    """

    label: str
    values: Array
    colour: str
    style: str = "-"
    width: float = 1.4

    @classmethod
    def of(cls, label: str, trace: Trace, colour: str, style: str = "-") -> Curve:
        """From what an estimator found."""
        return cls(label, np.array([trace.k, trace.s, trace.b1, trace.b2]), colour, style)


def parameter_figure(
    curves: Sequence[Curve],
    limits: Sequence[tuple[float, float]],
    *,
    iterations: Array | None = None,
    axis: str = "iteration",
) -> Any:
    """k, s, b1 and b2 in two rows, as in the paper's Fig. 7; what leaves the limits is cut.

    Args:
        curves: To draw, all of one length.
        limits: Of the four vertical axes.
        iterations: Horizontal values; by default 1, 2, 3 ...
        axis: What they are.
    """
    figure = new_figure(6.4)
    grid = figure.subplots(2, 2, sharex=True)
    across = np.arange(1, curves[0].values.shape[1] + 1) if iterations is None else iterations
    for index, (axes, (name, label)) in enumerate(zip(grid.flat, PANELS, strict=True)):
        for curve in curves:
            axes.plot(
                across,
                curve.values[index],
                color=curve.colour,
                linestyle=curve.style,
                linewidth=curve.width,
                label=curve.label,
            )
        axes.set_ylim(*limits[index])
        axes.set_xlim(float(across[0]), float(across[-1]))
        axes.set_ylabel(label)
        axes.set_title({"k": "Stiffness", "s": "Exponent s = n + alpha", "b1": "b$_1$", "b2": "b$_2$"}[name])
        if index > 1:
            axes.set_xlabel(axis)
    handles, labels = grid.flat[0].get_legend_handles_labels()
    columns = 3 if len(curves) > 4 else len(curves)
    figure.legend(handles, labels, loc="upper center", ncols=columns, frameon=False, fontsize="small")
    return finished(figure, 2, above=0.55 + 0.2 * -(-len(curves) // columns), gap=0.5)


def parameter_table(trace: Trace, truth: Array) -> Table:
    """An estimate beside the truth."""
    return {
        "iteration": np.arange(1, trace.k.size + 1),
        "k": trace.k,
        "s": trace.s,
        "b1_s_m": trace.b1,
        "b2_s": trace.b2,
        "true_k": truth[0],
        "true_s": truth[1],
        "true_b1_s_m": truth[2],
        "true_b2_s": truth[3],
        "force_N": trace.force,
        "force_ahead_N": trace.ahead,
    }

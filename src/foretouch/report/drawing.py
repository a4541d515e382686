"""What every figure here has in common: size, colours, legends and margins; no global state is touched."""

from __future__ import annotations

import importlib
from typing import Any

from foretouch.errors import MissingExtraError

__all__ = ["COLOURS", "DELAYED", "ERROR", "PREDICTED", "RENDERED", "TRUE", "finished", "legend", "new_figure"]

TRUE, PREDICTED, DELAYED, RENDERED, ERROR = "#000000", "#0072B2", "#E69F00", "#009E73", "#D55E00"
"""Okabe and Ito's colours, which the colour-blind tell apart, by what they stand for in a session."""

COLOURS = (PREDICTED, ERROR, RENDERED, DELAYED, "#CC79A7", "#56B4E9", TRUE)
"""The same colours for curves that stand in a row."""


def new_figure(height: float) -> Any:
    """An empty figure, 10 inches wide.

    Args:
        height: [inches].

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    try:
        figure = importlib.import_module("matplotlib.figure")
    except ModuleNotFoundError:
        raise MissingExtraError("matplotlib", "report") from None
    return figure.Figure(figsize=(10.0, height))


def legend(axes: Any, columns: int) -> None:
    """A legend between title and plot, where it hides nothing."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        frameon=False,
        fontsize="small",
        columnspacing=1.2,
        handlelength=1.6,
        borderaxespad=0.2,
    )
    axes.set_title(axes.get_title(), pad=22.0)


def finished(
    figure: Any, rows: int, *, above: float = 0.6, gap: float = 0.85, right: float = 0.985, between: float = 0.2
) -> Any:
    """Place the axes by hand: the automatic layouts draw everything twice.

    Args:
        figure: With its axes drawn.
        rows: Of axes.
        above: Room above the first row [inches].
        gap: Between rows [inches].
        right: Right end of the axes, as a share of the width.
        between: Between columns, as a share of their width.

    Returns:
        The figure.
    """
    height = figure.get_figheight()
    below = 0.55
    row = (height - above - below - (rows - 1) * gap) / rows
    figure.subplots_adjust(
        left=0.08, right=right, bottom=below / height, top=1.0 - above / height, hspace=gap / row, wspace=between
    )
    for axes in figure.axes:
        axes.grid(alpha=0.3, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.title.set_fontsize("medium")
        axes.title.set_fontweight("bold")
    return figure

"""What every figure here has in common: size, colours, legends and margins; no global state is touched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import colours, columns
from foretouch.report.statuses import Stretch
from foretouch.report.writing.thinning import corners, joined

TRUE, PREDICTED, DELAYED, RENDERED, ERROR = (
    colours.css(colour)
    for colour in (colours.TRUE, colours.PREDICTED, colours.DELAYED, colours.RENDERED, colours.WRONG)
)
"""By what they stand for in a session."""

COLOURS = columns.COLOURS
"""For curves that stand in a row."""


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
    rows = -(-len(axes.get_legend_handles_labels()[1]) // columns)
    axes.set_title(axes.get_title(), pad=22.0 + 13.0 * max(rows - 1, 0))


def shade(axes: Any, time: NDArray[np.float64], flags: NDArray[np.bool_], colour: str, label: str) -> None:
    """Shade the times at which a flag is set, over the whole height."""
    if not flags.any():
        return
    when, inside = corners(time, flags)
    axes.fill_between(
        when,
        0.0,
        1.0,
        where=inside,
        transform=axes.get_xaxis_transform(),
        color=colour,
        alpha=0.15,
        linewidth=0.0,
        label=label,
    )


def mark(axes: Any, stretches: Sequence[Stretch]) -> None:
    """Hatch the times in which the robot was not where the commands said, within what the axes show.

    Args:
        axes: With the curves drawn.
        stretches: In the axes' own time.
    """
    begin, end = sides = axes.get_xlim()
    for failing, (label, hatch, colour) in _MARKS.items():
        seen = [one[:2] for one in stretches if one.failing == failing and one.end >= begin and one.begin <= end]
        spans = joined(np.array(sorted(seen)).reshape(-1, 2), end - begin)
        for number, span in enumerate(np.clip(spans, begin, end).tolist()):
            axes.axvspan(
                *span,
                facecolor=(0.5, 0.5, 0.5, 0.12),
                edgecolor=colour,
                hatch=hatch,
                linewidth=0.0,
                zorder=0.5,
                label=label if number == 0 else None,
            )
    axes.set_xlim(sides)


_MARKS = {False: ("not following", "\\\\\\", "0.65"), True: ("faulty sensors", "///", colours.css(colours.PURPLE))}
"""Legend, hatch and its colour, by whether the sensors failed."""


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

"""Common parts of all figures: colours, legends, margins, and no more points than can be seen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import Array, Flags, colours, columns
from foretouch.report.numbers import largest
from foretouch.report.rows import Segment

TRUE, PREDICTED, DELAYED, RENDERED, ERROR = (
    colours.css(colour)
    for colour in (colours.TRUE, colours.PREDICTED, colours.DELAYED, colours.RENDERED, colours.WRONG)
)
"""Colours by their meaning in a session."""

COLOURS = columns.COLOURS
"""Colours of curves in a row."""


def legend(axes: Any, columns: int) -> None:
    """A legend between title and plot, where it hides nothing."""
    style = {"frameon": False, "fontsize": "small", "columnspacing": 1.2, "handlelength": 1.6, "borderaxespad": 0.2}
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, **style)
    rows = -(-len(axes.get_legend_handles_labels()[1]) // columns)
    axes.set_title(axes.get_title(), pad=22.0 + 13.0 * max(rows - 1, 0))


def shade(axes: Any, time: Array, flags: Flags, colour: str, label: str) -> None:
    """Shade the times at which a flag is set, over the whole height."""
    if not flags.any():
        return
    when, inside = corners(time, flags)
    style = {"color": colour, "alpha": 0.15, "linewidth": 0.0, "label": label}
    axes.fill_between(when, 0.0, 1.0, where=inside, transform=axes.get_xaxis_transform(), **style)


def mark(axes: Any, segments: Sequence[Segment]) -> None:
    """Hatch the times in which the robot was not at its commanded position, within what the axes show."""
    begin, end = sides = axes.get_xlim()
    for failing, (label, hatch, colour) in _MARKS.items():
        seen = [one[:2] for one in segments if one.failing == failing and one.end >= begin and one.begin <= end]
        spans = joined(np.array(sorted(seen)).reshape(-1, 2), end - begin)
        style = {"facecolor": (0.5, 0.5, 0.5, 0.12), "edgecolor": colour, "hatch": hatch, "linewidth": 0.0}
        for number, span in enumerate(np.clip(spans, begin, end).tolist()):
            axes.axvspan(*span, **style, zorder=0.5, label=label if number == 0 else None)
    axes.set_xlim(sides)


_MARKS = {False: ("not following", "\\\\\\", "0.65"), True: ("faulty sensors", "///", colours.css(colours.PURPLE))}
"""Legend, hatch and its colour, by whether the sensors failed."""


def finished(
    figure: Any, rows: int, *, above: float = 0.6, gap: float = 0.85, right: float = 0.985, between: float = 0.2
) -> Any:
    """Place the axes by hand, with room above the first row and between rows [inches]; returns the figure.

    The automatic layouts draw everything twice. The right end of the axes and the gap between columns are fractions of
    the figure's and of a column's width.
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


def peak(values: Array) -> float:
    """The largest finite value, 0 where there is none: to where axes reach."""
    return largest(values) or 0.0


def last_contact(time: Array, force: Array, length: float) -> tuple[float, float]:
    """Begin and end of a close-up of the last contact [s], a tenth longer than the length: the estimate has settled."""
    touched = np.flatnonzero(force > 0.2 * peak(force))
    begin = max(float(time[touched[-1] if touched.size else -1]) - length, float(time[0]))
    return begin, begin + 1.1 * length


GAP, GAP_PERIODS = 0.05, 10.0
"""Times further apart than this [s], and than this many usual periods, are not joined by a line."""

NARROW = 500  # Part of the time shown below which two marks are not distinguished


def extremes(values: Array, buckets: int = 1500) -> NDArray[np.intp]:
    """Indices of the lowest and the highest sample of each bucket, in order: with them every peak is drawn.

    A bucket without a number has one index, so that a hole in a curve stays one; with at most two samples in each, all
    are kept.
    """
    size = -(-values.size // buckets)
    if size <= 2:
        return np.arange(values.size)
    finite = np.isfinite(values)
    low, high = np.where(finite, values, np.inf), np.where(finite, values, -np.inf)
    kept = [
        start + int(index)
        for start in range(0, values.size, size)
        for index in sorted({low[start : start + size].argmin(), high[start : start + size].argmax()})
    ]
    return np.array(kept, dtype=np.intp)


def thinned(time: Array, values: Array, buckets: int = 1500) -> tuple[Array, Array]:
    """Lowest and highest sample of each bucket, in order: the same picture with fewer points.

    In a gap of time there is one that is no number, so that no line is drawn over it; of more gaps than buckets the
    longest are kept.
    """
    kept = extremes(values, buckets)
    periods = np.diff(time)
    if not periods.size:
        return time[kept], values[kept]
    gaps = np.flatnonzero(periods > max(GAP, GAP_PERIODS * float(np.median(periods))))
    if gaps.size > buckets:
        gaps = np.sort(gaps[np.argsort(periods[gaps])[-buckets:]])
    indices = np.searchsorted(time[kept], time[gaps], side="right")
    return np.insert(time[kept], indices, time[gaps]), np.insert(values[kept], indices, np.nan)


def curve(axes: Any, time: Array, values: Array, colour: str, width: float, **style: Any) -> None:
    """Draw one curve, with no more points than can be seen."""
    axes.plot(*thinned(time, values), color=colour, linewidth=width, **style)


def note(axes: Any, x: float, y: float, text: str, **style: Any) -> None:
    """Write at a position in fractions of the axes, centred unless the style says otherwise."""
    axes.text(x, y, text, transform=axes.transAxes, **{"ha": "center", "va": "center", **style})


def joined(spans: Array, shown: float) -> Array:
    """Spans of time by their begin [s], shape (n, 2), joined where too near to be distinguished over what is shown."""
    if not len(spans):
        return spans
    ends = np.maximum.accumulate(spans[:, 1])
    cuts = np.flatnonzero(spans[1:, 0] - ends[:-1] > shown / NARROW)
    return np.column_stack((spans[np.append(0, cuts + 1), 0], ends[np.append(cuts, -1)]))


def corners(time: Array, flags: Flags) -> tuple[Array, Flags]:
    """The corners of a flag: of each span its begin and its end, and its end once more without the flag."""
    changes = np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))
    begin, end = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0) - 1
    spans = joined(np.column_stack((time[begin], time[end])), float(np.ptp(time)) if time.size else 0.0)
    return np.column_stack((spans, spans[:, 1])).ravel(), np.tile([True, True, False], len(spans))

"""Plots over time, and the tables of numbers beside them: one look for all."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from foretouch.console.history import NAN, Array
from foretouch.quantities.colours import Colour, css, faint

SECONDS = 6.0  # Length of all plots [s]

WIDTHS, WIDTHS_OF_TWO = ("47%", "28%", "25%"), ("66%", "34%", "0")
"""Widths of a table's columns, with heads and without: it keeps them whatever the numbers are."""

DASHES = {"solid": (), "dashed": (6.0, 4.0), "dotted": (2.0, 3.0)}


def put(handle: Any, **values: Any) -> None:
    """Set attributes of a control or a node, those alone that differ: the viewer sends each one that is set."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def handler(action: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A callback for the viewer, which is given the event; async, so that the viewer keeps the order of events."""

    async def handle(event: Any) -> None:
        action(event)

    return handle


def by_person(action: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """The same for a control, whose value a person has changed and not the program."""
    return handler(lambda event: action(event) if event.client is not None else None)


class Curve(NamedTuple):
    """Style of a curve in plot and table: width [pixel], one of `DASHES`, and whether a band goes around it."""

    name: str
    colour: Colour
    width: float = 2.0
    dash: str = "solid"
    band: bool = False


class Row(NamedTuple):
    """One line of a table of numbers, each with its unit, and the curve that shows it in the plot."""

    name: str
    value: str
    curve: Curve | None = None
    more: str = ""


class TimePlot:
    """A plot of the last seconds, of curves from the back to the front.

    It is drawn from `lowest` on, where that is None as far as the curves reach, and at least up to `least`, so that
    noise does not fill the plot. `time` is the text below its time axis.
    """

    def __init__(
        self,
        gui: Any,
        title: str,
        curves: Sequence[Curve],
        *,
        height: int = 150,
        lowest: float | None = 0.0,
        least: float | None = None,
        time: str = "time before now [s]",
    ) -> None:
        self._lowest, self._least = lowest, least
        self._banded = [index for index, curve in enumerate(curves) if curve.band]
        series: list[dict[str, Any]] = [{"label": "time [s]"}]
        series += [_series(curve.name, css(curve.colour), curve.width, DASHES[curve.dash]) for curve in curves]
        bands = []
        for index in self._banded:
            colour = faint(curves[index].colour)
            bands.append({"series": (len(series), len(series) + 1), "fill": colour})
            series += [_series(f"{curves[index].name}, {word}", colour, 1.0, ()) for word in ("more", "less")]
        if least is not None:
            series.append(_series("least range", "transparent", 0.0, ()))
        start = np.array([-SECONDS, 0.0])
        self._plot = gui.add_uplot(
            (start, np.zeros(2), *(np.full(2, NAN),) * (len(series) - 2)),
            tuple(series),
            bands=tuple(bands),
            title=title,
            scales={
                "x": {"time": False, "range": (-SECONDS, 0.0)},
                "y": {"time": False, "range": (lowest, None)} if lowest is not None else {"time": False},
            },
            axes=({"label": time, "labelSize": 18.0, "size": 30.0}, {"size": 50.0}),
            legend={"show": False},
            cursor={"show": False},
            height=height,
            padding=(10, 16, 0, 4),
        )

    def draw(
        self, time: Array, values: Sequence[Array], deviations: Sequence[Array] = (), most: float = math.inf
    ) -> None:
        """Draw the curves at times before now [s], shape (n,), with bands where they have one; NaN is a gap."""
        if not len(time):
            return
        columns = list(values)
        for index, deviation in zip(self._banded, deviations, strict=True):
            spread = np.where(np.isfinite(deviation) & np.isfinite(values[index]), deviation, 0.0)
            middle = np.where(np.isfinite(values[index]), values[index], self._lowest or 0.0)  # it would fill a gap
            columns += [middle + spread, middle - spread]
        if self._least is not None:
            columns.append(np.full(len(time), self._least))
        self._plot.data = (time, *(self._drawable(column, most) for column in columns))

    def _drawable(self, values: Array, most: float) -> Array:
        """Within what is drawn. Where a curve is not known it has a gap, which the page leaves (`gate/page.js`).

        The plot finds no scale for a curve that begins with no number: the first is then what the next one is.
        """
        lowest = -most if self._lowest is None else self._lowest
        drawn: Array = np.where(np.isfinite(values), np.clip(values, lowest, most), NAN)
        if np.isnan(drawn[0]):
            drawn[0] = drawn[1] if len(drawn) > 1 and np.isfinite(drawn[1]) else max(lowest, 0.0)
        return drawn


def _series(label: str, stroke: str, width: float, dash: tuple[float, ...]) -> dict[str, Any]:
    looks = {"label": label, "stroke": stroke, "width": width, "points": {"show": False}}
    return looks | ({"dash": dash} if dash else {})


def number(value: float, unit: str, digits: int = 2) -> str:
    """A number with its unit and this number of digits behind the point; a dash where it is not known."""
    if not math.isfinite(value):
        return "–"
    if abs(value) >= 1e6:
        return f"over {math.copysign(1e6, value):.0f} {unit}"
    text = f"{value:.{digits}f}"
    return f"{text if float(text) else text.lstrip('-')} {unit}"  # nothing is not negative


def inset(content: str, looks: str = "") -> str:
    """A part of the panel, with its margins, in a style."""
    return f'<div style="padding:0 12px{looks}">{content}</div>'


def table(rows: Sequence[Row], heads: tuple[Row, str, str] | None = None) -> str:
    """A table of numbers, with the curves' lines before their names: it is the plot's legend too.

    It has three columns with heads, and two without.
    """
    right = 'td style="text-align:right;white-space:nowrap"'
    head = ""
    if heads is not None:
        first, *others = heads
        cells = "".join(f"<{right}>{text}</td>" for text in others)
        head = f'<tr style="color:#555"><td>{_line(first.curve)} {html.escape(first.name)}</td>{cells}</tr>'
    body = "".join(
        f"<tr><td>{_line(row.curve)} {html.escape(row.name)}</td>"
        f"<{right}><b>{html.escape(row.value)}</b></td><{right}>{html.escape(row.more)}</td></tr>"
        for row in rows
    )
    widths = "".join(f'<col style="width:{width}">' for width in (WIDTHS_OF_TWO if heads is None else WIDTHS))
    return (
        '<table class="foretouch-table" style="width:100%;table-layout:fixed;font-variant-numeric:tabular-nums;'
        f'border-spacing:0 1px;line-height:1.3"><colgroup>{widths}</colgroup>{head}{body}</table>'
    )


def _line(curve: Curve | None) -> str:
    if curve is None:
        return '<svg width="26" height="8"></svg>'
    dash = f' stroke-dasharray="{" ".join(f"{part:g}" for part in DASHES[curve.dash])}"' if DASHES[curve.dash] else ""
    band = f'<rect width="26" height="8" fill="{faint(curve.colour)}"/>' if curve.band else ""
    return (
        f'<svg width="26" height="8">{band}<line x1="0" y1="4" x2="26" y2="4" stroke="{css(curve.colour)}" '
        f'stroke-width="{curve.width + 1.0:g}"{dash}/></svg>'
    )

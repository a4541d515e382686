"""The panel beside the picture: what to do, the plot, the numbers, the delays, the end of the session."""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.console.alarm import Alarm
from foretouch.console.history import Window
from foretouch.console.palette import BLUE, GREY, INK, VERMILLION, css

__all__ = ["INSTRUCTION", "LONGEST_DELAY", "Numbers", "Panel", "felt"]

INSTRUCTION = "Drag the blue handle down to press."
LONGEST_DELAY = 2.0
"""End of the sliders [s]."""
LARGEST_DRAWN = 15.0
"""Forces beyond it [N], the robot's own limit, are drawn there: a model that has diverged would hide the others."""
BELOW = -1.0
"""Where a curve is that is not known: below the plot [N]."""
PRESS_CLUTCH, RELEASE_CLUTCH = "Clutch", "Clutch is pressed: let it go"
END = "End the session"
SMALLEST_APART = 1e-4
"""Hand and probe are said to be apart from here on [m]."""
SECONDS = 6.0
"""Length of the plot [s]."""


class Numbers(NamedTuple):
    """What stands beside the plot; NaN where it is not known.

    Attributes:
        predicted: Force of the newest model at the hand's motion [N].
        delayed: Force of the newest telemetry that had arrived [N].
        true: Newest true force that is known [N].
        true_age: How long ago the hand was there [s].
        rendered: What the hand is given after the clamps [N].
        depth: Of the operator's tip below the surface [m].
        prediction_error: Over the plotted time [%].
        delayed_error: Over the plotted time [%].
        status: One line: what the session is doing.
        names: One line: what is pressed, and what learns it.
        deviation: Standard deviation of `predicted` [N].
        model: Lines about the newest model.
        hand_ahead: How much further in the hand is than the probe [m].
        energy: That the hand has put into this contact [J].
        warnings: Lines in vermillion above all.
    """

    predicted: float
    delayed: float
    true: float
    true_age: float
    rendered: float
    depth: float
    prediction_error: float
    delayed_error: float
    status: str
    names: str
    deviation: float
    model: tuple[str, ...]
    hand_ahead: float = math.nan
    energy: float = math.nan
    warnings: tuple[str, ...] = ()


class Panel:
    """The viewer's panel.

    Args:
        server: The viewer's server.
        on_delays: Called with both one-way delays [s] when a user moves a slider.
        on_clutch: Called with the browser's number when the clutch is pressed or let go there.
        on_end: Called when the session is to end.
        on_emergency: Called when the robot is to stop at once.

    Attributes:
        alarm: The emergency stop and what is urgent.
    """

    def __init__(
        self,
        server: Any,
        on_delays: Callable[[float, float], None],
        on_clutch: Callable[[int | None], None],
        on_end: Callable[[], None],
        on_emergency: Callable[[], None],
    ) -> None:
        self._on_delays = on_delays
        self._on_clutch = on_clutch
        self._on_end = on_end
        gui = server.gui
        gui.set_panel_label("foretouch")
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, brand_color=BLUE)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(460)
        self.alarm = Alarm(gui, on_emergency)  # the first that the keyboard reaches
        self._head = gui.add_html(_head_html(INSTRUCTION, felt("", True)))
        self._plot = _add_plot(gui)
        self._clutch = gui.add_button(PRESS_CLUTCH, color=GREY, hint=_CLUTCH)
        self._numbers = gui.add_html("")
        self._position_delay = gui.add_slider("Delay there [s]", 0.0, LONGEST_DELAY, 0.01, 0.0, hint=_DELAY_THERE)
        self._force_delay = gui.add_slider("Delay back [s]", 0.0, LONGEST_DELAY, 0.01, 0.0, hint=_DELAY_BACK)
        self._end = gui.add_button(END, color=GREY)
        self._model = gui.add_html("")
        self._position_delay.on_update(self._slid)
        self._force_delay.on_update(self._slid)
        self._clutch.on_click(self._clutch_clicked)
        self._end.on_click(self._end_clicked)

    def set_delays(self, position_delay: float, force_delay: float) -> None:
        """Put the sliders where the session is, without telling the session."""
        self._position_delay.value = min(max(position_delay, 0.0), LONGEST_DELAY)
        self._force_delay.value = min(max(force_delay, 0.0), LONGEST_DELAY)

    def plot(self, window: Window) -> None:
        """Draw the forces."""
        if len(window.time):
            spread = np.where(np.isfinite(window.deviation), window.deviation, 0.0)
            lower, upper = window.predicted - spread, window.predicted + spread
            self._plot.data = (
                window.time,
                *(_drawable(force) for force in (window.true, window.predicted, window.delayed, upper, lower)),
            )

    def write(self, numbers: Numbers) -> None:
        """Write the numbers."""
        for node, text in ((self._numbers, _numbers_html(numbers)), (self._model, _model_html(numbers.model))):
            if node.content != text:
                node.content = text

    def instruct(self, instruction: str, note: str) -> None:
        """Say what to do, in one line, and whom the force moves."""
        self._head.content = _head_html(instruction, note)

    def offer_clutch(self, offered: bool) -> None:
        """Show the clutch, or hide it where nobody listens to it."""
        self._clutch.visible = offered

    def show_clutch(self, pressed: bool) -> None:
        """Show whether the clutch is pressed."""
        self._clutch.label = RELEASE_CLUTCH if pressed else PRESS_CLUTCH
        self._clutch.color = BLUE if pressed else GREY

    def ending(self) -> None:
        """Show that the session ends."""
        self._end.label = "The session ends"
        self._end.disabled = True

    async def _slid(self, event: Any) -> None:
        if event.client is not None:  # None: the program set it
            self._on_delays(float(self._position_delay.value), float(self._force_delay.value))

    async def _clutch_clicked(self, event: Any) -> None:
        self._on_clutch(event.client_id)

    async def _end_clicked(self, event: Any) -> None:
        self._on_end()


def _drawable(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """Within what is drawn; a curve drops out of the plot where it is not known, and ends with the last that is.

    The plot joins over what is no number, and finds no scale for a curve that begins with that.
    """
    drawn = np.clip(force, 0.0, LARGEST_DRAWN)
    known = np.flatnonzero(np.isfinite(drawn))
    before_end = drawn[: known[-1] + 1 if len(known) else 1]
    before_end[np.isnan(before_end)] = BELOW
    return drawn


def _add_plot(gui: Any) -> Any:
    """The plot of forces; its x axis is numbers, not dates."""
    start = np.array([-SECONDS, 0.0])
    unknown = np.full(2, np.nan)
    return gui.add_uplot(
        (start, np.zeros(2), unknown, unknown, unknown, unknown),
        (
            {"label": "time [s]"},
            {"label": "true (robot's sensor)", "stroke": css(INK), "width": 3.0, "points": {"show": False}},
            {"label": "predicted (model)", "stroke": css(BLUE), "width": 2.0, "points": {"show": False}},
            {
                "label": "delayed (network)",
                "stroke": css(VERMILLION),
                "width": 2.0,
                "dash": (6.0, 4.0),
                "points": {"show": False},
            },
            {"label": "one standard deviation more", "stroke": _BAND, "points": {"show": False}},
            {"label": "and less", "stroke": _BAND, "points": {"show": False}},
        ),
        bands=({"series": (4, 5), "fill": _BAND},),
        title=f"Contact force [N], drawn up to {LARGEST_DRAWN:.0f} N",
        scales={"x": {"time": False, "range": (-SECONDS, 0.0)}, "y": {"time": False, "range": (0.0, None)}},
        axes=({"label": "time of your motion before now [s]", "labelSize": 20.0}, {"size": 44.0}),
        legend={"show": True, "live": False},
        cursor={"show": False},
        height=190,
    )


_BAND = f"rgba({', '.join(str(part) for part in BLUE)}, 0.25)"
"""Colour of what is within one standard deviation."""


def felt(grip: str, by_mouse: bool) -> str:
    """Whom the force moves, in a sentence.

    Args:
        grip: How a hand holds the device that the force moves; empty where it moves none.
        by_mouse: Whether the mouse leads.
    """
    if not grip:
        return "A mouse cannot push back: see the blue arrow." if by_mouse else "It moves nobody's hand."
    leads = "that follows your mouse" if by_mouse else "of the operator"
    return f"It moves a hand {leads} ({grip} grip)."


def _head_html(instruction: str, note: str) -> str:
    """What to do, and what it is about."""
    return (
        f'<div style="padding:2px 12px 6px 12px;font-size:1.15em"><b style="color:{css(BLUE)}">'
        f'{html.escape(instruction)}</b><br><span style="font-size:0.8em;color:#555">A robot touches the material '
        "beyond a slow network. A model of it comes back, and the force is computed here, at once. "
        f"{html.escape(note)}</span></div>"
    )


_DELAY_THERE = "One-way delay of your positions on their way to the robot"
_CLUTCH = "While it is pressed your hand moves alone and the robot stays where it is"
_DELAY_BACK = "One-way delay of models and measured forces on their way back"


def _number(value: float, unit: str, digits: int = 2) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{value:.{digits}f} {unit}" if abs(value) < 1000.0 else f"over {math.copysign(1000, value):.0f} {unit}"


def _numbers_html(n: Numbers) -> str:
    """The table of numbers."""
    age = f" ({n.true_age:.2f} s ago)" if math.isfinite(n.true_age) else ""
    doubt = f"{n.predicted:.2f} ± " if math.isfinite(n.deviation) and abs(n.predicted) < 1000.0 else ""
    predicted = doubt + _number(n.deviation if doubt else n.predicted, "N")
    rows = (
        (css(BLUE), "Predicted force now", predicted, _number(n.prediction_error, "%", 1)),
        (css(VERMILLION), "Delayed force now", _number(n.delayed, "N"), _number(n.delayed_error, "%", 1)),
        (css(INK), f"True force{age}", _number(n.true, "N"), ""),
        ("#555", "Rendered to the hand", _number(n.rendered, "N"), ""),
        ("#555", "Depth of the probe", _number(max(n.depth, 0.0) * 1e3, "mm", 1), ""),
        *_hand_rows(n),
    )
    cells = "".join(
        f'<tr><td><b style="color:{colour}">&#9632;</b> {name}</td>'
        f'<td style="text-align:right;white-space:nowrap"><b>{value}</b></td>'
        f'<td style="text-align:right">{error}</td></tr>'
        for colour, name, value, error in rows
    )
    warnings = "".join(
        f'<div style="color:{css(VERMILLION)};overflow-wrap:anywhere;padding-bottom:4px">'
        f"<b>{html.escape(warning)}</b></div>"
        for warning in n.warnings
    )
    right = 'style="text-align:right"'
    error = f'<td style="text-align:right;white-space:nowrap">error, last {SECONDS:.0f} s</td>'
    head = f'<tr style="color:#555"><td></td><td {right}>value</td>{error}</tr>'
    return (
        f'<div style="padding:0 12px">{warnings}'
        '<table style="width:100%;font-variant-numeric:tabular-nums;border-spacing:0 1px">'
        f'{head}{cells}</table><div style="color:#555;padding-top:4px">{html.escape(n.status)}'
        f'<br><span style="font-size:0.85em">{html.escape(n.names)}</span></div></div>'
    )


def _hand_rows(n: Numbers) -> list[tuple[str, str, str, str]]:
    """Rows of a hand that the force moves: what it put in, and where it is if the probe is not there."""
    rows = []
    if math.isfinite(n.energy):
        rows.append(("#555", "Energy put in", _number(n.energy * 1e3, "mJ"), ""))
    if abs(n.hand_ahead) >= SMALLEST_APART:
        where = "further in" if n.hand_ahead > 0.0 else "further out"
        rows.append((css(BLUE), f"Hand (ring), {where} by", _number(abs(n.hand_ahead) * 1e3, "mm", 1), ""))
    return rows


def _model_html(lines: tuple[str, ...]) -> str:
    """What is known of the newest model."""
    text = "<br>".join(map(html.escape, lines))
    return f'<div style="padding:0 12px;font-size:0.85em;line-height:1.4;color:#555">{text}</div>'

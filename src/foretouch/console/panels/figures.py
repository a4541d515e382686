"""Plots with the numbers beside them: the forces, the hand's energy, and the model that was learnt."""

from __future__ import annotations

import html
import math
from typing import Any

import numpy as np

from foretouch.console.history import NAN, Window
from foretouch.console.models_seen import ModelTrace, model_of
from foretouch.console.plots import SECONDS, Curve, Row, TimePlot, inset, number, put, table
from foretouch.console.watched import Watched
from foretouch.messages import ModelUpdate
from foretouch.models import ContactMapModel, summarise_map
from foretouch.quantities import measured, parameter_unit
from foretouch.quantities.colours import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILLION, css
from foretouch.settings import SIMULATED, is_simulated

PUT_IN = Curve("Put in by the hand, less what it owes", GREEN, 2.0)
LEAST = Curve("Least that it may be: minus the bound", VERMILLION, 2.0, "dashed")


class EnergyPanel:
    """The account of energy over time: the curve never falls below the bound."""

    def __init__(self, gui: Any) -> None:
        self._plot = TimePlot(gui, "Energy of the session [mJ]", (PUT_IN, LEAST), lowest=None)
        self._text = gui.add_html("")

    def draw(self, window: Window) -> None:
        """Draw and write the account."""
        energy, least = window.energy * 1e3, -window.energy_bound * 1e3
        self._plot.draw(window.time, (energy, least))
        if not len(energy):
            return
        rows = (
            Row(PUT_IN.name, number(float(energy[-1]), "mJ"), PUT_IN),
            Row(LEAST.name, number(float(least[-1]), "mJ"), LEAST),
            Row("Beside it, by late ticks and missing positions", number(float(window.late_energy[-1] * 1e3), "mJ")),
            Row(f"Smallest margin, last {SECONDS:.0f} s", number(float((energy - least).min()), "mJ", 3)),
        )
        self._text.content = inset(table(rows))


LARGEST_DRAWN = 15.0
"""Forces beyond this limit of the robot [N] are drawn there: a model that has diverged would hide the others."""

LEAST_AXIS = 1.0
"""The axis of forces reaches at least this far [N]: the sensor's noise in free air is a line near zero, as it is."""

TRUE = Curve("True force (robot's sensor)", INK, 3.0)
PREDICTED = Curve("Predicted force now", BLUE, 2.0, band=True)
DELAYED = Curve("Delayed force now", VERMILLION, 2.0, "dashed")
RENDERED = Curve("Rendered to the hand", GREEN, 2.0, "dotted")
AWAY = Curve("Not following", GREY, 6.0)
PREDICTED_AGAIN = Curve("Predicted, run again", SKY, 2.0)
DELAYED_AGAIN = Curve("Delayed, run again", ORANGE, 2.0, "dashed")


class ForcePanel:
    """Forces over time, and as numbers."""

    def __init__(self, gui: Any) -> None:
        curves = (TRUE, PREDICTED, DELAYED, RENDERED, AWAY, PREDICTED_AGAIN, DELAYED_AGAIN)
        title, time = f"Contact force [N], drawn up to {LARGEST_DRAWN:.0f} N", "time of your motion before now [s]"
        self._plot = TimePlot(gui, title, curves, height=138, least=LEAST_AXIS, time=time)
        self._text = gui.add_html("")

    def plot(self, window: Window, other: Window | None = None) -> None:
        """Draw the forces of a session, and of a second run at the same time."""
        unknown = np.full(len(window.time), NAN)
        again = [unknown, unknown]
        if other is not None and len(other.time):
            again = [np.interp(window.time, other.time, force) for force in (other.predicted, other.delayed)]
        true = np.where(window.away, NAN, window.true)
        away = np.where(window.away, 0.0, NAN)
        values = (true, window.predicted, window.delayed, window.rendered, away, *again)
        self._plot.draw(window.time, values, (window.deviation,), LARGEST_DRAWN)

    def write(self, content: str) -> None:
        """Write the numbers, of `numbers_html`."""
        put(self._text, content=content)


NAMES = ("material", "model", "estimator")  # Settings that are shown in the panel


def numbers_html(
    shown: Watched,
    window: Window,
    other: Watched | None,
    *,
    depth: float,
    status: str,
    warnings: tuple[str, ...],
    ahead: Row | None = None,
) -> str:
    """The table of numbers of the last seconds of a session or recording, at a depth [m], and of a second run of it.

    In a scene there is a row of what is ahead of the hand.
    """
    leader = shown.leader
    predicted, delayed, rendered, deviation = NAN, NAN, NAN, NAN
    if leader is not None:
        predicted = NAN if math.isnan(leader.position) else leader.predicted_force
        delayed, rendered, deviation = leader.delayed_force, leader.rendered_force, leader.standard_deviation
    known = np.flatnonzero(np.isfinite(window.true))
    true, age = (float(window.true[known[-1]]), -float(window.time[known[-1]])) if len(known) else (NAN, NAN)
    ago = f", {abs(age):.2f} s ago" if math.isfinite(age) else ""
    force = number(predicted, "N")
    if math.isfinite(deviation) and abs(predicted) < 1000.0:
        force = f"{predicted:.2f} ± {number(deviation, 'N')}"
    rendered_error = window.rendered_error if shown.setting("force_scale", 1.0) == 1.0 else NAN
    rows = [
        Row(PREDICTED.name, force, PREDICTED, number(window.prediction_error, "%", 1)),
        Row(DELAYED.name, number(delayed, "N"), DELAYED, number(window.delayed_error, "%", 1)),
        Row(f"True force{ago}", number(true, "N"), TRUE),
        Row(RENDERED.name, number(rendered, "N"), RENDERED, number(rendered_error, "%", 1)),
    ]
    if other is not None and other.leader is not None:
        again, second = other.leader, other.window(SECONDS)
        for curve, value, error in (
            (PREDICTED_AGAIN, again.predicted_force, second.prediction_error),
            (DELAYED_AGAIN, again.delayed_force, second.delayed_error),
        ):
            rows.append(Row(curve.name, number(value, "N"), curve, number(error, "%", 1)))
    rows += filter(None, (ahead, Row("Depth of the probe", number(max(depth, 0.0) * 1e3, "mm", 1))))
    away = float(np.mean(window.away) * np.ptp(window.time)) if len(window.time) else 0.0
    followed = away < 0.05  # 0.0 s as written
    first = Row("", "") if followed else Row(f"{AWAY.name}: {number(away, 's', 1)}", "", AWAY)
    heads = (first, "value", f"error, last {SECONDS:.0f} s")
    settings, robot = shown.settings, shown.settings.get("robot", SIMULATED)
    names = [settings[name] for name in NAMES if name in settings]
    if robot != SIMULATED:
        pressed = NAMES if is_simulated(robot) else NAMES[1:]  # one of another package has its own material
        names = [f"robot {robot}", *(settings[name] for name in pressed if name in settings)]
    urgent = "".join(
        f'<div style="color:{css(VERMILLION)};overflow-wrap:anywhere;padding-bottom:4px">'
        f"<b>{html.escape(warning)}</b></div>"
        for warning in warnings
    )
    return inset(
        f"{urgent}{table(rows, heads)}"
        '<div style="color:#555;padding-top:2px;line-height:1.3;font-size:0.93em;overflow-wrap:anywhere">'
        f'<div style="min-height:3.9em">{html.escape(status)}</div>'
        f'<span style="font-size:0.9em">{html.escape(" · ".join(names))}</span></div>'
    )


SYMBOLS = {"stiffness": "k", "damping": "λ", "exponent": "n", "switching": "α"}


def describe(update: ModelUpdate) -> tuple[str, ...]:
    """The law's numbers, a contact map's weights, visited region and stiffness; else the reason."""
    reason = (update.reason,) if update.reason else ()
    model = model_of(update)
    if model is None:
        return reason
    named = zip(model.parameter_names, model.parameters, strict=True)
    numbers = "law: " + ", ".join(f"{SYMBOLS.get(name, name)} {measured(value, None)}" for name, value in named)
    return (numbers, *(_map_lines(model) if isinstance(model, ContactMapModel) else ()), *reason)


def _map_lines(model: ContactMapModel) -> tuple[str, ...]:
    summary = summarise_map(model)
    weights = ", ".join(f"{name} {100.0 * weight:.0f} %" for name, weight in summary.shares.items())
    lines = [f"map: {weights}; visited {1e3 * summary.depth_visited:.1f} mm, {1e3 * summary.speed_visited:.0f} mm/s"]
    if summary.depths:
        values = ", ".join(f"{value:.0f}" for value in summary.stiffnesses)
        lines.append(f"stiffness: {values} N/m at {', '.join(f'{1e3 * depth:.1f}' for depth in summary.depths)} mm")
    return tuple(lines)


STIFFNESS = Curve("Local stiffness", BLUE, 2.0, band=True)
LOOKS = ((INK, "solid"), (VERMILLION, "dashed"), (GREEN, "dotted"), (PURPLE, "solid"))
"""Colours and dashes of the law's parameters, in its order."""
LARGEST_RATIO = 3.0


class ModelPanel:
    """The newest model's stiffness and parameters over time."""

    def __init__(self, gui: Any) -> None:
        self._stiffness = TimePlot(gui, "Stiffness dF/dx at rest [N/mm] and one deviation", (STIFFNESS,), height=130)
        curves = [Curve(f"parameter {n}", colour, 2.0, dash, band=True) for n, (colour, dash) in enumerate(LOOKS, 1)]
        self._curves = curves
        self._parameters = TimePlot(gui, "The law's numbers over their newest, and one deviation", curves, height=130)
        self._text = gui.add_html("")

    def draw(self, trace: ModelTrace, depth: float, lines: tuple[str, ...]) -> None:
        """Draw and write the models of the last seconds, compared at a depth [m], with remarks on the newest."""
        rows: list[Row] = []
        if len(trace.time) > 1:
            self._stiffness.draw(trace.time, (trace.stiffness * 1e-3,), (trace.deviation * 1e-3,))
            ratios, spreads = self._ratios(trace, trace.parameters), self._ratios(trace, trace.errors)
            self._parameters.draw(trace.time, ratios, [np.abs(spread) for spread in spreads], most=LARGEST_RATIO)
            value = measured(trace.stiffness[-1] * 1e-3, trace.deviation[-1] * 1e-3)
            rows.append(Row(f"Stiffness at {depth * 1e3:.1f} mm [N/mm]", value, STIFFNESS))
            newest = zip(self._curves, trace.names, trace.parameters[-1], trace.errors[-1], strict=False)
            for curve, name, parameter, error in newest:
                unit = parameter_unit(name, trace.names)
                label = f"{SYMBOLS.get(name, '')} {name}{f' [{unit}]' if unit else ''}".strip()
                rows.append(Row(label, measured(parameter, error), curve))
        text = "<br>".join(map(html.escape, lines))
        remarks = f'<div style="font-size:0.85em;line-height:1.4;color:#555">{text}</div>'
        put(self._text, content=inset(table(rows) + remarks))

    def _ratios(self, trace: ModelTrace, columns: np.ndarray) -> list[np.ndarray]:
        """What belongs to each parameter over its newest value; NaN where the law has none, or that value is 0."""
        unknown = np.full(len(trace.time), NAN)
        ratios = []
        for index in range(len(self._curves)):
            known = index < len(trace.names) and trace.parameters[-1, index] != 0.0
            ratios.append(columns[:, index] / trace.parameters[-1, index] if known else unknown)
        return ratios

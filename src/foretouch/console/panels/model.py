"""What has been learnt: how stiff the material is, with its uncertainty, and the newest law in a few lines."""

from __future__ import annotations

import html
from typing import Any

import numpy as np

from foretouch.console.models_seen import ModelTrace
from foretouch.console.plots import Curve, Row, TimePlot, put, table
from foretouch.console.window import NAN
from foretouch.errors import InputError
from foretouch.messages import ModelUpdate
from foretouch.models import ContactMapModel, make_model, summarise_map
from foretouch.quantities import measured, parameter_unit
from foretouch.quantities.colours import BLUE, GREEN, INK, PURPLE, VERMILLION

SYMBOLS = {"stiffness": "k", "damping": "λ", "exponent": "n", "switching": "α"}


def describe(update: ModelUpdate) -> tuple[str, ...]:
    """The law's numbers, a contact map's weights, visited region and stiffness, and remarks.

    Args:
        update: Update as received; one that cannot be run is described by its reason alone.
    """
    reason = (update.reason,) if update.reason else ()
    if not update.valid:
        return reason
    try:
        model = make_model(update.law, update.parameters, update.map)
    except InputError:
        return reason
    named = zip(model.parameter_names, model.parameters, strict=True)
    numbers = "law: " + ", ".join(f"{SYMBOLS.get(name, name)} {measured(value, None)}" for name, value in named)
    return (numbers, *(_map_lines(model) if isinstance(model, ContactMapModel) else ()), *reason)


def _map_lines(model: ContactMapModel) -> tuple[str, ...]:
    summary = summarise_map(model)
    shares = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in summary.shares.items())
    lines = [f"map: {shares}; visited {1e3 * summary.depth_visited:.1f} mm, {1e3 * summary.speed_visited:.0f} mm/s"]
    if summary.depths:
        values = ", ".join(f"{value:.0f}" for value in summary.stiffnesses)
        lines.append(f"stiffness: {values} N/m at {', '.join(f'{1e3 * depth:.1f}' for depth in summary.depths)} mm")
    return tuple(lines)


STIFFNESS = Curve("Local stiffness", BLUE, 2.0, band=True)
LOOKS = ((INK, "solid"), (VERMILLION, "dashed"), (GREEN, "dotted"), (PURPLE, "solid"))
"""Colours and dashes of the law's parameters, in its order."""
LARGEST_RATIO = 3.0


class ModelPanel:
    """The newest model's stiffness and parameters over time.

    Args:
        gui: The viewer's user interface.
    """

    def __init__(self, gui: Any) -> None:
        self._stiffness = TimePlot(gui, "Stiffness dF/dx at rest [N/mm] and one deviation", (STIFFNESS,), height=130)
        curves = [Curve(f"parameter {n}", colour, 2.0, dash, band=True) for n, (colour, dash) in enumerate(LOOKS, 1)]
        self._curves = curves
        self._parameters = TimePlot(gui, "The law's numbers over their newest, and one deviation", curves, height=130)
        self._text = gui.add_html("")

    def draw(self, trace: ModelTrace, depth: float, lines: tuple[str, ...]) -> None:
        """Draw and write the models.

        Args:
            trace: Trace of the last seconds.
            depth: Depth at which stiffnesses are compared [m].
            lines: Remarks on the newest.
        """
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
        content = (
            f'<div style="padding:0 12px">{table(rows)}<div style="font-size:0.85em;line-height:1.4;color:#555">{text}'
            "</div></div>"
        )
        put(self._text, content=content)

    def _ratios(self, trace: ModelTrace, columns: np.ndarray) -> list[np.ndarray]:
        """What belongs to each parameter over its newest value; NaN where the law has none, or that value is 0."""
        unknown = np.full(len(trace.time), NAN)
        ratios = []
        for index in range(len(self._curves)):
            known = index < len(trace.names) and trace.parameters[-1, index] != 0.0
            ratios.append(columns[:, index] / trace.parameters[-1, index] if known else unknown)
        return ratios

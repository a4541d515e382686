"""Energy that the hand has put into the force, and what it may have given out."""

from __future__ import annotations

from typing import Any

from foretouch.console.plots import SECONDS, Curve, Row, TimePlot, number, table
from foretouch.console.window import Window
from foretouch.quantities.colours import GREEN, VERMILLION

__all__ = ["EnergyPanel"]

PUT_IN = Curve("Put in by the hand, less what it owes", GREEN, 2.0)
LEAST = Curve("Least that it may be: minus the bound", VERMILLION, 2.0, "dashed")


class EnergyPanel:
    """The account of energy over time: the curve never falls below the bound.

    Args:
        gui: The viewer's user interface.
    """

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
        self._text.content = f'<div style="padding:0 12px">{table(rows)}</div>'

"""Pages of sensor calibrations: what was found, and what it leaves."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.identification import SeriesCompliance, ToolWeight
from foretouch.quantities import new_figure
from foretouch.report.writing.drawing import COLOURS, finished, legend
from foretouch.report.writing.html import embedded, named_values, write_html


def write_calibration_page(
    directory: str | PathLike[str],
    name: str,
    found: ToolWeight | SeriesCompliance,
    figures: Mapping[str, Any],
    made: Mapping[str, Any] | None = None,
) -> Path:
    """Write what a calibration found as ``index.html``.

    Of static poses it shows the residuals pose by pose; of presses on a rigid block the force over the deflection and
    the residual.

    Args:
        directory: Made if it is not there.
        name: Of the file, for the heading.
        found: What was found.
        figures: By name, for the table.
        made: What made it, for the end of the page, as `write_html` takes it.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    if isinstance(found, ToolWeight):
        title, drawn = f"Sensor calibration from {name}", _weight_figure(found)
    else:
        title, drawn = f"Series compliance from {name}", _compliance_figure(found)
    shown = {
        key: ", ".join(f"{part:.6g}" for part in value) if isinstance(value, tuple) else value
        for key, value in figures.items()
    }
    body = [f"<h1>{escape(title)}</h1>", named_values(shown), "<h2>Residuals</h2>", embedded(drawn, "Residuals")]
    return write_html(directory, title, body, made)


def _weight_figure(weight: ToolWeight) -> Any:
    parts = [("force [N]", weight.force_residual)]
    if weight.torque_residual is not None:
        parts.append(("torque [N m]", weight.torque_residual))
    figure = new_figure(2.8 * len(parts) + 0.6)
    for row, (title, residual) in enumerate(parts, 1):
        axes = figure.add_subplot(len(parts), 1, row)
        for column, axis in enumerate("xyz"):
            place = np.arange(1, len(residual) + 1) + 0.12 * (column - 1)
            axes.plot(place, residual[:, column], "o", ms=4, color=COLOURS[column], label=axis)
        axes.axhline(0.0, color="0.5", lw=0.8)
        axes.set_title(f"Residual: measured less fitted {title.partition(' ')[0]}")
        axes.set_ylabel(title)
        axes.set_xlabel("pose")
        legend(axes, 3)
    return finished(figure, len(parts), gap=1.1)


def _compliance_figure(found: SeriesCompliance) -> Any:
    figure = new_figure(6.4)
    above, below = figure.add_subplot(2, 1, 1), figure.add_subplot(2, 1, 2)
    some = slice(None, None, max(1, found.force.size // 4000))
    force, place, loads = found.force[some], found.deflection[some], found.loading[some]
    for colour, label, part, shift in (
        (COLOURS[0], "loading", loads, -0.5),
        (COLOURS[1], "unloading", ~loads, 0.5),
    ):
        ends = np.array([found.contact_floor, found.force.max()])
        above.plot(1e6 * place[part], force[part], ".", ms=2, color=colour, label=label)
        above.plot(1e6 * (ends / found.stiffness + shift * found.lost_motion), ends, color=colour, lw=1.0)
        below.plot(force[part], 1e6 * found.residual[some][part], ".", ms=2, color=colour, label=label)
    above.set_title("Force over deflection, and the fitted lines")
    above.set_xlabel("deflection [um]")
    above.set_ylabel("force [N]")
    below.set_title("Residual: measured less fitted position")
    below.set_ylabel("residual [um]")
    below.set_xlabel("force [N]")
    legend(above, 2)
    legend(below, 2)
    return finished(figure, 2, gap=1.1)

"""The plots of a sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.report import COLOURS, finished, legend, new_figure
from foretouch.sweep.cases import NETWORKS
from foretouch.sweep.curves import AXES, STIFF, Axis, Curve, curve, plain, stiff
from foretouch.sweep.outcome import LARGEST_JUMP, Outcome
from foretouch.sweep.summary import KINDS
from foretouch.sweep.totals import of

__all__ = ["condition_figure", "energy_figure", "jump_figure", "transparency_figure"]

COLOUR = {"none": COLOURS[0], "delayed": COLOURS[1], "delayed-tdpa": COLOURS[3]}
MARKER = {"none": "o", "delayed": "s", "delayed-tdpa": "^"}
"""By baseline; the markers tell them apart without colour too."""

LABEL = {"none": "models (ours)", "delayed": "delayed force", "delayed-tdpa": "delayed force, passivity controller"}

JND = (7.0, 10.0)
"""People tell forces apart that differ by so much [%]."""


def transparency_figure(
    rows: Sequence[Outcome], figure: Callable[[Outcome], float | None], name: str, axis: Axis
) -> Any:
    """A figure of all plain sessions against one axis: each session a dot, medians and quartiles in bins.

    Args:
        rows: Of a sweep.
        figure: On the vertical axis [%].
        name: Of that.
        axis: The horizontal one; a baseline's rows have no model rate.
    """
    drawing = new_figure(4.6)
    axes = drawing.subplots()
    axes.axhspan(*JND, color="0.9", linewidth=0.0, zorder=0)
    kinds = [kind for kind in KINDS if of(rows, kind) and (kind == "none" or axis.name != "model rate")]
    for kind in kinds:
        sessions = plain(of(rows, kind))
        points = [(axis.value(row), figure(row)) for row in sessions]
        known = np.array([(x, y) for x, y in points if x is not None and y is not None]).reshape(-1, 2)
        axes.plot(known[:, 0], known[:, 1], MARKER[kind], color=COLOUR[kind], markersize=2.5, alpha=0.3, zorder=1)
        _draw(axes, curve(sessions, axis.value, figure, axis.edges), kind)
    beside = curve(stiff(of(rows, "none")), axis.value, figure, axis.edges)
    if beside.x.size:
        style = {"color": COLOUR["none"], "linewidth": 1.0, "linestyle": (0, (4, 2))}
        axes.plot(beside.x, beside.middle, label=f"ours on {' and '.join(STIFF)}", **style)
    _scale(axes, axis)
    axes.set_yscale("log")
    axes.set_ylim(1.0, 300.0)
    marks = (1, 2, 5, 10, 20, 50, 100, 200)
    axes.set_yticks(marks, [f"{mark}" for mark in marks])
    axes.minorticks_off()
    axes.set_xlabel(f"{axis.name} [{axis.unit}]")
    axes.set_ylabel(f"{name} [%]")
    axes.set_title(f"{name[0].upper()}{name[1:]} against {axis.name}")
    axes.text(
        0.995,
        JND[0],
        " a hand tells apart from here ",
        ha="right",
        va="bottom",
        fontsize="x-small",
        transform=axes.get_yaxis_transform(),
        color="0.35",
    )
    legend(axes, len(kinds) + 1)
    return finished(drawing, 1)


def condition_figure(rows: Sequence[Outcome]) -> Any:
    """Share of stable sessions by network, grip and round trip, with the counts beside the bars."""
    kinds = [kind for kind in KINDS if of(rows, kind)]
    groups: list[tuple[str, Callable[[Outcome], bool]]] = [
        *((name, lambda row, name=name: row.network == name) for name in NETWORKS),
        *(
            (f"grip: {grip}", lambda row, grip=grip: row.options["grip"] == grip)
            for grip in ("soft", "normal", "stiff")
        ),
        ("round trip below 50 ms", lambda row: row.round_trip_s < 0.05),
        ("from 50 ms to 1 s", lambda row: 0.05 <= row.round_trip_s < 1.0),
        ("from 1 s on", lambda row: row.round_trip_s >= 1.0),
    ]
    drawing = new_figure(1.3 + 0.42 * len(groups))
    axes = drawing.subplots()
    height = 0.8 / len(kinds)
    for place, kind in enumerate(kinds):
        axes.barh([], [], color=COLOUR[kind], label=LABEL[kind])
        for line, (_, inside) in enumerate(groups):
            found = [row for row in of(rows, kind) if inside(row) and not row.error]
            if not found:
                continue
            stable = sum(bool(row.stable) for row in found)
            where = line + (place - 0.5 * (len(kinds) - 1)) * height
            axes.barh(where, 100.0 * stable / len(found), 0.9 * height, color=COLOUR[kind])
            axes.text(100.0 * stable / len(found) + 0.7, where, f"{stable} of {len(found)}", va="center", fontsize=6.5)
    axes.set_yticks(range(len(groups)), [name for name, _ in groups], fontsize="small")
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.set_xlim(0.0, 110.0)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("stable sessions [%]")
    axes.set_title("Stable sessions by network, grip and round trip")
    legend(axes, len(kinds))
    finished(drawing, 1)
    drawing.subplots_adjust(left=0.18)
    axes.grid(axis="y", visible=False)
    return drawing


def energy_figure(rows: Sequence[Outcome]) -> Any:
    """The largest share of its bound that the energy took in each session; beyond 100 % the bound is broken."""
    edges = np.concatenate([np.linspace(0.0, 100.0, 21), [120.0]])

    def value(row: Outcome) -> float | None:
        return None if row.energy_used_percent is None else min(row.energy_used_percent, 119.0)

    kinds = [kind for kind in KINDS if of(rows, kind)]
    title = "Energy that was given out, against the bound for one tick and one encoder count"
    axes, drawing = _histograms(rows, value, edges, kinds, title)
    axes.axvline(100.0, color="black", linewidth=1.2, linestyle=(0, (4, 2)))
    axes.set_xticks([0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 110.0], ["0", "20", "40", "60", "80", "bound", "beyond"])
    axes.set_xlabel("largest share of its bound that the energy took in a session [%]")
    return finished(drawing, 1)


def jump_figure(rows: Sequence[Outcome]) -> Any:
    """The largest change of force that a model made in one tick of each session."""
    edges = np.linspace(0.0, 0.12, 25)

    def value(row: Outcome) -> float | None:
        return None if row.largest_jump_N is None else min(row.largest_jump_N, 0.1199)

    axes, drawing = _histograms(rows, value, edges, ["none"], "What models change at once")
    axes.axvline(LARGEST_JUMP, color="black", linewidth=1.2, linestyle=(0, (4, 2)))
    axes.text(LARGEST_JUMP, 0.95, " not allowed", transform=axes.get_xaxis_transform(), fontsize="small", va="top")
    axes.set_xlabel("largest change of force by a model in one tick [N]")
    return finished(drawing, 1)


def _draw(axes: Any, drawn: Curve, kind: str) -> None:
    axes.fill_between(drawn.x, drawn.low, drawn.high, color=COLOUR[kind], alpha=0.18, linewidth=0.0, zorder=2)
    axes.plot(
        drawn.x, drawn.middle, marker=MARKER[kind], color=COLOUR[kind], linewidth=2.0, label=LABEL[kind], zorder=3
    )


def _scale(axes: Any, axis: Axis) -> None:
    """Logarithmic, with 0 where there is one."""
    if axis is AXES[0]:
        axes.set_xscale("symlog", linthresh=0.01, linscale=0.4)
        axes.set_xlim(-0.001, 6.0)
        marks: Sequence[float] = (0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)
    else:
        axes.set_xscale("log")
        marks = (1, 2, 5, 10, 20, 50, 100, 200) if axis is AXES[1] else (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)
    axes.set_xticks(marks, [f"{mark:g}" for mark in marks])


def _histograms(
    rows: Sequence[Outcome],
    figure: Callable[[Outcome], float | None],
    edges: NDArray[np.float64],
    kinds: list[str],
    title: str,
) -> tuple[Any, Any]:
    """Shares of the sessions of each kind, one over the other."""
    drawing = new_figure(3.4)
    axes = drawing.subplots()
    for kind in kinds:
        values = [value for value in map(figure, of(rows, kind)) if value is not None]
        counts, _ = np.histogram(values, edges)
        shares = 100.0 * counts / max(len(values), 1)
        axes.stairs(shares, edges, color=COLOUR[kind], fill=True, alpha=0.35)
        axes.stairs(shares, edges, color=COLOUR[kind], linewidth=1.5, label=f"{LABEL[kind]}: {len(values)} sessions")
    axes.set_ylabel("sessions [%]")
    axes.set_title(title)
    legend(axes, len(kinds))
    return axes, drawing

"""The figures of a session in three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import new_figure
from foretouch.report.pairs import Pairs
from foretouch.report.scene.map import StiffnessMap
from foretouch.report.scene.pose import NEAR_DEGREES, NEAR_MM, PoseError
from foretouch.report.scene.scene import Wrong
from foretouch.report.writing.drawing import ERROR, PREDICTED, TRUE, finished, legend, shade
from foretouch.report.writing.thinning import NARROW, extremes, joined, thinned
from foretouch.session.spatial import Inclusion

Array = NDArray[np.float64]

LEAST_MM, LEAST_DEGREES = 0.01, 0.01
"""Where the axes of errors begin: no camera knows less."""


def pose_figure(error: PoseError) -> Any:
    """Error of the fixture that is rendered, place and turn, with the filter's own standard deviations.

    Args:
        error: With at least one tick.
    """
    figure = new_figure(6.4)
    place, turn = figure.subplots(2, 1, sharex=True)
    for axes, values, deviation, near, least, unit, what in (
        (place, error.place, error.place_deviation, NEAR_MM, LEAST_MM, "mm", "distance of the origins"),
        (turn, error.turn, error.turn_deviation, NEAR_DEGREES, LEAST_DEGREES, "degrees", "angle"),
    ):
        axes.plot(*thinned(error.time, np.maximum(values, least)), color=PREDICTED, linewidth=1.1, label=what)
        told = np.maximum(deviation, least)
        axes.plot(*thinned(error.time, told), color=ERROR, linewidth=1.1, label="the filter's own standard deviation")
        axes.axhline(near, color="0.4", linestyle=":", linewidth=1.0, label=f"{near:g} {unit}")
        _mark_touches(axes, error)
        axes.set_yscale("log")
        axes.set_ylabel(f"error [{unit}]")
    place.set_title("Where the leader shows the fixture, against where it is: place")
    turn.set_title("The same: turn")
    turn.set_xlabel("time [s]")
    legend(place, columns=5)
    legend(turn, columns=5)
    return finished(figure, 2)


def contact_figure(log: SessionLog, pairs: Pairs, wrong: Wrong, true_friction: float | None, start_ns: int) -> Any:
    """Contacts that are rendered and there are none, or the other way round, and friction as it is learnt.

    Args:
        log: One stretch, with the follower's models.
        pairs: Its rows at equal command, at least one.
        wrong: Contacts of these rows.
        true_friction: Coefficient; None where nobody knows.
        start_ns: Time zero by the follower's clock [ns].
    """
    figure = new_figure(6.4)
    force, friction = figure.subplots(2, 1, sharex=True)
    force.plot(*thinned(pairs.time, pairs.follower["exact_force"]), color=TRUE, linewidth=1.3, label="true")
    wanted = pairs.leader["predicted_force"]
    force.plot(*thinned(pairs.time, wanted), color=PREDICTED, linewidth=1.0, label="predicted, along the normal")
    shade(force, pairs.time, wrong.false, ERROR, "false: nothing is there")
    shade(force, pairs.time, wrong.missed, "#CC79A7", "missed")
    shade(force, pairs.time, wrong.first, "0.5", "before any model")
    force.set_title("Contacts at equal command")
    force.set_ylabel("force [N]")
    legend(force, columns=5)
    said = [(1e-9 * (model.time_ns - start_ns), *model.friction) for model in log.models if len(model.friction) >= 4]
    if said:
        told = np.array(said)
        time, coefficient, _, deviation, _ = told[extremes(told[:, 1], NARROW)].T
        low, high = np.maximum(coefficient - 2.0 * deviation, 0.0), coefficient + 2.0 * deviation
        friction.fill_between(time, low, high, color=PREDICTED, alpha=0.2, linewidth=0.0, label="two deviations")
        friction.plot(time, coefficient, color=PREDICTED, linewidth=1.2, label="learnt")
    else:
        friction.text(0.5, 0.5, "not learnt", ha="center", va="center", transform=friction.transAxes)
    if true_friction is not None:
        friction.axhline(true_friction, color=TRUE, linestyle="--", linewidth=1.0, label="true")
    friction.set_ylim(0.0, 2.0 * (true_friction or 0.5))
    friction.set_title("Coefficient of friction")
    friction.set_ylabel("coefficient")
    friction.set_xlabel("time [s]")
    if friction.get_legend_handles_labels()[1]:
        legend(friction, columns=4)
    return finished(figure, 2)


def map_figure(found: StiffnessMap, inclusion: Inclusion | None = None, *, centre: Sequence[float] = ()) -> Any:
    """The map of local stiffness as it was learnt, its doubt, and beside them the truth where it is known.

    What was not touched is left grey.

    Args:
        found: The map.
        inclusion: That is there; None for none.
        centre: Where it was found [mm]: x and y; or nothing.
    """
    panels = [("learnt", found.learnt, "stiffness"), ("standard deviation", found.doubt, "doubt")]
    if found.true is not None:
        panels.insert(0, ("true", found.true, "stiffness"))
    figure = new_figure(0.9 + 7.6 / len(panels))
    seen = found.learnt[found.touched]
    scales = {
        "stiffness": _scale(seen if found.true is None else np.append(seen, found.true[found.touched])),
        "doubt": _scale(found.doubt[found.touched]),
    }
    grid = figure.subplots(1, len(panels), sharey=True)
    edges = 1e3 * np.array([found.x[0], found.x[-1], found.y[0], found.y[-1]]) + 0.5 * np.array([-1, 1, -1, 1])
    for axes, (title, values, kind) in zip(np.ravel(grid), panels, strict=True):
        shown = values if title == "true" else np.where(found.touched, values, np.nan)
        low, high = scales[kind]
        image = axes.imshow(shown, origin="lower", extent=edges, vmin=low, vmax=high, cmap="cividis")
        axes.set_facecolor("0.85")
        _outlines(axes, found, inclusion, centre)
        axes.set_title(f"{title} [N/m]")
        axes.set_xlabel("x in the fixture's frame [mm]")
        figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03)
    first = np.ravel(grid)[0]
    first.set_ylabel("y [mm]")
    if first.get_legend_handles_labels()[1]:
        first.legend(loc="lower left", fontsize="x-small", framealpha=0.9)
    figure.suptitle(f"Local stiffness {1e3 * found.depth:g} mm deep; grey: not touched", y=0.97, fontsize="medium")
    figure.subplots_adjust(left=0.07, right=0.95, bottom=0.14, top=0.84, wspace=0.25)
    return figure


def _mark_touches(axes: Any, error: PoseError) -> None:
    shown = float(np.ptp(error.time))
    touches = joined(np.column_stack((error.touches, error.touches)), shown)
    for number, touch in enumerate(touches[:, 0].tolist()):
        axes.axvline(touch, color="0.75", linewidth=0.7, zorder=0.5, label="touch" if number == 0 else None)
    for number, (begin, end) in enumerate(joined(np.array(error.bumps).reshape(-1, 2), shown).tolist()):
        label = "bump" if number == 0 else None
        axes.axvspan(begin, max(end, begin + 0.1), color=ERROR, alpha=0.35, linewidth=0.0, label=label)


def _outlines(axes: Any, found: StiffnessMap, inclusion: Inclusion | None, centre: Sequence[float]) -> None:
    if inclusion is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        x = 1e3 * (inclusion.middle[0] + inclusion.radius * np.cos(angle))
        y = 1e3 * (inclusion.middle[1] + inclusion.radius * np.sin(angle))
        axes.plot(x, y, color="white", linestyle="--", linewidth=1.2)
        axes.plot(x, y, color=TRUE, linestyle=(3, (3, 3)), linewidth=1.2, label="inclusion")
    if len(centre) == 2:
        axes.plot(*centre, marker="+", color=ERROR, markersize=11, markeredgewidth=2.2, linestyle="", label="found at")
    axes.set_xlim(1e3 * found.x[0], 1e3 * found.x[-1])
    axes.set_ylim(1e3 * found.y[0], 1e3 * found.y[-1])


def _scale(values: Array) -> tuple[float, float]:
    """Least and largest that are shown: the outermost fiftieths go beyond."""
    if not values.size:
        return 0.0, 1.0
    low, high = np.percentile(values, [2.0, 98.0])
    return float(low), float(max(high, low + 1.0))

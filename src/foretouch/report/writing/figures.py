"""The figures of a session, each a Matplotlib figure of its own; no global state is touched."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import ModelUpdate, SessionLog
from foretouch.models import LAWS
from foretouch.quantities import QUANTITIES, new_figure
from foretouch.report.pairs import Pairs
from foretouch.report.scores import JND_FORCE, JND_SHARE
from foretouch.report.statuses import Stretch
from foretouch.report.writing.drawing import DELAYED, ERROR, PREDICTED, RENDERED, TRUE, finished, legend, mark, shade
from foretouch.report.writing.thinning import NARROW, corners, extremes, thinned

Array = NDArray[np.float64]

ZOOM = 4.0
"""Length of the close-up [s], and of shorter recordings half of them."""

LEAST = 0.3
"""The force axis shows at least so much [N], so that noise does not fill it."""

MOST_IN_LOOPS, PIECE = 30_000, 2000
"""Samples of force against depth that are drawn, and in one line: no extremes can stand for the rest of a loop."""

ROOM = 1.35
"""The force axis reaches to this multiple of the largest measured or delayed force."""


def force_figure(
    time: Array,
    true_force: Array,
    predicted_force: Array,
    delayed_force: Array,
    rendered_force: Array | None = None,
    *,
    scored: NDArray[np.bool_] | None = None,
    wanted: str = "predicted",
    stretches: Sequence[Stretch] = (),
) -> Any:
    """Forces over time, a close-up, and their errors in it; the layout of the paper's Fig. 11 and more.

    Args:
        time: [s], increasing, shape (n,), n of at least 1.
        true_force: Less its zero [N], shape (n,).
        predicted_force: [N], shape (n,).
        delayed_force: [N], shape (n,).
        rendered_force: [N], shape (n,), or None where nothing was rendered.
        scored: Flags of the samples that are scored, to be marked, shape (n,).
        wanted: What the predicted force is called; of a baseline it is no prediction.
        stretches: In which the robot was not where the commands said, in the same time.
    """
    name = "measured" if rendered_force is None else "true (follower's sensor)"
    curves = [(name, true_force, TRUE, 1.6), ("delayed", delayed_force, DELAYED, 1.1)]
    if rendered_force is not None:
        curves.append(("rendered", rendered_force, RENDERED, 4.0))  # wide, under the predicted one
    curves.append((wanted, predicted_force, PREDICTED, 1.1))
    figure = new_figure(9.5)
    whole, near, error = figure.subplots(3, 1)
    top = ROOM * max(_largest(true_force), _largest(delayed_force), LEAST)
    inside = _close_up(time, true_force)
    for axes, chosen in ((whole, np.ones(time.size, dtype=np.bool_)), (near, inside)):
        for label, force, colour, width in curves:
            alpha = 0.45 if force is rendered_force else 1.0
            axes.plot(*thinned(time[chosen], force[chosen]), color=colour, linewidth=width, alpha=alpha, label=label)
        axes.set_ylim(-0.08 * top, top)
        axes.set_ylabel("force [N]")
        axes.set_xlabel("time [s]")
        _say_beyond(axes, predicted_force[chosen], top, "predicted force")
    whole.set_title("Contact force at equal command")
    if scored is not None:
        shade(whole, time, scored, "#56B4E9", "scored")
    whole.axvspan(time[inside][0], time[inside][-1], color="0.5", alpha=0.15, linewidth=0.0, label="close-up below")
    near.set_title("Close-up")
    mark(whole, _within(stretches, time))
    mark(near, _within(stretches, time[inside]))
    legend(whole, columns=6 if not stretches else 4)
    noticed = np.maximum(JND_SHARE * true_force[inside], JND_FORCE)
    kept = extremes(noticed, NARROW)
    when, band, said = time[inside][kept], noticed[kept], "not noticed: max(10 %, 0.05 N)"
    error.fill_between(when, -band, band, color="0.5", alpha=0.3, linewidth=0.0, label=said)
    wrong = {
        kind: (force - true_force)[inside] for kind, force in (("delayed", delayed_force), (wanted, predicted_force))
    }
    for (label, values), colour in zip(wrong.items(), (DELAYED, PREDICTED), strict=True):
        error.plot(*thinned(time[inside], values), color=colour, linewidth=1.1, label=label)
    widest = min(top, ROOM * max(_largest(np.abs(wrong[wanted])), JND_FORCE))
    error.set_ylim(-widest, widest)
    mark(error, _within(stretches, time[inside]))
    error.set_title(f"Error in the close-up, scaled to that of the {wanted} force: force less {name.split()[0]} force")
    error.set_ylabel("error [N]")
    error.set_xlabel("time [s]")
    for kind, values in wrong.items():
        _say_beyond(error, np.abs(values), widest, f"error of the {kind} force")
    legend(error, columns=5)
    return finished(figure, 3, above=0.8 if stretches else 0.6, gap=1.1)


def _within(stretches: Sequence[Stretch], time: Array) -> list[Stretch]:
    """Those that begin before the last sample and end after the first."""
    return [one for one in stretches if one.begin < time[-1] and one.end > time[0]]


def prediction_figure(
    time: Array, measured_force: Array, predicted_force: Array, delayed_force: Array, in_contact: NDArray[np.bool_]
) -> Any:
    """Forces of a prediction on a recording, as `force_figure`, with the samples in contact marked below them."""
    figure = force_figure(time, measured_force, predicted_force, delayed_force)
    figure.axes[0].set_title("Measured and predicted contact force", pad=22.0)
    when, touching = corners(time, in_contact)
    for axes in figure.axes[:2]:
        sides, low = axes.get_xlim(), axes.get_ylim()[0]
        axes.plot(when, np.where(touching, 0.6 * low, np.nan), color="0.45", linewidth=3.0)
        axes.set_xlim(sides)
    figure.axes[0].plot([], [], color="0.45", linewidth=3.0, label="in contact")
    legend(figure.axes[0], columns=6)
    return finished(figure, 3, gap=1.1)


def model_figure(models: tuple[ModelUpdate, ...], start_ns: int, stretches: Sequence[Stretch] = ()) -> Any:
    """Identified parameters over time, each in axes of its own; the layout of the paper's Fig. 10.

    Args:
        models: Of at least one law that is known here; the law that was sent most is shown.
        start_ns: Time zero by the follower's clock [ns].
        stretches: In which the robot was not where the commands said, in the same time.
    """
    laws = [model.law for model in models if model.law in LAWS]
    law = max(sorted(set(laws)), key=laws.count)
    shown = [model for model in models if model.law == law]
    names = LAWS[law].parameter_names
    time = np.array([(model.time_ns - start_ns) * 1e-9 for model in shown])
    valid = np.array([model.valid for model in shown])
    rows = (len(names) + 1) // 2
    figure = new_figure(1.0 + 2.3 * rows)
    grid = figure.subplots(rows, 2, squeeze=False, sharex=True)
    for column, name in enumerate(names):
        axes = grid.flat[column]
        values = np.array([model.parameters[column] for model in shown])
        kept = extremes(np.where(valid, values, np.nan))
        drawn = np.where(valid, values, np.nan)[kept]
        axes.plot(time[kept], drawn, color=PREDICTED, linewidth=1.2, label="valid")
        if not valid.all():
            dots = np.flatnonzero(~valid)[extremes(values[~valid], NARROW)]
            axes.plot(time[dots], values[dots], ".", color=ERROR, markersize=3.0, label="not valid")
        _robust_range(axes, values[valid] if valid.any() else values)
        mark(axes, stretches)
        symbol, unit = _symbol_and_unit(name)
        axes.set_title(f"{name} [{unit}]" if symbol in ("", name) else f"{name} {symbol} [{unit}]")
    for axes in grid.flat[len(names) :]:
        axes.set_visible(False)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    legend(grid.flat[0], columns=4)
    figure.suptitle(f"Identified parameters: {law}", y=1.0 - 0.25 / figure.get_figheight(), va="center")
    return finished(figure, rows, above=0.95, gap=0.6)


def loop_figure(pairs: Pairs, true_force: Array, surface: float | None, wanted: str = "predicted") -> Any:
    """Force against depth: what the follower felt at its place, and what was predicted at the hand's."""
    figure = new_figure(4.6)
    axes = figure.subplots()
    zero = 0.0 if surface is None else surface
    step = max(1, pairs.time.size // MOST_IN_LOOPS)
    for label, position, force, colour in (
        ("true, at the follower's position", pairs.follower["position"], true_force, TRUE),
        (f"{wanted}, at the leader's position", pairs.leader["position"], pairs.leader["predicted_force"], PREDICTED),
    ):
        depth, felt = 1e3 * (position[::step] - zero), force[::step]
        for begin in range(0, depth.size, PIECE):  # a line that crosses itself too often cannot be drawn at once
            piece = slice(begin, begin + PIECE + 1)
            named = label if begin == 0 else None
            axes.plot(depth[piece], felt[piece], color=colour, linewidth=0.7, label=named)
    top = ROOM * max(_largest(true_force), LEAST)
    axes.set_ylim(-0.08 * top, top)
    _say_beyond(axes, pairs.leader["predicted_force"], top, "predicted force")
    axes.set_title("Force against depth")
    axes.set_xlabel("position [mm]" if surface is None else "depth, from the last surface that was sent [mm]")
    axes.set_ylabel("force [N]")
    legend(axes, columns=2)
    return finished(figure, 1)


def tracking_figure(pairs: Pairs, stretches: Sequence[Stretch] = ()) -> Any:
    """Commanded and actual position of the robot, and the distance between them.

    Args:
        pairs: Rows at equal command.
        stretches: In which the robot was not where the commands said, in the time of the rows.
    """
    figure = new_figure(5.0)
    place, apart = figure.subplots(2, 1, sharex=True)
    commanded, actual = 1e3 * pairs.leader["position"], 1e3 * pairs.follower["position"]
    place.plot(*thinned(pairs.time, commanded), color=ERROR, linewidth=1.6, label="command that was applied")
    place.plot(*thinned(pairs.time, actual), color=TRUE, linewidth=0.9, label="follower")
    place.set_title("Position of the robot at equal command")
    place.set_ylabel("position [mm]")
    for axes in (place, apart):
        mark(axes, stretches)
    legend(place, columns=4)
    apart.plot(*thinned(pairs.time, actual - commanded), color=PREDICTED, linewidth=0.9)
    apart.set_title("Tracking error: follower less command")
    apart.set_ylabel("error [mm]")
    apart.set_xlabel("time [s]")
    return finished(figure, 2, gap=0.5)


def timing_figure(log: SessionLog) -> Any:
    """How long the ticks of both sides were apart, and how long their computing took."""
    figure = new_figure(5.4)
    grid = figure.subplots(2, 2)
    for row, (side, table, colour) in enumerate(
        (("leader", log.leader, PREDICTED), ("follower", log.follower, RENDERED))
    ):
        period = table["period_ns"][table["period_ns"] > 0] * 1e-6
        for axes, values, title, unit in (
            (grid[row][0], period, f"{side}: period", "ms"),
            (grid[row][1], table["compute_ns"] * 1e-3, f"{side}: compute time", "µs"),
        ):
            _histogram(axes, values, colour)
            axes.set_title(title)
            axes.set_xlabel(f"{title.partition(': ')[2]} [{unit}]")
            axes.set_ylabel("ticks")
    return finished(figure, 2, above=0.4)


def _histogram(axes: Any, values: Array, colour: str) -> None:
    if not values.any():
        said = "not measured" if values.size else "no ticks"
        axes.text(0.5, 0.5, said, ha="center", va="center", transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return
    low, high = float(values.min()), float(values.max())
    room = max(0.05 * (high - low), 0.1 * high - 0.5 * (high - low), 1e-6)
    bins = np.linspace(low - room, high + room, 61)
    if high > 20.0 * low > 0.0:  # a few late ticks would leave all others in one bar
        bins = np.geomspace(0.9 * low, 1.1 * high, 61)
        axes.set_xscale("log")
    axes.hist(values, bins=bins, color=colour, histtype="stepfilled")
    axes.set_yscale("log")
    axes.minorticks_off()
    axes.set_ylim(0.7, 2.0 * values.size)
    p99 = float(np.percentile(values, 99.0))
    axes.axvline(p99, color=ERROR, linewidth=1.2, linestyle="--", label=f"99 % below {p99:.3g}")
    axes.legend(loc="upper right", fontsize="small")


def _close_up(time: Array, force: Array) -> NDArray[np.bool_]:
    """The last stretch of `ZOOM` seconds that ends with some contact: the estimate has had its time to settle."""
    touched = np.flatnonzero(force > 0.2 * _largest(force))
    end = time[touched[-1]] if touched.size else time[-1]
    length = min(ZOOM, 0.5 * (time[-1] - time[0]))
    begin = max(end - length, time[0])
    return np.asarray((time >= begin) & (time <= begin + 1.1 * length))


def _largest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0


def _say_beyond(axes: Any, values: Array, top: float, what: str) -> None:
    """Say in the axes how much of a curve they do not show; on a white ground, for it lies over the curves."""
    beyond = 100.0 * float(np.mean(~(values <= top))) if values.size else 0.0
    if beyond > 0.0:
        axes.text(
            0.995,
            0.96,
            f"{what} beyond the axis in {min(beyond, 99.9):.2g} % of samples (at most {_largest(values):.3g} N)",
            ha="right",
            va="top",
            transform=axes.transAxes,
            fontsize="small",
            bbox={"facecolor": "white", "edgecolor": "0.7", "linewidth": 0.6, "pad": 3.0},
        )


def _robust_range(axes: Any, values: Array) -> None:
    """Let the outermost hundredths go beyond the axis where they would flatten the rest, and say so."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    low, high = np.percentile(finite, [2.0, 98.0])
    room = 0.25 * (high - low) or 0.1 * max(abs(high), 1e-9)
    low, high = low - room, high + room
    outside = 100.0 * float(np.mean((finite < low) | (finite > high)))
    if outside > 0.0:
        axes.text(
            0.99,
            0.03,
            f"{outside:.2g} % beyond the axis",
            ha="right",
            va="bottom",
            transform=axes.transAxes,
            fontsize="small",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2.0},
        )
    else:
        low, high = min(low, finite.min()), max(high, finite.max())
    axes.set_ylim(low, high)


def _symbol_and_unit(name: str) -> tuple[str, str]:
    for quantity in QUANTITIES:
        if quantity.name == name:
            return quantity.symbol, quantity.unit
    return "", "SI"

"""The robot and the loops: its distance from the commands, what was cut, and how late the ticks of both sides were."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.errors import plural
from foretouch.messages import SessionLog
from foretouch.quantities import Array, new_figure
from foretouch.report.drawing import ERROR, PREDICTED, RENDERED, TRUE, curve, finished, legend, mark, note
from foretouch.report.numbers import Finding, figure, filled, number
from foretouch.report.rows import Pairs, Segment
from foretouch.report.sections import Drawing, Section, View
from foretouch.session.workspace import LINE

OFTEN_LATE = 0.1  # A loop that is late in more than this fraction of its ticks does not keep its rate

_MOTION = (
    "Motion and limits",
    "  robot      {tracking_error.rms_mm:mm} RMS from its commands, lag {tracking_error.lag_ms:ms}",
    "  commands   {commands.sent:,} sent, {commands.never_applied:,} never applied",
    "  leader     at most {max_rendered_force_N:N}, {largest_rendered_jump_N:N} in one tick, "
    "{clipped.leader:#tick} cut",
    "  follower   at most {max_follower_force_N:N}, {clipped.follower:#tick} cut",
    "",
)


def _cut(report: Mapping[str, Any]) -> Iterator[Finding]:
    for side, what in (("leader", "rendered force"), ("follower", "robot's command")):
        if report["clipped"][side]:
            yield Finding(f"The limits cut the {what} in {plural(report['clipped'][side], 'tick')}.")


def _tracking(view: View) -> Iterator[Drawing]:
    if view.pairs.time.size:
        yield Drawing(tracking_figure(view.pairs, view.away), "Position of the robot, and its tracking error")


def tracking_figure(pairs: Pairs, segments: Sequence[Segment] = ()) -> Any:
    """Commanded and actual position of the robot, and the distance between them."""
    figure = new_figure(5.0)
    above, apart = figure.subplots(2, 1, sharex=True)
    commanded, actual = 1e3 * pairs.leader["position"], 1e3 * pairs.follower["position"]
    curve(above, pairs.time, commanded, ERROR, 1.6, label="command that was applied")
    curve(above, pairs.time, actual, TRUE, 0.9, label="follower")
    above.set(title="Position of the robot at equal command", ylabel="position [mm]")
    for axes in (above, apart):
        mark(axes, segments)
    legend(above, columns=4)
    curve(apart, pairs.time, actual - commanded, PREDICTED, 0.9)
    apart.set(title="Tracking error: follower less command", ylabel="error [mm]", xlabel="time [s]")
    return finished(figure, 2, gap=0.5)


ROBOT = Section("robot", _cut, lambda report: [filled(line, report) for line in _MOTION])
TRACKING = Section("tracking", drawings=_tracking, of=(LINE,))


def _late(report: Mapping[str, Any]) -> Iterator[Finding]:
    for side in ("leader", "follower"):
        timing = report["timing"][side]
        late, ticks = timing["late_ticks"], timing["ticks"]
        if late > OFTEN_LATE * ticks and timing["ticks_per_s"] is not None:
            part = number(100.0 * late / ticks, "%")
            rate = filled("{ticks_per_s:.0f} of {rate:.0f} a second", timing)
            yield Finding(f"The {side}'s loop was late in {part} of its ticks: {rate}.")
    count, ticks = report["nowhere_samples"], report["timing"]["leader"]["ticks"]
    if count:
        often = f"{count:,} of {ticks:,} ticks ({figure(100.0 * count / ticks)} %)"
        yield Finding(f"The device gave no position in {often}: the last one was held.")


def _loop_lines(report: Mapping[str, Any]) -> Iterator[str]:
    yield "Loops (median / 99 % / largest) and messages"
    for side in ("leader", "follower"):
        timing = report["timing"][side]
        period, compute = _three(timing["period_ms"], "ms"), _three(timing["compute_us"], "us")
        late = filled("{late_ticks:,} of {ticks:,} ticks late", timing)
        yield f"  {side:<10} period {period}, compute {compute}, {late}"
    models = filled("  models     {models.sent:,} sent, {models.valid:,} valid, {models.used:,} used", report)
    size = report["model_bytes"]
    if size["per_s"] is not None and size["max"] is not None:
        models += filled(", {per_s:,.0f} bytes/s ({p50:,.0f} each, at most {max:,.0f})", size)
    yield models
    counted = ", ".join(f"{count:,} {name}" for name, count in report["messages"].items() if count is not None)
    yield f"  messages   {counted}"
    if report["recording"]:
        yield f"  recording  {report['recording']}"


def _three(spread: dict[str, float | None], unit: str) -> str:
    if spread["p50"] is None:
        return "-"
    return " / ".join(figure(spread[key] or 0.0) for key in ("p50", "p99", "max")) + f" {unit}"


def _timing(view: View) -> Iterator[Drawing]:
    if view.log.leader.size or view.log.follower.size:
        yield Drawing(timing_figure(view.log), "Loop periods and compute times of leader and follower")


def timing_figure(log: SessionLog) -> Any:
    """Intervals between the ticks of both sides, and their computing times."""
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
            axes.set(title=title, xlabel=f"{title.partition(': ')[2]} [{unit}]", ylabel="ticks")
    return finished(figure, 2, above=0.4)


def _histogram(axes: Any, values: Array, colour: str) -> None:
    if not values.any():
        note(axes, 0.5, 0.5, "not measured" if values.size else "no ticks")
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


LOOPS = Section("loops", _late, _loop_lines, _timing)

"""The forces of a session or of a prediction: what is wrong with them, as sentences, as a table and over time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from foretouch.identification.force_calibration import lowest_mean
from foretouch.quantities import Array, Flags, new_figure
from foretouch.report.drawing import (
    DELAYED,
    NARROW,
    PREDICTED,
    RENDERED,
    TRUE,
    corners,
    curve,
    extremes,
    finished,
    last_contact,
    legend,
    mark,
    note,
    peak,
    shade,
)
from foretouch.report.numbers import AS_IT_COMES, Finding, figure, filled, number
from foretouch.report.rows import Pairs, Segment, not_scored
from foretouch.report.scores import JND_FORCE, JND_SHARE, STATUSES
from foretouch.report.sections import Drawing, Section, View
from foretouch.session.operators import STAYS_IN_THE_AIR
from foretouch.session.workspace import LINE
from foretouch.settings import NO_BASELINE, SIMULATED, is_simulated

ZOOM = 4.0  # Length of the close-up [s], and of shorter recordings half of them
LEAST = 0.3  # The force axis reaches at least to this [N], so that noise does not fill it

MOST_IN_LOOPS, PIECE = 30_000, 2000
"""Samples of force against depth that are drawn, and in one line: no extremes can represent the rest of a loop."""

ROOM = 1.35  # The force axis reaches to this multiple of the largest measured or delayed force


def force_figure(
    time: Array,
    true_force: Array,
    predicted_force: Array,
    delayed_force: Array,
    rendered_force: Array | None = None,
    *,
    scored: Flags | None = None,
    wanted: str = "predicted",
    segments: Sequence[Segment] = (),
) -> Any:
    """Forces over time, a close-up, and their errors in it; the layout of the paper's Fig. 11 and more.

    The true force is less its zero; the segments are those in which the robot was not at its commanded position.
    """
    name = "measured" if rendered_force is None else "true (follower's sensor)"
    curves = [(name, true_force, TRUE, 1.6), ("delayed", delayed_force, DELAYED, 1.1)]
    if rendered_force is not None:
        curves.append(("rendered", rendered_force, RENDERED, 4.0))  # wide, under the predicted one
    curves.append((wanted, predicted_force, PREDICTED, 1.1))
    figure = new_figure(9.5)
    whole, near, error = figure.subplots(3, 1)
    top = ROOM * max(peak(true_force), peak(delayed_force), LEAST)
    begin, end = last_contact(time, true_force, min(ZOOM, 0.5 * (time[-1] - time[0])))
    inside = (time >= begin) & (time <= end)
    for axes, chosen in ((whole, np.ones(time.size, dtype=np.bool_)), (near, inside)):
        for label, force, colour, width in curves:
            alpha = 0.45 if force is rendered_force else 1.0
            curve(axes, time[chosen], force[chosen], colour, width, alpha=alpha, label=label)
        axes.set_ylim(-0.08 * top, top)
        axes.set(ylabel="force [N]", xlabel="time [s]")
        _say_beyond(axes, predicted_force[chosen], top, "predicted force")
    whole.set_title("Contact force at equal command")
    if scored is not None:
        shade(whole, time, scored, "#56B4E9", "scored")
    whole.axvspan(time[inside][0], time[inside][-1], color="0.5", alpha=0.15, linewidth=0.0, label="close-up below")
    near.set_title("Close-up")
    mark(whole, _within(segments, time))
    legend(whole, columns=6 if not segments else 4)
    noticed = np.maximum(JND_SHARE * true_force[inside], JND_FORCE)
    kept = extremes(noticed, NARROW)
    when, band, label = time[inside][kept], noticed[kept], "not noticed: max(10 %, 0.05 N)"
    error.fill_between(when, -band, band, color="0.5", alpha=0.3, linewidth=0.0, label=label)
    wrong = {
        kind: (force - true_force)[inside] for kind, force in (("delayed", delayed_force), (wanted, predicted_force))
    }
    for (label, values), colour in zip(wrong.items(), (DELAYED, PREDICTED), strict=True):
        curve(error, time[inside], values, colour, 1.1, label=label)
    widest = min(top, ROOM * max(peak(np.abs(wrong[wanted])), JND_FORCE))
    error.set_ylim(-widest, widest)
    for axes in (near, error):
        mark(axes, _within(segments, time[inside]))
    error.set(
        title=f"Error in the close-up, scaled to that of the {wanted} force: force less {name.split()[0]} force",
        ylabel="error [N]",
        xlabel="time [s]",
    )
    for kind, values in wrong.items():
        _say_beyond(error, np.abs(values), widest, f"error of the {kind} force")
    legend(error, columns=5)
    return finished(figure, 3, above=0.8 if segments else 0.6, gap=1.1)


def _within(segments: Sequence[Segment], time: Array) -> list[Segment]:
    """Those that begin before the last sample and end after the first."""
    return [one for one in segments if one.begin < time[-1] and one.end > time[0]]


def prediction_figure(
    time: Array, measured_force: Array, predicted_force: Array, delayed_force: Array, in_contact: Flags
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


def loop_figure(pairs: Pairs, true_force: Array, surface: float | None, wanted: str = "predicted") -> Any:
    """Force against depth: measured at the follower's position, and predicted at the hand's."""
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
    top = ROOM * max(peak(true_force), LEAST)
    axes.set_ylim(-0.08 * top, top)
    _say_beyond(axes, pairs.leader["predicted_force"], top, "predicted force")
    axes.set(
        title="Force against depth",
        xlabel="position [mm]" if surface is None else "depth, from the last surface that was sent [mm]",
        ylabel="force [N]",
    )
    legend(axes, columns=2)
    return finished(figure, 1)


def _say_beyond(axes: Any, values: Array, top: float, what: str) -> None:
    """Note in the axes which part of a curve they do not show, on white because it is over the curves."""
    beyond = 100.0 * float(np.mean(~(values <= top))) if values.size else 0.0
    if beyond > 0.0:
        text = f"{what} beyond the axis in {min(beyond, 99.9):.2g} % of samples (at most {peak(values):.3g} N)"
        box = {"facecolor": "white", "edgecolor": "0.7", "linewidth": 0.6, "pad": 3.0}
        note(axes, 0.995, 0.96, text, ha="right", va="top", fontsize="small", bbox=box)


def scoring_findings(figures: Mapping[str, Any]) -> list[Finding]:
    """Text on the scores of a session or of a prediction on a recording."""
    status = figures["status"]
    findings = [] if status == "ok" else [Finding(f"{status}: {STATUSES[status]}.")]
    error, late = figures["prediction_error_percent"], figures["delayed_force_error_percent"]
    models = figures.get("baseline", NO_BASELINE) == NO_BASELINE
    findings += _felt(figures)
    if error is not None and late and models:
        ratio, better = figure(error / late), _is_better(error, late)
        word = "better" if better else "no better" if ratio == figure(1.0) else "worse"
        findings.append(Finding(f"The predicted force is {word} than the delayed force (error x {ratio}).", better))
        if error > 100.0:
            text = f"It is wrong by more than the force itself ({figure(error)} %): the estimate is no use here."
            findings.append(Finding(text))
    within, missed = figures["within_jnd_percent"], figures["missed_contact_percent"]
    if within is not None and within < 100.0:
        what, part = "prediction" if models else "delayed force", figure(100.0 - within)
        findings.append(Finding(f"An operator could feel the {what}'s error in {part} % of the contact time."))
    if missed:
        findings.append(Finding(f"Contact was missed in {figure(missed)} % of the contact time."))
    return findings


def _felt(figures: Mapping[str, Any]) -> list[Finding]:
    """The headline of a session: the rendered force, which a hand feels, beside the predicted and the delayed one."""
    error, late = figures.get("rendered_error_percent"), figures["delayed_force_error_percent"]
    if error is None or late is None:
        return []
    predicted = figures["prediction_error_percent"]
    models = figures.get("baseline", NO_BASELINE) == NO_BASELINE
    beside = f"the predicted one by {figure(predicted)} %, " if models and predicted is not None else ""
    text = f"The rendered force is wrong by {figure(error)} %, {beside}the delayed one by {figure(late)} %."
    findings = [Finding(text, _is_better(error, late))]
    ratio = figure(error / late) if late else ""
    if models and ratio and error > late and ratio != figure(1.0):
        findings.append(Finding(f"The rendered force is worse than the delayed force (error x {ratio})."))
    within = figures["rendered_within_jnd_percent"]
    if within is not None and within < 100.0 and figures.get("baseline") != AS_IT_COMES:  # there they are one force
        noticed = figure(100.0 - within)
        findings.append(Finding(f"An operator could feel that it is wrong in {noticed} % of the contact time."))
    return findings


def _is_better(error: float, late: float) -> bool:
    """Whether an error is below that of the delayed force, as far as it is printed."""
    return error < late and figure(error / late) != figure(1.0)


SELDOM = 0.5
"""Fraction of the commands below which a report says at its top how many the robot carried out: others came too late,
out of order or not at all, and what a hand felt meanwhile is in no error."""


def _findings(report: Mapping[str, Any]) -> Iterator[Finding]:
    """Text on the scores, and on why a script that did not know where the surface is touched nothing."""
    yield from scoring_findings(report)
    sent, samples = report["counts"].get("commands_sent", 0), report["samples"]
    if samples < SELDOM * sent:
        yield Finding(f"The robot carried out {samples:,} of {sent:,} commands: the errors are of those alone.")
    settings = report["settings"]
    robot = settings.get("robot", SIMULATED)
    unknown = not is_simulated(robot) and "surface" not in settings
    if report["status"] == "no_contact" and unknown and settings.get("operator") == "browser":
        yield Finding(f"Robot {robot!r} {STAYS_IN_THE_AIR}.")


_CONTROLLED = ("asked for (by the controller)", "delayed (before the controller)")
_NAMES = {
    NO_BASELINE: ("predicted (newest model)", "delayed (never rendered)"),
    AS_IT_COMES: ("asked for (delayed force)", "delayed (what was rendered)"),
}
"""The rows of the wanted and of the delayed force, by baseline."""

_LEFT_OUT = {
    "away_samples": "the robot not following",
    "faulty_samples": "sensors not to be trusted",
    "nowhere_samples": "no position of the device",
}
"""Rows that are not scored, because the robot did not follow, its sensors failed, or the device did."""


def _lines(report: Mapping[str, Any]) -> Iterator[str]:
    wanted, late = _NAMES.get(report["baseline"], _CONTROLLED)
    guarded = filled(", {guarded_samples:,} guarded", report) if report["guarded_samples"] else ""
    scored = "{contact_force_rms_N:N} RMS, {scored_samples:,} of {samples:,} samples scored"
    yield f"Forces at equal command, force in contact {filled(scored, report)}{guarded}"
    if parts := [f"{report[name]:,} with {what}" for name, what in _LEFT_OUT.items() if report[name]]:
        yield f"  not scored: {', '.join(parts)}"
    yield f"  {'':<34}{'error':>12}{'RMSE':>12}{'within JND':>14}{'in free air':>14}"
    yield _row(report, "rendered (after limits)", "rendered", "rendered_within_jnd", "rendered_phantom")
    yield _row(report, wanted, "prediction", "within_jnd", "phantom")
    yield _row(report, late, "delayed_force")
    yield _row(report["equal_position"], "predicted at follower's position", "prediction", "within_jnd")
    if report["exact_force"]["contact_force_rms_N"] is not None:
        against = f"{wanted.partition(' (')[0]}, against exact force"
        yield _row(report["exact_force"], against, "prediction", "within_jnd")
    soon = "{time_to_ten_percent_s:s} after the first contact that is scored"
    if report["time_to_ten_percent_s"] is None:
        soon = "never, or not touched for long enough"
    yield f"  within 10 % over half a second of contact: {filled(soon, report)}"
    if report["standard_deviation"]["median_N"] is not None:
        honest = "{median_N:N} at the median: {within_one_percent:%} within one, {within_two_percent:%} within two"
        yield f"  its standard deviation, {filled(honest, report['standard_deviation'])}"
    yield ""


def _row(figures: Mapping[str, Any], name: str, of: str, within: str = "", phantom: str = "") -> str:
    """Error and RMSE of a force and, as far as they are named, how much of it is not noticed, and its part in air."""
    error, rmse = number(figures[f"{of}_error_percent"], "%"), number(figures[f"{of}_rmse_N"], "N")
    unnoticed = figures[f"{within}_percent"] if within else None
    in_air = figures[f"{phantom}_force_rms_N"] if phantom else None
    more = "" if unnoticed is None and in_air is None else f"{number(unnoticed, '%'):>14}"
    more += "" if in_air is None else f"{number(in_air, 'N'):>14}"
    return f"  {name:<34}{error:>12}{rmse:>12}{more}"


def _drawings(view: View) -> Iterator[Drawing]:
    """Forces over time."""
    pairs, report = view.pairs, view.report
    if not pairs.time.size:
        return
    end = pairs.time[-1] if report["score_to_s"] is None else min(report["score_to_s"], pairs.time[-1])
    scored = (pairs.time >= report["score_from_s"]) & (pairs.time <= end) & ~not_scored(pairs)
    columns = (pairs.leader[f"{kind}_force"] for kind in ("predicted", "delayed", "rendered"))
    shown = {"scored": scored, "wanted": view.wanted, "segments": view.away}
    forces = force_figure(pairs.time, _true_force(pairs), *columns, **shown)
    yield Drawing(forces, "True, predicted, delayed and rendered force over time, and the errors")


def _true_force(pairs: Pairs) -> Array:
    force: Array = pairs.follower["sensor_force"]
    return force - lowest_mean(pairs.time, force)


def _loop(view: View) -> Iterator[Drawing]:
    """Forces over the depth, where something was touched."""
    pairs = view.pairs
    if pairs.follower["in_contact"].any():
        surfaces = [model.surface for model in view.log.models if model.valid and np.isfinite(model.surface)]
        loop = loop_figure(pairs, _true_force(pairs), surfaces[-1] if surfaces else None, view.wanted)
        yield Drawing(loop, "Force against depth, true and predicted")


FORCES = Section("forces", _findings, _lines, _drawings)
LOOP = Section("loop", drawings=_loop, of=(LINE,))

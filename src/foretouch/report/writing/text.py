"""The report of a session as plain text, to be read at a glance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from foretouch.errors import plural
from foretouch.report.hand import AS_IT_COMES, NO_BASELINE
from foretouch.report.numbers import figure, number, parameter_text
from foretouch.report.phases import late_sentences, nowhere_sentence, out_of_reach, phase_lines, pressed
from foretouch.report.scores import STATUSES
from foretouch.report.writing.hand_text import (
    baseline_sentence,
    device_sentence,
    guard_sentence,
    hand_lines,
    instability,
    phantom_sentence,
    stability,
    withheld_sentence,
)
from foretouch.report.writing.safety_text import lasted, safety_lines, safety_sentences, stretch_sentence
from foretouch.report.writing.scene_text import scene_lines, scene_sentences

IDLE_LAW = "the law's share of the force is 0 %: these numbers play no part in it"
"""What is said beside the numbers of a contact map's law where that holds."""

INSECURE = "INSECURE: nothing was encrypted and nobody was checked; anybody on the network could command."


def render_text(report: Mapping[str, Any]) -> str:
    """The report of a session for a terminal.

    Args:
        report: What `session_report` gave.

    Returns:
        Lines of at most about 100 characters, without a last line break.
    """
    parts = [
        _heading(report),
        *(finding.text for finding in findings(report)),
        "",
        *phase_lines(report),
        *_forces(report),
        *_perception(report),
        *_doubt(report),
        "",
        *hand_lines(report),
        "",
        *scene_lines(report),
        *safety_lines(report),
        *_learnt(report),
        *_motion(report),
        "",
        *_machine(report),
    ]
    if report["recording"]:
        parts.append(f"  recording  {report['recording']}")
    return "\n".join(parts)


_OF_THE_HAND = (withheld_sentence, guard_sentence, phantom_sentence, device_sentence)


class Finding(NamedTuple):
    """One plain sentence about a session, and whether it is good news."""

    text: str
    good: bool


def findings(report: Mapping[str, Any]) -> list[Finding]:
    """What the numbers of a session say, one plain sentence each; what is worst comes first."""
    insecure = report["settings"].get("insecure") == "yes"
    said = [
        Finding(INSECURE if insecure else "", False),
        *(Finding(text, False) for text in safety_sentences(report)),
        *(Finding(text, False) for text in (*late_sentences(report), nowhere_sentence(report))),
        Finding(instability(report), False),
        Finding(stability(report), True),
        *(Finding(sentence(report), False) for sentence in _OF_THE_HAND),
        *(Finding(text, False) for text in scene_sentences(report)),
    ]
    said += [*scoring_findings(report), Finding(out_of_reach(report), False)]
    said = [finding for finding in said if finding.text]
    for side, what in (("leader", "rendered force"), ("follower", "robot's command")):
        if report["clipped"][side]:
            said.append(Finding(f"The limits cut the {what} in {plural(report['clipped'][side], 'tick')}.", False))
    if report["samples"] and not report["models"]["valid"]:
        said.append(Finding("No valid contact model was ever identified: nothing could be predicted.", False))
    return said


def scoring_findings(figures: Mapping[str, Any]) -> list[Finding]:
    """What the scores say, of a session or of a prediction on a recording."""
    status = figures["status"]
    said = [] if status == "ok" else [Finding(f"{status}: {STATUSES[status]}.", False)]
    error, late = figures["prediction_error_percent"], figures["delayed_force_error_percent"]
    models = figures.get("baseline", NO_BASELINE) == NO_BASELINE
    said += _felt(figures)
    if error is not None and late and models:
        ratio, better = figure(error / late), _is_better(error, late)
        word = "better" if better else "no better" if ratio == figure(1.0) else "worse"
        said.append(Finding(f"The predicted force is {word} than the delayed force (error x {ratio}).", better))
        if error > 100.0:
            text = f"It is wrong by more than the force itself ({figure(error)} %): the estimate is no use here."
            said.append(Finding(text, False))
    within, missed = figures["within_jnd_percent"], figures["missed_contact_percent"]
    if within is not None and within < 100.0:
        what = "prediction" if models else "delayed force"
        text = f"An operator could feel the {what}'s error in {figure(100.0 - within)} % of the contact time."
        said.append(Finding(text, False))
    if missed:
        said.append(Finding(f"Contact was missed in {figure(missed)} % of the contact time.", False))
    return said


def _felt(figures: Mapping[str, Any]) -> list[Finding]:
    """The headline of a session: the rendered force, which a hand feels, beside the predicted and the delayed one."""
    error, late = figures.get("rendered_error_percent"), figures["delayed_force_error_percent"]
    if error is None or late is None:
        return []
    predicted = figures["prediction_error_percent"]
    models = figures.get("baseline", NO_BASELINE) == NO_BASELINE
    beside = f"the predicted one by {figure(predicted)} %, " if models and predicted is not None else ""
    text = f"The rendered force is wrong by {figure(error)} %, {beside}the delayed one by {figure(late)} %."
    said = [Finding(text, _is_better(error, late))]
    ratio = figure(error / late) if late else ""
    if models and ratio and error > late and ratio != figure(1.0):
        said.append(Finding(f"The rendered force is worse than the delayed force (error x {ratio}).", False))
    within = figures["rendered_within_jnd_percent"]
    if within is not None and within < 100.0 and figures.get("baseline") != AS_IT_COMES:  # there they are one force
        share = figure(100.0 - within)
        said.append(Finding(f"An operator could feel that it is wrong in {share} % of the contact time.", False))
    return said


def _is_better(error: float, late: float) -> bool:
    """Whether an error is below that of the delayed force, as far as it is printed."""
    return error < late and figure(error / late) != figure(1.0)


def _heading(report: Mapping[str, Any]) -> str:
    chosen = report["settings"]
    words = [lasted(report), *(f"{name} {what}" for name, what in pressed(chosen).items())]
    for name, unit in _SHOWN.items():
        if chosen.get(name):
            words.append(f"{name.replace('_', ' ')} {chosen[name]}{unit}")
    loop = report["loop"]
    said = stretch_sentence(report), f"{loop[:1].upper()}{loop[1:]}.", baseline_sentence(report)
    lines = [f"Session: {', '.join(words)}", *said]
    return "\n".join(line for line in lines if line)


_SHOWN = {"operator": "", "estimator": "", "position_delay": " s", "force_delay": " s"}


def _forces(report: Mapping[str, Any]) -> list[str]:
    equal, exact = report["equal_position"], report["exact_force"]
    wanted, late = _NAMES.get(report["baseline"], _CONTROLLED)
    guarded = f", {report['guarded_samples']:,} guarded" if report["guarded_samples"] else ""
    contact = f"force in contact {number(report['contact_force_rms_N'], 'N')} RMS"
    scored = f"{report['scored_samples']:,} of {report['samples']:,} samples scored{guarded}"
    lines = [
        f"Forces at equal command, {contact}, {scored}",
        *_left_out(report),
        f"  {'':<34}{'error':>12}{'RMSE':>12}{'within JND':>14}{'in free air':>14}",
        _row(
            "rendered (after limits)",
            report["rendered_error_percent"],
            report["rendered_rmse_N"],
            report["rendered_within_jnd_percent"],
            report["rendered_phantom_force_rms_N"],
        ),
        _row(
            wanted,
            report["prediction_error_percent"],
            report["prediction_rmse_N"],
            report["within_jnd_percent"],
            report["phantom_force_rms_N"],
        ),
        _row(
            late,
            report["delayed_force_error_percent"],
            report["delayed_force_rmse_N"],
        ),
    ]
    if "scene" not in report:  # what is compared at one position is of a line
        lines.append(
            _row(
                "predicted at follower's position",
                equal["prediction_error_percent"],
                equal["prediction_rmse_N"],
                equal["within_jnd_percent"],
            )
        )
    if exact["contact_force_rms_N"] is not None:
        lines.append(
            _row(
                f"{wanted.partition(' (')[0]}, against exact force",
                exact["prediction_error_percent"],
                exact["prediction_rmse_N"],
                exact["within_jnd_percent"],
            )
        )
    return lines


def _left_out(report: Mapping[str, Any]) -> list[str]:
    """What is not scored because the robot did not follow, its sensors failed, or the device did."""
    named = (
        ("away_samples", "the robot not following"),
        ("faulty_samples", "sensors not to be trusted"),
        ("nowhere_samples", "no position of the device"),
    )
    said = [f"{report[name]:,} with {what}" for name, what in named if report[name]]
    return [f"  not scored: {', '.join(said)}"] if said else []


_CONTROLLED = ("asked for (by the controller)", "delayed (before the controller)")
_NAMES = {
    NO_BASELINE: ("predicted (newest model)", "delayed (never rendered)"),
    AS_IT_COMES: ("asked for (delayed force)", "delayed (what was rendered)"),
}
"""The rows of the wanted and of the delayed force, by baseline."""


def _row(
    name: str, error: float | None, rmse: float | None, within: float | None = None, phantom: float | None = None
) -> str:
    more = "" if within is None and phantom is None else f"{number(within, '%'):>14}"
    more += "" if phantom is None else f"{number(phantom, 'N'):>14}"
    return f"  {name:<34}{number(error, '%'):>12}{number(rmse, 'N'):>12}{more}"


def _perception(report: Mapping[str, Any]) -> list[str]:
    """How soon the prediction is right."""
    soon = number(report["time_to_ten_percent_s"], "s")
    accurate = "never, or not touched for long enough" if soon == "-" else f"{soon} after the first touch"
    return [f"  within 10 % over half a second of contact: {accurate}"]


def _doubt(report: Mapping[str, Any]) -> list[str]:
    """How far the prediction's own standard deviation can be believed."""
    doubt = report["standard_deviation"]
    if doubt["median_N"] is None:
        return []
    one, two = number(doubt["within_one_percent"], "%"), number(doubt["within_two_percent"], "%")
    return [
        f"  its standard deviation, {number(doubt['median_N'], 'N')} at the median: {one} within one, {two} within two"
    ]


def _learnt(report: Mapping[str, Any]) -> list[str]:
    """The last model: the law's numbers, and what a contact map is beside them."""
    if report["parameters"] is None:
        return []
    numbers = parameter_text(report["parameters"], report["standard_errors"])
    lines = ["What was learnt, at the end", f"  law        {numbers}"]
    if report["map"] is not None:
        lines += [f"{'':<13}({IDLE_LAW})"] if law_is_idle(report["map"]) else []
        lines += [f"  map        {line}" for line in map_lines(report["map"])]
    return [*lines, ""]


def law_is_idle(figures: Mapping[str, Any]) -> bool:
    """Whether the law's share of a contact map's force is 0 % as it is printed.

    Args:
        figures: By name, as `foretouch.models.MapSummary.figures` gives them.
    """
    return f"{100.0 * figures['shares'].get('law', 1.0):.0f}" == "0"


def map_lines(figures: Mapping[str, Any]) -> list[str]:
    """A contact map as lines for a terminal.

    Args:
        figures: By name, as `foretouch.models.MapSummary.figures` gives them.

    Returns:
        Shares of the experts and what was visited; local stiffness; doubt.
    """
    shares = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in figures["shares"].items())
    depth, speed = 1e3 * figures["depth_visited_m"], 1e3 * figures["speed_visited_m_per_s"]
    lines = [f"shares: {shares}; visited: {figure(depth)} mm, {figure(speed)} mm/s"]
    at = zip(figures["depths_m"], figures["local_stiffness_N_per_m"], figures["forces_N"], strict=True)
    places = [f"{figure(k)} N/m at {figure(1e3 * x)} mm ({figure(force)} N)" for x, k, force in at]
    if places:
        lines.append(f"at rest: {', '.join(places)}")
    if figures["standard_deviation_N"] is not None:
        lines.append(f"standard deviation of the last force in contact: {number(figures['standard_deviation_N'], 'N')}")
    return lines


def _motion(report: Mapping[str, Any]) -> list[str]:
    tracking, commands, clipped = report["tracking_error"], report["commands"], report["clipped"]
    rendered = number(report["max_rendered_force_N"], "N")
    jump = number(report["largest_rendered_jump_N"], "N")
    rms, lag = number(tracking["rms_mm"], "mm"), number(tracking["lag_ms"], "ms")
    felt = number(report["max_follower_force_N"], "N")
    return [
        "Motion and limits",
        f"  robot      {rms} RMS from its commands, lag {lag}",
        f"  commands   {commands['sent']:,} sent, {commands['never_applied']:,} never applied",
        f"  leader     at most {rendered}, {jump} in one tick, {plural(clipped['leader'], 'tick')} cut",
        f"  follower   at most {felt}, {plural(clipped['follower'], 'tick')} cut",
    ]


def _machine(report: Mapping[str, Any]) -> list[str]:
    lines = ["Loops (median / 99 % / largest) and messages"]
    for side in ("leader", "follower"):
        timing = report["timing"][side]
        period, compute = timing["period_ms"], timing["compute_us"]
        lines.append(
            f"  {side:<10} period {_three(period, 'ms')}, compute {_three(compute, 'us')}, "
            f"{timing['late_ticks']:,} of {timing['ticks']:,} ticks late"
        )
    models, messages = report["models"], report["messages"]
    counted = ", ".join(f"{count:,} {name}" for name, count in messages.items() if count is not None)
    weight, size = "", report["model_bytes"]
    if size["per_s"] is not None and size["max"] is not None:
        weight = f", {size['per_s']:,.0f} bytes/s ({size['p50']:,.0f} each, at most {size['max']:,.0f})"
    lines.append(f"  models     {models['sent']:,} sent, {models['valid']:,} valid, {models['used']:,} used{weight}")
    lines.append(f"  messages   {counted}")
    return lines


def _three(spread: dict[str, float | None], unit: str) -> str:
    if spread["p50"] is None:
        return "-"
    return " / ".join(figure(spread[key] or 0.0) for key in ("p50", "p99", "max")) + f" {unit}"

"""The report as one HTML page that needs nothing else, with the figures of the hand and of its energy."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.identification.force_calibration import lowest_mean
from foretouch.messages import SessionLog
from foretouch.models import LAWS
from foretouch.quantities import Rows, new_figure
from foretouch.report.energy import ROUNDING, Account, booked_device, energy_account
from foretouch.report.hand import FELT, NO_BASELINE, NO_GRIP, apart, number_of
from foretouch.report.numbers import number
from foretouch.report.pairs import Pairs, not_scored, pair
from foretouch.report.phases import pressed
from foretouch.report.scene.drawing import contact_figure, map_figure, pose_figure
from foretouch.report.scene.map import map_figures
from foretouch.report.scene.pose import has_scene
from foretouch.report.scene.scene import SceneFindings, look_at_scene
from foretouch.report.statuses import away, follower_away
from foretouch.report.writing.drawing import DELAYED, ERROR, PREDICTED, RENDERED, TRUE, finished, legend, shade
from foretouch.report.writing.figures import (
    force_figure,
    loop_figure,
    model_figure,
    prediction_figure,
    timing_figure,
    tracking_figure,
)
from foretouch.report.writing.hand_text import baseline_sentence, stability_word
from foretouch.report.writing.html import embedded, named_values, tiles, write_html
from foretouch.report.writing.safety_text import lasted, stretch_sentence
from foretouch.report.writing.text import Finding, findings, render_text, scoring_findings
from foretouch.report.writing.thinning import NARROW, extremes, thinned

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CLOSE_UP = 4.0
"""Length of the close-up [s]."""

WIDE = 4.0
"""Width of a curve that lies under another one."""


def energy_figure(leader: Rows, account: Account) -> Any:
    """The energy account of all contacts, and the same near its bound, which it may not cross.

    Args:
        leader: Rows of `SessionLog.leader`, at least one.
        account: What `energy_account` made of them.
    """
    figure = new_figure(6.4)
    whole, near = figure.subplots(2, 1, sharex=True)
    time = _time(leader)
    energy, bound = 1e3 * account.energy, 1e3 * account.bound
    shade(whole, time, leader["rendered_force"] > FELT, "0.5", "in contact")
    for axes in (whole, near):
        axes.plot(*thinned(time, energy), color=PREDICTED, linewidth=1.0, label="energy that the hand has put in")
        axes.set_ylabel("energy [mJ]")
    whole.set_title("Energy account: debts are kept, surplus is forgiven after each contact")
    legend(whole, columns=2)
    near.plot(
        *thinned(time, -bound), color=ERROR, linewidth=1.0, label="its bound: a tick, the delay, an encoder count"
    )
    deepest = _largest(bound) or max(_largest(-energy), 1e-6)
    near.set_ylim(-1.4 * deepest, 1.4 * deepest)
    kept = extremes(bound, NARROW)
    near.fill_between(
        time[kept], -bound[kept], -1.4 * deepest, color=ERROR, alpha=0.15, linewidth=0.0, label="not allowed"
    )
    broken = np.where(energy + bound < -1e3 * ROUNDING, energy, np.nan)
    if np.isfinite(broken).any():
        kept = extremes(broken, NARROW)  # with dots, for a single tick makes no line
        near.plot(time[kept], broken[kept], ".-", color=TRUE, linewidth=2.2, markersize=4.4, label="bound broken")
    near.set_title("The same, close to the bound")
    near.locator_params(axis="y", nbins=5)
    near.set_xlabel("time [s]")
    legend(near, columns=5)
    return finished(figure, 2)


def hand_figure(log: SessionLog, pairs: Pairs, burst_at: float | None = None) -> Any:
    """What the hand meant, what it did, and where it was for the follower, with the force that it was given.

    Args:
        log: The session, with at least one row of the leader.
        pairs: Its rows at equal command: they tell which commands the follower held back.
        burst_at: Where the close-up is to begin, because the hand oscillates there [s]; None for the first contact.
    """
    leader = log.leader
    time = _time(leader)
    figure = new_figure(9.5)
    place, near, force = figure.subplots(3, 1)
    hand = leader["exact_hand_position"]
    hand = np.where(np.isfinite(hand), hand, leader["hand_position"])
    proxy = hand - apart(log) / number_of(log.settings, "position_scale", 1.0)
    held = np.isin(leader["sequence"], pairs.leader["sequence"][pairs.follower["guarded"]])
    elsewhere = _heard_away(log)
    curves = (
        ("meant", leader["intended_position"], ERROR, 1.4),
        ("hand", hand, TRUE, WIDE),  # under the proxy, which is mostly where the hand is
        ("proxy: where the robot is told to be", proxy, PREDICTED, 1.2),
    )
    inside = _close_up(time, leader["rendered_force"], burst_at)
    for axes, chosen in ((place, np.ones(time.size, dtype=np.bool_)), (near, inside), (force, inside)):
        shade(axes, time[chosen], held[chosen], DELAYED, "robot held back by the guard")
        shade(axes, time[chosen], ~leader["engaged"][chosen], "0.5", "not coupled")
        shade(axes, time[chosen], elsewhere[chosen], "#CC79A7", "told that the robot does not follow")
        if axes is not force:
            for label, values, colour, width in curves:
                alpha = 0.45 if width == WIDE else 1.0
                curve = thinned(time[chosen], 1e3 * values[chosen])
                axes.plot(*curve, color=colour, linewidth=width, alpha=alpha, label=label)
            axes.set_ylabel("position [mm]")
            axes.set_xlabel("time [s]")
    place.axvspan(time[inside][0], time[inside][-1], color="#56B4E9", alpha=0.15, linewidth=0.0, label="close-up below")
    place.set_title("The hand")
    legend(place, columns=6 if not elsewhere.any() else 4)
    near.set_title("Close-up")
    given = leader["rendered_force"][inside]
    rendered = "rendered: what the hand was given"
    force.plot(*thinned(time[inside], given), color=RENDERED, linewidth=WIDE, alpha=0.45, label=rendered)
    asked = leader["mediated_force"][inside]
    force.plot(*thinned(time[inside], asked), color=PREDICTED, linewidth=1.1, label="asked for, before the limits")
    top = 1.1 * max(_largest(given), _largest(asked), 0.1)
    force.set_ylim(-0.05 * top, top)
    force.set_title("Force in the close-up")
    force.set_ylabel("force [N]")
    force.set_xlabel("time [s]")
    legend(force, columns=4)
    for axes in (near, force):
        axes.set_xlim(time[inside][0], time[inside][-1])
    return finished(figure, 3, above=0.8 if elsewhere.any() else 0.6, gap=1.1)


def _heard_away(log: SessionLog) -> Flags:
    """At which ticks of the leader the newest that it had heard of the robot was that it does not follow."""
    leader, follower = log.leader, log.follower
    if not follower.size:
        return np.zeros(leader.size, dtype=np.bool_)
    newest = np.searchsorted(follower["sequence"], leader["telemetry_sequence"], side="right") - 1
    return np.asarray((newest >= 0) & (away(follower) & (follower["command_sequence"] > 0))[newest])


def _time(leader: Rows) -> Array:
    """Since the leader's first tick [s]."""
    return np.asarray((leader["time_ns"] - leader["time_ns"][0]) * 1e-9)


def _close_up(time: Array, force: Array, burst_at: float | None) -> Flags:
    """From shortly before an oscillation on, or else before the first contact: there models and hand meet."""
    felt = time[force > FELT]
    first = felt[0] if felt.size else time[0]
    begin = max((first if burst_at is None else burst_at) - 0.2 * CLOSE_UP, time[0])
    return np.asarray((time >= begin) & (time <= begin + CLOSE_UP))


def _largest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0


def write_page(
    directory: str | PathLike[str], log: SessionLog, report: dict[str, Any], made: Mapping[str, Any] | None = None
) -> Path:
    """Write the report of a session with its figures as ``index.html``; it makes no request to anywhere.

    Args:
        directory: Made if it is not there.
        log: The session.
        report: What `session_report` gave of it.
        made: What made it, for the end of the page, as `write_html` takes it.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    body = [
        "<h1>foretouch session</h1>",
        f'<p class="quiet">{escape(_summary(report))}</p>',
        *_sentences([Finding(said, False) for said in (stretch_sentence(report), baseline_sentence(report)) if said]),
        *_sentences(findings(report)),
        _tiles(report, {"stable": stability_word(report)}),
        *_session_figures(log, report),
        "<h2>Settings</h2>",
        named_values(report["settings"] or {"settings": "not recorded"}),
        "<h2>All figures</h2>",
        f"<pre>{escape(render_text(report))}</pre>",
    ]
    return write_html(directory, "foretouch session", body, made)


def write_prediction_page(
    directory: str | PathLike[str],
    name: str,
    forces: Mapping[str, ArrayLike],
    figures: Mapping[str, Any],
    made: Mapping[str, Any] | None = None,
) -> Path:
    """Write what became of a prediction on a recording as ``index.html``.

    Args:
        directory: Made if it is not there.
        name: Of the recording, for the heading.
        forces: Columns ``time_s``, ``measured_force_N``, ``predicted_force_N``, ``delayed_force_N`` and
            ``in_contact``, shape (n,).
        figures: The figures by name, among them ``delay_s`` and ``status``, as ``predict --json`` prints them; where
            there are ``remarks``, they are said first.
        made: What made it, for the end of the page, as `write_html` takes it.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    status, remarks = figures["status"], figures.get("remarks", ())
    figures = {key: value for key, value in figures.items() if key != "remarks"}
    told = {status} if any(remark.startswith(f"{status}: ") for remark in remarks) else set()
    by = "".join(f"{what.capitalize()}: {made[what]}. " for what in ("law", "estimator") if made and what in made)
    said = f"{by}Forces known {figures['delay_s']:g} s late. Status: {status}."
    body = [
        f"<h1>Prediction on {escape(name)}</h1>",
        f'<p class="quiet">{escape(said)}</p>',
        *_sentences([Finding(remark, False) for remark in remarks]),
        *_sentences([finding for finding in scoring_findings(figures) if finding.text.partition(":")[0] not in told]),
        _tiles(figures),
    ]
    columns = {key: np.asarray(column) for key, column in forces.items()}
    if columns["time_s"].size:
        measured, predicted, known = (columns[f"{kind}_force_N"] for kind in ("measured", "predicted", "delayed"))
        time = columns["time_s"] - columns["time_s"][0]
        drawn = prediction_figure(time, measured, predicted, known, columns["in_contact"].astype(np.bool_))
        body.append(embedded(drawn, "Measured, predicted and delayed force over time, and the errors"))
    body += ["<h2>All figures</h2>", named_values(figures)]
    return write_html(directory, f"Prediction on {name}", body, made)


def _sentences(said: list[Finding]) -> list[str]:
    return [f'<p class="{"good" if finding.good else "bad"}">{escape(finding.text)}</p>' for finding in said]


def _summary(report: dict[str, Any]) -> str:
    chosen = report["settings"]
    named = (f"{name} {what}" if name == "robot" else what for name, what in pressed(chosen).items())
    words = [lasted(report), *named, *filter(None, [chosen.get("operator")])]
    return f"{', '.join(words)}; {report['loop']}. Status: {report['status']}."


def _tiles(report: Mapping[str, Any], words: Mapping[str, str] | None = None) -> str:
    shown = (
        ("rendered_error_percent", "%", "error of the rendered force"),
        ("prediction_error_percent", "%", "error of the predicted force"),
        ("delayed_force_error_percent", "%", "error of the delayed force"),
        ("rendered_within_jnd_percent", "%", "of contact rendered within what is noticed"),
        ("within_jnd_percent", "%", "of contact predicted within what is noticed"),
        ("phantom_force_rms_N", "N", "predicted in free air, RMS"),
        ("contact_force_rms_N", "N", "contact force, RMS"),
        ("largest_update_jump_N", "N", "largest jump by a new model"),
        ("time_to_ten_percent_s", "s", "from first touch to an error below 10 %"),
    )
    figures = [(number(report[key], unit), label) for key, unit, label in shown if key in report]
    return tiles([*((value, label) for label, value in (words or {}).items()), *figures])


def _session_figures(log: SessionLog, report: dict[str, Any]) -> list[str]:
    """Those figures that the session has something to show in."""
    log = log.longest_phase()
    pairs = pair(log)
    start = int(pairs.follower["time_ns"][0]) if pairs.time.size else log.models[0].time_ns if log.models else 0
    away = follower_away(log, start)
    drawn = []
    if pairs.time.size:
        true_force = pairs.follower["sensor_force"] - lowest_mean(pairs.time, pairs.follower["sensor_force"])
        end = pairs.time[-1] if report["score_to_s"] is None else min(report["score_to_s"], pairs.time[-1])
        scored = (pairs.time >= report["score_from_s"]) & (pairs.time <= end)
        scored &= ~not_scored(pairs)
        wanted = "predicted" if report["baseline"] == NO_BASELINE else "asked for"
        columns = (pairs.leader[f"{kind}_force"] for kind in ("predicted", "delayed", "rendered"))
        forces = force_figure(pairs.time, true_force, *columns, scored=scored, wanted=wanted, stretches=away)
        drawn.append(embedded(forces, "True, predicted, delayed and rendered force over time, and the errors"))
    scene = look_at_scene(log, pairs) if has_scene(log) else None
    if scene is not None:
        drawn += _scene_figures(log, pairs, scene, start)
    if scene is None and pairs.time.size and pairs.follower["in_contact"].any():
        surfaces = [model.surface for model in log.models if model.valid and np.isfinite(model.surface)]
        loop = loop_figure(pairs, true_force, surfaces[-1] if surfaces else None, wanted)
        drawn.append(embedded(loop, "Force against depth, true and predicted"))
    if report["hand"]["grip"] != NO_GRIP and log.leader.size:
        swings = report["hand"]["oscillation"]
        hand = hand_figure(log, pairs, swings["largest_burst_at_s"] if swings["oscillates"] else None)
        drawn.append(embedded(hand, "The hand: what it meant, what it did, and what it was given"))
    if (log.leader["energy_bound"] > 0.0).any():
        leader = log.leader if scene is None else scene.rows.leader
        account = energy_account(leader, booked_device(log.settings)) if scene is None else scene.account
        drawn.append(embedded(energy_figure(leader, account), "Energy account of the session, and its bound"))
    if any(model.law in LAWS for model in log.models):
        drawn.append(embedded(model_figure(log.models, start, away), "Identified parameters over time"))
    if scene is None and pairs.time.size:
        drawn.append(embedded(tracking_figure(pairs, away), "Position of the robot, and its tracking error"))
    if log.leader.size or log.follower.size:
        drawn.append(embedded(timing_figure(log), "Loop periods and compute times of leader and follower"))
    return drawn


def _scene_figures(log: SessionLog, pairs: Pairs, scene: SceneFindings, start_ns: int) -> list[str]:
    """What there is to show of a session in three dimensions alone."""
    drawn = []
    if np.isfinite(scene.pose.place).any():
        said = "Error of the fixture's pose as the leader shows it, place and turn"
        drawn.append(embedded(pose_figure(scene.pose), said))
    if scene.wrong is not None and pairs.time.size:
        friction = None if scene.scene is None else scene.scene.friction
        contacts = contact_figure(log, pairs, scene.wrong, friction, start_ns)
        drawn.append(embedded(contacts, "False and missed contacts at equal command, and the friction that was learnt"))
    if scene.map is not None and scene.map.touched.any() and scene.field is not None and scene.scene is not None:
        found = map_figures(scene.map, scene.field, scene.scene)["inclusion"]
        centre = () if found is None else found["centre_mm"]
        drawn.append(
            embedded(
                map_figure(scene.map, scene.scene.inclusion if found else None, centre=centre),
                "Local stiffness over the surface: true, learnt, and its doubt",
            )
        )
    return drawn

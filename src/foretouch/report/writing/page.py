"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foretouch.identification.force_calibration import lowest_mean
from foretouch.messages import SessionLog
from foretouch.models import LAWS
from foretouch.report.energy import booked_device, energy_account
from foretouch.report.hand import NO_BASELINE, NO_GRIP
from foretouch.report.numbers import number
from foretouch.report.pairs import Pairs, not_scored, pair
from foretouch.report.phases import pressed
from foretouch.report.scene.drawing import contact_figure, map_figure, pose_figure
from foretouch.report.scene.map import map_figures
from foretouch.report.scene.pose import has_scene
from foretouch.report.scene.scene import SceneFindings, look_at_scene
from foretouch.report.statuses import follower_away
from foretouch.report.writing.figures import (
    force_figure,
    loop_figure,
    model_figure,
    prediction_figure,
    timing_figure,
    tracking_figure,
)
from foretouch.report.writing.hand_drawing import energy_figure, hand_figure
from foretouch.report.writing.hand_text import baseline_sentence, stability_word
from foretouch.report.writing.html import embedded, named_values, tiles, write_html
from foretouch.report.writing.safety_text import lasted, stretch_sentence
from foretouch.report.writing.text import Finding, findings, render_text, scoring_findings


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

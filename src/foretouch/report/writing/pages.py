"""The pages of a session, of a prediction on a recording and of a sensor calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foretouch.identification import SeriesCompliance, ToolWeight
from foretouch.messages import SessionLog
from foretouch.quantities import in_words, new_figure
from foretouch.report.drawing import COLOURS, finished, legend
from foretouch.report.numbers import Finding, number
from foretouch.report.pairs import pair
from foretouch.report.scene.pose import has_scene
from foretouch.report.scene.scene import look_at_scene
from foretouch.report.section import View
from foretouch.report.sections.energy import stability_word
from foretouch.report.sections.forces import prediction_figure, scoring_findings
from foretouch.report.sections.session import baseline_sentence, lasted, pressed, segment_sentence
from foretouch.report.statuses import follower_away
from foretouch.report.writing.html import embedded, named_values, table, tiles, write_html
from foretouch.report.writing.text import SECTIONS, findings, render_text
from foretouch.session import SessionSettings
from foretouch.settings import SETTINGS


def write_page(
    directory: str | PathLike[str], log: SessionLog, report: dict[str, Any], made: Mapping[str, Any] | None = None
) -> Path:
    """Write the report of a session with its figures as ``index.html``; it makes no request to anywhere.

    Args:
        directory: Made if it is not there.
        log: The session.
        report: What `session_figures` gave of it.
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
        *_sentences([Finding(said) for said in (segment_sentence(report), baseline_sentence(report)) if said]),
        *_sentences(findings(report)),
        _tiles(report, {"stable": stability_word(report)}),
        *_drawn(log, report),
        "<h2>Settings</h2>",
        _settings(report["settings"]),
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
        *_sentences([Finding(remark) for remark in remarks]),
        *_sentences([finding for finding in scoring_findings(figures) if finding.text.partition(":")[0] not in told]),
        _tiles(figures),
    ]
    columns = {key: np.asarray(column) for key, column in forces.items()}
    if columns["time_s"].size:
        measured, predicted, known = (columns[f"{kind}_force_N"] for kind in ("measured", "predicted", "delayed"))
        time = columns["time_s"] - columns["time_s"][0]
        drawn = prediction_figure(time, measured, predicted, known, columns["in_contact"].astype(np.bool_))
        body.append(embedded(drawn, "Measured, predicted and delayed force over time, and the errors"))
    shown = ((*in_words(name), value) for name, value in figures.items())
    rows = [(words, f"{value:.4g} {unit}" if isinstance(value, float) else value) for words, unit, value in shown]
    body += ["<h2>All figures</h2>", table((), rows)]
    return write_html(directory, f"Prediction on {name}", body, made)


def _settings(chosen: Mapping[str, str]) -> str:
    """What was chosen, with what each setting is and its unit; what had its default is folded."""
    if not chosen:
        return '<p class="quiet">not recorded</p>'
    defaults = SessionSettings().as_text()
    names = sorted(chosen, key=lambda name: chosen[name] == defaults.get(name))
    rows = [(name, chosen[name], SETTINGS[name].sentence if name in SETTINGS else "") for name in names]
    changed = sum(chosen[name] != defaults.get(name) for name in names)
    head = ("setting", "value", "what it is")
    folded = (
        f"<details><summary>{len(rows) - changed} with their defaults</summary>{table(head, rows[changed:])}</details>"
    )
    return (table(head, rows[:changed]) if changed else "") + folded


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
        ("time_to_ten_percent_s", "s", "from the first scored contact to an error below 10 %"),
    )
    figures = [(number(report[key], unit), label) for key, unit, label in shown if key in report]
    return tiles([*((value, label) for label, value in (words or {}).items()), *figures])


def _drawn(log: SessionLog, report: Mapping[str, Any]) -> Iterator[str]:
    """What the sections draw of a session."""
    log = log.longest_phase()
    pairs = pair(log)
    start = int(pairs.follower["time_ns"][0]) if pairs.time.size else log.models[0].time_ns if log.models else 0
    scene = look_at_scene(log, pairs) if has_scene(log) else None
    view = View(log, pairs, report, start, follower_away(log, start), scene)
    for section in SECTIONS:
        for drawing in section.drawings(view):
            yield embedded(drawing.figure, drawing.caption)


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

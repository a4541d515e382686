"""The report as one HTML page that needs nothing else."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foretouch.errors import InputError
from foretouch.messages import SessionLog
from foretouch.models import LAWS
from foretouch.recordings import atomic_path
from foretouch.report.figures import (
    force_figure,
    loop_figure,
    model_figure,
    prediction_figure,
    timing_figure,
    tracking_figure,
)
from foretouch.report.pairs import pair
from foretouch.report.scores import lowest_mean
from foretouch.report.text import Finding, findings, number, render_text, scoring_findings

__all__ = ["write_page", "write_prediction_page"]

STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --quiet: #5c5c5c; --paper: #fafafa; --card: #fff; --line: #ddd;
  --bad: #a33c00; }
@media (prefers-color-scheme: dark) { :root { --ink: #ececec; --quiet: #aaa; --paper: #161616; --card: #222;
  --line: #444; --bad: #ffa36b; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  padding: 1.5rem; max-width: 64rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p { margin: .3rem 0; } .quiet { color: var(--quiet); } .bad, .good { font-weight: 600; } .bad { color: var(--bad); }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(8.5rem, 1fr)); gap: .8rem; margin: 1rem 0; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.5rem; } .tile span { color: var(--quiet); font-size: .85rem; }
figure { margin: 1rem 0; background: #fff; border: 1px solid var(--line); border-radius: .5rem; padding: .5rem; }
figure img { width: 100%; height: auto; display: block; } figcaption { color: #444; font-size: .85rem; padding: .3rem; }
table { border-collapse: collapse; } td { border-bottom: 1px solid var(--line); padding: .25rem 1.5rem .25rem 0; }
pre { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .8rem;
  font-size: .8rem; }
"""


def write_page(directory: str | PathLike[str], log: SessionLog, report: dict[str, Any]) -> Path:
    """Write the report of a session with its figures as ``index.html``; it makes no request to anywhere.

    Args:
        directory: Made if it is not there.
        log: The session.
        report: What `session_report` gave of it.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    body = [
        "<h1>foretouch session</h1>",
        f'<p class="quiet">{escape(_summary(report))}</p>',
        *_sentences(findings(report)),
        _tiles(report),
        *_session_figures(log, report),
        "<h2>Settings</h2>",
        _table(report["settings"] or {"settings": "not recorded"}),
        "<h2>All figures</h2>",
        f"<pre>{escape(render_text(report))}</pre>",
    ]
    return _write(directory, "foretouch session", body)


def write_prediction_page(
    directory: str | PathLike[str], name: str, forces: Mapping[str, ArrayLike], figures: Mapping[str, Any]
) -> Path:
    """Write what became of a prediction on a recording as ``index.html``.

    Args:
        directory: Made if it is not there.
        name: Of the recording, for the heading.
        forces: Columns ``time_s``, ``measured_force_N``, ``predicted_force_N``, ``delayed_force_N`` and
            ``in_contact``, shape (n,).
        figures: The figures by name, among them ``delay_s`` and ``status``, as ``predict --json`` prints them.

    Returns:
        Path of the page.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
        MissingExtraError: Matplotlib is not installed.
    """
    status = figures["status"]
    body = [
        f"<h1>Prediction on {escape(name)}</h1>",
        f'<p class="quiet">Forces known {figures["delay_s"]:g} s late. Status: {escape(status)}.</p>',
        *_sentences(scoring_findings(figures)),
        _tiles(figures),
    ]
    columns = {key: np.asarray(column) for key, column in forces.items()}
    if columns["time_s"].size:
        measured, predicted, known = (columns[f"{kind}_force_N"] for kind in ("measured", "predicted", "delayed"))
        time = columns["time_s"] - columns["time_s"][0]
        drawn = prediction_figure(time, measured, predicted, known, columns["in_contact"].astype(np.bool_))
        body.append(_embedded(drawn, "Measured, predicted and delayed force over time, and the errors"))
    body += ["<h2>All figures</h2>", _table(figures)]
    return _write(directory, f"Prediction on {name}", body)


def _sentences(said: list[Finding]) -> list[str]:
    return [f'<p class="{"good" if finding.good else "bad"}">{escape(finding.text)}</p>' for finding in said]


def _summary(report: dict[str, Any]) -> str:
    chosen = report["settings"]
    words = [f"{report['duration_s']:.1f} s", *(chosen[key] for key in ("material", "operator") if key in chosen)]
    return f"{', '.join(words)}; {report['loop']}. Status: {report['status']}."


def _tiles(report: Mapping[str, Any]) -> str:
    shown = (
        ("prediction_error_percent", "%", "error of the predicted force"),
        ("rendered_error_percent", "%", "error of the rendered force"),
        ("delayed_force_error_percent", "%", "error of the delayed force"),
        ("within_jnd_percent", "%", "of contact predicted within what is noticed"),
        ("phantom_force_rms_N", "N", "predicted in free air, RMS"),
        ("contact_force_rms_N", "N", "contact force, RMS"),
    )
    tiles = (
        f'<div class="tile"><b>{escape(number(report[key], unit))}</b><span>{label}</span></div>'
        for key, unit, label in shown
        if key in report
    )
    return f'<div class="tiles">{"".join(tiles)}</div>'


def _session_figures(log: SessionLog, report: dict[str, Any]) -> list[str]:
    """Those figures that the session has something to show in."""
    pairs = pair(log)
    drawn = []
    if pairs.time.size:
        true_force = pairs.follower["sensor_force"] - lowest_mean(pairs.time, pairs.follower["sensor_force"])
        end = pairs.time[-1] if report["score_to_s"] is None else min(report["score_to_s"], pairs.time[-1])
        limits = (report["score_from_s"], end) if end > report["score_from_s"] else None
        columns = (pairs.leader[f"{kind}_force"] for kind in ("predicted", "delayed", "rendered"))
        forces = force_figure(pairs.time, true_force, *columns, limits=limits)
        drawn.append(_embedded(forces, "True, predicted, delayed and rendered force over time, and the errors"))
        surfaces = [model.surface for model in log.models if model.valid and np.isfinite(model.surface)]
        loop = loop_figure(pairs, true_force, surfaces[-1] if surfaces else None)
        drawn.append(_embedded(loop, "Force against depth, true and predicted"))
    if any(model.law in LAWS for model in log.models):
        start = int(pairs.follower["time_ns"][0]) if pairs.time.size else log.models[0].time_ns
        drawn.append(_embedded(model_figure(log.models, start), "Identified parameters over time"))
    if pairs.time.size:
        drawn.append(_embedded(tracking_figure(pairs), "Position of the robot, and its tracking error"))
    if log.leader.size or log.follower.size:
        drawn.append(_embedded(timing_figure(log), "Loop periods and compute times of leader and follower"))
    return drawn


def _embedded(figure: Any, caption: str) -> str:
    """A figure as an image inside the page; as an image of its own, its inner names clash with no other's."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    text = escape(caption, quote=True)
    return f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _table(rows: Mapping[str, Any]) -> str:
    def cell(value: Any) -> str:
        return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)

    cells = (f"<tr><td>{escape(name)}</td><td>{escape(cell(value))}</td></tr>" for name, value in rows.items())
    return f"<table>{''.join(cells)}</table>"


def _write(directory: str | PathLike[str], title: str, body: list[str]) -> Path:
    folder = Path(directory)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the report cannot be written there: {error.strerror}") from None
    page = folder / "index.html"
    text = "\n".join(
        (
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>",
            *body,
            "</body></html>\n",
        )
    )
    with atomic_path(page) as part:
        part.write_text(text, encoding="utf-8")
    return page

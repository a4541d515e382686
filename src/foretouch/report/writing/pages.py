"""Pages of HTML that need nothing else: of a session, a prediction on a recording and a sensor calibration."""

from __future__ import annotations

import base64
import importlib.metadata
import io
import platform
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from foretouch.errors import InputError
from foretouch.identification import SeriesCompliance, ToolWeight
from foretouch.messages import SessionLog
from foretouch.quantities import in_words, new_figure
from foretouch.recordings import atomic_path
from foretouch.report.drawing import COLOURS, finished, legend
from foretouch.report.numbers import Finding, number
from foretouch.report.rows import follower_away, pair
from foretouch.report.scene import look
from foretouch.report.sections import View, sections_of
from foretouch.report.sections.energy import stability_word
from foretouch.report.sections.forces import prediction_figure, scoring_findings
from foretouch.report.sections.session import baseline_sentence, lasted, pressed, segment_sentence
from foretouch.report.writing.session_report import SECTIONS, findings, render_text
from foretouch.session import SessionSettings
from foretouch.settings import SETTINGS

STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --quiet: #5c5c5c; --paper: #fafafa; --card: #fff; --line: #ddd;
  --bad: #a33c00; }
@media (prefers-color-scheme: dark) { :root { --ink: #ececec; --quiet: #aaa; --paper: #161616; --card: #222;
  --line: #444; --bad: #ffa36b; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  padding: 1.5rem; max-width: 64rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p { margin: .3rem 0; } .quiet { color: var(--quiet); } .bad, .good { font-weight: 600; } .bad { color: var(--bad); }
.tiles { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1rem 0; }
.tile { flex: 1 1 max(7.5rem, calc(100% / var(--columns) - .8rem)); box-sizing: border-box;
  background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.3rem; white-space: nowrap; }
.tile span { color: var(--quiet); font-size: .85rem; }
figure { margin: 1rem 0; background: #fff; border: 1px solid var(--line); border-radius: .5rem; padding: .5rem; }
figure img { width: 100%; height: auto; display: block; } figcaption { color: #444; font-size: .85rem; padding: .3rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; max-width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .25rem 1.5rem .25rem 0; }
td { border-bottom: 1px solid var(--line); }
.wide { overflow-x: auto; } .made { margin-top: 3rem; border-top: 1px solid var(--line); font-size: .85rem; }
.made td { overflow-wrap: anywhere; } .made td:first-child { white-space: nowrap; }
code { font-family: ui-monospace, monospace; font-size: .9em; }
pre { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .8rem;
  font-size: .8rem; }
"""

MOST_COLUMNS = 6  # Largest number of cards beside each other on a wide page
MOST_BYTES = 400_000  # Most bytes that a figure may take as lines; one with more has its curves as pixels
MOST_WORDS = 100  # Words among the curves are pixels too where there are more than this: the numbers of a matrix
PIXELS = 150  # Pixels per inch of such curves: half as many again as the widest page has


def embedded(figure: Any, caption: str) -> str:
    """A figure as an image inside the page; as an image of its own, its inner names clash with no other's.

    However much there is to draw, the image stays small: see `MOST_BYTES`. Axes, titles and legends are lines anyway.
    """
    drawn = _svg(figure)
    if len(drawn) > MOST_BYTES:
        for axes in figure.axes:
            words = axes.texts if len(axes.texts) > MOST_WORDS else ()
            for artist in (*axes.lines, *axes.collections, *axes.patches, *words):
                artist.set_rasterized(True)
        drawn = _svg(figure)
    data = base64.b64encode(drawn).decode("ascii")
    text = escape(caption, quote=True)
    return f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _svg(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", dpi=PIXELS, metadata={"Date": None})
    return buffer.getvalue()


def named_values(values: Mapping[str, Any]) -> str:
    """A table of names and values."""
    return table((), list(values.items()))


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table; numbers with six digits, None as a dash."""

    def cell(value: Any) -> str:
        return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)

    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    lines = ("".join(f"<td>{escape(cell(value))}</td>" for value in row) for row in rows)
    return f"<table>{f'<tr>{titles}</tr>' if head else ''}{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def tiles(figures: Sequence[tuple[str, str]]) -> str:
    """Cards of a value with its unit and what it is, in rows of equal length where that can be: none is left alone."""
    rows = -(-len(figures) // MOST_COLUMNS) or 1
    cards = (f'<div class="tile"><b>{escape(value)}</b><span>{escape(what)}</span></div>' for value, what in figures)
    return f'<div class="tiles" style="--columns: {-(-len(figures) // rows)}">{"".join(cards)}</div>'


def _origin(made: Mapping[str, Any]) -> str:
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    command = f"<code>{escape(made['command'])}</code>" if made.get("command") else "none: written from Python"
    version = importlib.metadata.version("foretouch")
    rows = [
        ("made by", escape(f"foretouch {version}, Python {platform.python_version()}, {platform.machine()}")),
        ("made on", now),
        ("command, to repeat it", command),
        *((name.replace("_", " "), escape(str(what))) for name, what in made.items() if name != "command"),
    ]
    lines = "".join(f"<tr><td>{name}</td><td>{what}</td></tr>" for name, what in rows)
    return f'<footer class="made"><h2>How this page was made</h2><table>{lines}</table></footer>'


def write_html(
    directory: str | PathLike[str], title: str, body: list[str], made: Mapping[str, Any] | None = None
) -> Path:
    """Write ``index.html`` with the HTML of its parts in a folder, which is made if it is not there.

    At its end it says what made it, by name: the ``command`` that repeats it, the recording, the law, the settings;
    version and date in any case. An InputError says that the folder cannot be made or the page cannot be written.
    """
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
            _origin(made or {}),
            "</body></html>\n",
        )
    )
    with atomic_path(page) as part:
        part.write_text(text, encoding="utf-8")
    return page


def write_page(
    directory: str | PathLike[str], log: SessionLog, report: dict[str, Any], made: Mapping[str, Any] | None = None
) -> Path:
    """Write the report of a session with its figures as ``index.html``; it makes no request to anywhere.

    The report is that of `session_figures`; directory, `made` and the errors are as of `write_html`, and a
    MissingExtraError says that Matplotlib is not installed.
    """
    body = [
        "<h1>foretouch session</h1>",
        f'<p class="quiet">{escape(_summary(report))}</p>',
        *_sentences([Finding(text) for text in (segment_sentence(report), baseline_sentence(report)) if text]),
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
    """Write what became of a prediction on a recording, whose name is in the heading, as `write_page`.

    Forces are the columns ``time_s``, ``measured_force_N``, ``predicted_force_N``, ``delayed_force_N`` and
    ``in_contact``, shape (n,). Figures are by name, among them ``delay_s`` and ``status``, as ``predict --json`` prints
    them; where there are ``remarks``, they come first.
    """
    status, remarks = figures["status"], figures.get("remarks", ())
    figures = {key: value for key, value in figures.items() if key != "remarks"}
    given = {status} if any(remark.startswith(f"{status}: ") for remark in remarks) else set()
    by = "".join(f"{what.capitalize()}: {made[what]}. " for what in ("law", "estimator") if made and what in made)
    text = f"{by}Forces known {figures['delay_s']:g} s late. Status: {status}."
    body = [
        f"<h1>Prediction on {escape(name)}</h1>",
        f'<p class="quiet">{escape(text)}</p>',
        *_sentences([Finding(remark) for remark in remarks]),
        *_sentences([one for one in scoring_findings(figures) if one.text.partition(":")[0] not in given]),
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
    """Chosen settings, with their meaning and unit; those with default values are folded."""
    if not chosen:
        return '<p class="quiet">not recorded</p>'
    defaults = SessionSettings().as_text()
    names = sorted(chosen, key=lambda name: chosen[name] == defaults.get(name))
    rows = [(name, chosen[name], SETTINGS[name].sentence if name in SETTINGS else "") for name in names]
    changed = sum(chosen[name] != defaults.get(name) for name in names)
    head = ("setting", "value", "what it is")
    folded = f"<summary>{len(rows) - changed} with their defaults</summary>{table(head, rows[changed:])}"
    return f"{table(head, rows[:changed]) if changed else ''}<details>{folded}</details>"


def _sentences(findings: list[Finding]) -> list[str]:
    return [f'<p class="{"good" if finding.good else "bad"}">{escape(finding.text)}</p>' for finding in findings]


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
    log = log.longest_phase()
    pairs = pair(log)
    start = int(pairs.follower["time_ns"][0]) if pairs.time.size else log.models[0].time_ns if log.models else 0
    view = View(log, pairs, report, start, follower_away(log, start), look(log, pairs))
    for section in sections_of(report, SECTIONS):
        for drawing in section.drawings(view):
            yield embedded(drawing.figure, drawing.caption)


def write_calibration_page(
    directory: str | PathLike[str],
    name: str,
    result: ToolWeight | SeriesCompliance,
    figures: Mapping[str, Any],
    made: Mapping[str, Any] | None = None,
    poses: Sequence[str] | None = None,
) -> Path:
    """Write the result of a calibration, with its figures by name and that of the file in the heading, as `write_page`.

    Of static poses, which may be named, it shows the residuals pose by pose; of presses on a rigid block the force over
    the deflection and the residual.
    """
    if isinstance(result, ToolWeight):
        title, drawn = f"Sensor calibration from {name}", _weight_figure(result, poses)
    else:
        title, drawn = f"Series compliance from {name}", _compliance_figure(result)
    shown = {
        key: ", ".join(f"{part:.6g}" for part in value) if isinstance(value, tuple) else value
        for key, value in figures.items()
    }
    body = [f"<h1>{escape(title)}</h1>", named_values(shown), "<h2>Residuals</h2>", embedded(drawn, "Residuals")]
    return write_html(directory, title, body, made)


def write_weight_figure(path: str | PathLike[str], weight: ToolWeight, poses: Sequence[str] | None = None) -> Path:
    """Write the residuals of static poses, pose by pose, as a picture.

    Args:
        path: The file, ending with ``.png``.
        weight: Whose residuals.
        poses: Names of the poses; their numbers from 1 without.
    """
    with atomic_path(path) as part:
        _weight_figure(weight, poses).savefig(part, format="png", dpi=120, bbox_inches="tight")
    return Path(path)


MOST_NAMES = 40  # Number of poses up to which each has its name below


def _weight_figure(weight: ToolWeight, poses: Sequence[str] | None) -> Any:
    parts = [("force [N]", weight.force_residual)]
    if weight.torque_residual is not None:
        parts.append(("torque [N m]", weight.torque_residual))
    figure = new_figure(2.8 * len(parts) + 0.6)
    for row, (title, residual) in enumerate(parts, 1):
        axes = figure.add_subplot(len(parts), 1, row)
        for column, (axis, marker) in enumerate(zip("xyz", "os^", strict=True)):
            number = np.arange(1, len(residual) + 1) + 0.12 * (column - 1)
            axes.plot(number, residual[:, column], marker, ms=4, color=COLOURS[column], label=axis)
        axes.axhline(0.0, color="0.5", lw=0.8)
        if poses is not None and len(residual) == len(poses) <= MOST_NAMES:
            axes.set_xticks(np.arange(1, len(poses) + 1), poses)
        axes.set(title=f"Residual: measured less fitted {title.partition(' ')[0]}", ylabel=title, xlabel="pose")
        legend(axes, 3)
    return finished(figure, len(parts), gap=1.1)


def _compliance_figure(result: SeriesCompliance) -> Any:
    figure = new_figure(6.4)
    above, below = figure.add_subplot(2, 1, 1), figure.add_subplot(2, 1, 2)
    some = slice(None, None, max(1, result.force.size // 4000))
    force, deflection, loads = result.force[some], result.deflection[some], result.loading[some]
    ends = np.array([result.contact_floor, result.force.max()])
    for colour, label, part, shift in ((COLOURS[0], "loading", loads, -0.5), (COLOURS[1], "unloading", ~loads, 0.5)):
        above.plot(1e6 * deflection[part], force[part], ".", ms=2, color=colour, label=label)
        above.plot(1e6 * (ends / result.stiffness + shift * result.lost_motion), ends, color=colour, lw=1.0)
        below.plot(force[part], 1e6 * result.residual[some][part], ".", ms=2, color=colour, label=label)
    above.set(title="Force over deflection, and the fitted lines", xlabel="deflection [um]", ylabel="force [N]")
    below.set(title="Residual: measured less fitted position", ylabel="residual [um]", xlabel="force [N]")
    legend(above, 2)
    legend(below, 2)
    return finished(figure, 2, gap=1.1)

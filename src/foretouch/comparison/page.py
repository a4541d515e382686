"""The results as one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby
from os import PathLike
from pathlib import Path
from typing import Any

from foretouch.comparison.figures import MOST_RECORDINGS, delay_figure, matrix_figure
from foretouch.comparison.result import Result, convergence_text, delays_of, note, parameter_text, same_reason
from foretouch.errors import plural
from foretouch.report import embedded, table, write_html

MOST_MATRICES = 3  # Largest number of delays that all have matrices; with more, only the one nearest to 0.3 s has them


def write_comparison_page(
    directory: str | PathLike[str], results: Sequence[Result], made: Mapping[str, Any] | None = None
) -> Path:
    """Write plots and tables of a comparison as ``index.html`` in a folder, which is made if it is not there.

    Results are as `compare` gave them, at least one; `made` and the errors are those of `write_html`.
    """
    failed = sum(result.status != "ok" for result in results)
    recordings = len({result.recording for result in results})
    what = f"{plural(len(results), 'combination')} on {plural(recordings, 'recording')}"
    body = [
        "<h1>Comparison of laws and estimators</h1>",
        f'<p class="quiet">{what}; {failed} failed.</p>',
        "<p>Errors are fractions of the RMS of the contact force. The delayed force is what would be felt without a "
        "model: a prediction that is no better than it is of no use.</p>",
        *_left_out(recordings),
        *_figures(results),
        "<h2>Every combination</h2>",
    ]
    for name, rows in groupby(results, key=lambda result: result.recording):
        body += [f"<h3>{escape(name)}</h3>", _table(list(rows))]
    return write_html(directory, "Comparison of laws and estimators", body, made)


def _left_out(recordings: int) -> list[str]:
    if recordings <= MOST_RECORDINGS:
        return []
    return [
        f"<p>So that the page can be sent, the first {MOST_RECORDINGS} of {recordings} recordings have a panel of "
        "their own, and matrices have colours and no numbers: the tables below have them all.</p>"
    ]


def _figures(results: Sequence[Result]) -> list[str]:
    drawn = []
    delays = delays_of(results)
    known = any(row.convergence for row in results)
    nearest = min(delays, key=lambda delay: abs(delay - 0.3), default=None)

    def add(*arguments: Any, **options: Any) -> None:
        caption = f"{arguments[1]}: a row for each law and estimator, a column for each recording; darker is larger."
        drawn.append(embedded(matrix_figure(results, *arguments, **options), caption))

    if len(set(delays)) > 1:
        drawn += _against_delay(results)
    for index, delay in enumerate(delays):
        if len(delays) > MOST_MATRICES and delay != nearest:
            continue  # the plots above show them all, the tables below give them
        add(
            _of(index, "prediction_error_percent"),
            f"Prediction error at {delay:g} s [%]",
            first_row=("(the delayed force)", _of(index, "delayed_force_error_percent")),
        )
        if known:
            add(
                _of(index, "foreseeable_prediction_error_percent"),
                f"The same without the samples that nothing before t - {delay:g} s could tell [%]",
                first_row=("(the delayed force)", _of(index, "foreseeable_delayed_force_error_percent")),
            )
    add(lambda result: result.residual_percent, "One-step error [%]")
    if known:
        add(_slowest, "Convergence after the first touch or a change, the slowest [s]", limits=(0.05, 5.0))
        add(
            lambda result: None if result.local_stiffness is None else result.local_stiffness.error_percent,
            "Error of dF/dx at half of the deepest press [%]",
        )
    add(lambda result: result.us_per_sample, "Time per sample [us], beside other jobs", limits=(20.0, 2000.0))
    return drawn


def _against_delay(results: Sequence[Result]) -> list[str]:
    groups: dict[str, list[Result]] = {}
    for row in results:
        if row.predictions:
            known = row.predictions[0].unforeseeable_percent is not None
            title = f"Prediction error against delay{', without what nothing before t - delay could tell' * known}"
            groups.setdefault(title, []).append(row)
    key = "Ceiling: the delayed force. Floor: fits of the whole file, which know no delay. Triangles: beyond the panel."
    return [embedded(delay_figure(rows, title), f"{title}. {key}") for title, rows in sorted(groups.items())]


def _of(index: int, name: str) -> Any:
    return lambda result: getattr(result.predictions[index], name) if result.predictions else None


def _slowest(result: Result) -> float | None:
    times = [event.convergence_s for event in result.convergence]
    return max((math.inf if time is None else time for time in times), default=None)


def _table(rows: list[Result]) -> str:
    reason = same_reason(rows)
    if reason is not None:
        return f'<p class="bad">All {len(rows)} failed: {escape(reason)}</p>'
    delays = delays_of(rows)
    known = any(row.convergence for row in rows)
    head = ["law", "estimator", "one step [%]"]
    for delay in delays:
        head += [f"at {delay:g} s [%]", "delayed [%]"] + (["foreseeable [%]", "delayed [%]"] if known else [])
    head += ["us"] + (["converged [s]", "parameters: error"] if known else []) + ["remarks"]
    lines = []
    for row in rows:
        line: list[Any] = [row.model, row.estimator, _rounded(row.residual_percent)]
        names = ["prediction_error_percent", "delayed_force_error_percent"]
        names += ["foreseeable_prediction_error_percent", "foreseeable_delayed_force_error_percent"] if known else []
        for index in range(len(delays)):
            line += [_rounded(_of(index, name)(row)) for name in names]
        line.append(_rounded(row.us_per_sample))
        line += [convergence_text(row), parameter_text(row) or None] if known else []
        statuses = sorted({p.status for p in row.predictions} - {"ok"})
        remarks = [*statuses, *row.warnings] if row.status == "ok" else [note(row)]
        lines.append([*line, "; ".join(remarks)])
    return f'<div class="wide" style="font-size: .8rem">{table(head, lines)}</div>'


def _rounded(value: float | None) -> str | None:
    return None if value is None else f"{value:.3g}"

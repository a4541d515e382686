"""The results as text, to be read at a glance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from statistics import median

from foretouch.comparison.result import Prediction, Result
from foretouch.errors import plural
from foretouch.report.numbers import number

__all__ = ["NEVER", "convergence_text", "middle", "note", "parameter_text", "render_table"]

NEVER = "never"


def render_table(results: Sequence[Result]) -> str:
    """The results for a terminal: a block for each recording, and the medians over all recordings.

    Args:
        results: As `compare` gave them, those of one recording together.

    Returns:
        Lines without a last line break.
    """
    blocks = [_block(name, list(rows)) for name, rows in groupby(results, key=lambda result: result.recording)]
    if len(blocks) > 1:
        blocks.append(_summary(results))
    return "\n\n".join("\n".join(block) for block in blocks)


def middle(values: Sequence[float | None]) -> float | None:
    """Median of those that there are."""
    known = [value for value in values if value is not None]
    return median(known) if known else None


def note(result: Result) -> str:
    """Why it failed, or what is to be known of it; empty where there is nothing."""
    if result.status != "ok":
        return f"failed: {result.reason}"
    said = []
    statuses = {p.status for p in result.predictions} - {"ok"}
    if statuses:
        said.append(", ".join(sorted(statuses)))
    if result.warnings:
        said.append("not separable: " + ", ".join(warning.split()[0] for warning in result.warnings))
    return "; ".join(said)


def same_reason(results: Sequence[Result]) -> str | None:
    """Why all of them failed, where that is one reason, as with a file that cannot be read; else None."""
    reasons = {result.reason for result in results}
    return reasons.pop() if len(reasons) == 1 and len(results) > 1 else None


def convergence_text(result: Result) -> str:
    """Convergence times after the first touch and each change."""
    times = (NEVER if c.convergence_s is None else f"{c.convergence_s:.2f}" for c in result.convergence)
    return " ".join(times) or "-"


def parameter_text(result: Result) -> str:
    """Errors of the parameters, in short."""
    parts = []
    for name, found in result.parameter_errors.items():
        if name == "ln_k":
            continue
        error = found.error
        text = "-" if error is None else f"{error:+.3g} %" if name in ("stiffness", "damping") else f"{error:+.3f}"
        value = "undetermined" if found.estimated is None else text
        parts.append(f"{name} {value}")
    return ", ".join(parts)


def _block(name: str, rows: list[Result]) -> list[str]:
    reason = same_reason(rows)
    if reason is not None:
        return [name, f"  all {len(rows)} failed: {reason}"]
    delays = [p.delay_s for p in next((row.predictions for row in rows if row.predictions), ())]
    known = any(row.convergence for row in rows)
    head = f"  {'law':<21}{'estimator':<21}{'one step':>10}"
    for delay in delays:
        head += f"{f'{delay:g} s':>12}" + (f"{'foreseeable':>13}" if known else "")
    head += f"{'us':>7}" + (f"  {'converged [s]':<20}{'dF/dx':>9}" if known else "") + "  "
    lines = [name, head.rstrip()]
    if delays:
        line = f"  {'(the delayed force)':<52}"
        for index in range(len(delays)):
            line += _percent(_over(rows, index, lambda p: p.delayed_force_error_percent), 12)
            line += (
                _percent(_over(rows, index, lambda p: p.foreseeable_delayed_force_error_percent), 13) if known else ""
            )
        lines.append(line.rstrip())
    for row in rows:
        line = f"  {row.model:<21}{row.estimator:<21}"
        if row.status != "ok":
            lines.append(f"{line}{note(row)}")
            continue
        line += _percent(row.residual_percent, 10)
        for prediction in row.predictions:
            line += _percent(prediction.prediction_error_percent, 12)
            line += _percent(prediction.foreseeable_prediction_error_percent, 13) if known else ""
        line += f"{row.us_per_sample or 0.0:>7.0f}"
        if known:
            slope = None if row.local_stiffness is None else row.local_stiffness.error_percent
            line += f"  {convergence_text(row):<20}{'-' if slope is None else f'{slope:+.1f} %':>9}"
        lines.append(f"{line}  {note(row)}".rstrip())
        if row.parameter_errors:
            lines.append(f"  {'':<21}  {parameter_text(row)}")
    return lines


def _summary(results: Sequence[Result]) -> list[str]:
    """Median and worst prediction error of each combination over all recordings."""
    recordings = len({result.recording for result in results})
    delays = [p.delay_s for p in next((row.predictions for row in results if row.predictions), ())]
    lines = [
        f"{'All ' if recordings > 1 else ''}{plural(recordings, 'recording')}: median and worst",
        f"  {'law':<21}{'estimator':<21}{'one step':>20}",
    ]
    lines[-1] += "".join(f"{f'{delay:g} s':>22}" for delay in delays) + "  failed"
    for model, estimator in dict.fromkeys((result.model, result.estimator) for result in results):
        rows = [result for result in results if (result.model, result.estimator) == (model, estimator)]
        line = f"  {model:<21}{estimator:<21}" + _both([row.residual_percent for row in rows], 20)
        for index in range(len(delays)):
            line += _both([row.predictions[index].prediction_error_percent for row in rows if row.predictions], 22)
        failed = sum(row.status != "ok" for row in rows)
        lines.append(f"{line}{failed:>8}" if failed else line)
    return lines


def _over(rows: Sequence[Result], index: int, figure: Callable[[Prediction], float | None]) -> float | None:
    return middle([figure(row.predictions[index]) for row in rows if row.predictions])


def _both(values: Sequence[float | None], width: int) -> str:
    known = [value for value in values if value is not None]
    text = f"{number(middle(known), '%')}  {number(max(known), '%')}" if known else "-"
    return f"{text:>{width}}"


def _percent(value: float | None, width: int) -> str:
    return f"{number(value, '%'):>{width}}"

"""The result of one law by one estimator on one recording, and many results as text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from statistics import median
from typing import Any

import msgspec
import numpy as np

from foretouch.comparison.truth import Convergence, ParameterError
from foretouch.errors import plural
from foretouch.quantities import Brief
from foretouch.report.numbers import number


@dataclass(frozen=True)
class Prediction:
    """Errors at one delay, as ratios to the contact-force RMS [%]; None where there is nothing to measure.

    Attributes:
        delay_s: Delay of the forces [s].
        prediction_error_percent: Error of the predicted force.
        delayed_force_error_percent: Error of the delayed force, over the same samples.
        within_jnd_percent: Fraction of contact samples whose error a hand cannot notice [%].
        status: As in `foretouch.report.STATUSES`.
        unforeseeable_percent: Fraction of samples that nothing before t - delay could predict [%]; None where the truth
            is not known, as the next two.
        foreseeable_prediction_error_percent: Error of the predicted force without these samples.
        foreseeable_delayed_force_error_percent: Error of the delayed force without them.
        whole_file_error_percent: Error of the force from a fit of the whole recording, which knows no delay: a floor.
            None where the estimator is not such a fit, as the next.
        foreseeable_whole_file_error_percent: The same error without the unforeseeable samples.
        largest_update_jump_N: Largest change of the predicted force that a new model made at one sample [N]; None where
            nothing was predicted, as the next two.
        largest_update_jump_N_per_s: Largest rate of such a change [N/s].
        largest_update_jump_at_s: Time of the largest change since the first sample [s]; None where no model changed it.
        time_to_ten_percent_s: From the first touch until half a second of contact is predicted within 10 % [s]; None
            where it never is.
    """

    delay_s: float
    prediction_error_percent: float | None
    delayed_force_error_percent: float | None
    within_jnd_percent: float | None
    status: str
    unforeseeable_percent: float | None = None
    foreseeable_prediction_error_percent: float | None = None
    foreseeable_delayed_force_error_percent: float | None = None
    whole_file_error_percent: float | None = None
    foreseeable_whole_file_error_percent: float | None = None
    largest_update_jump_N: float | None = None
    largest_update_jump_N_per_s: float | None = None
    largest_update_jump_at_s: float | None = None
    time_to_ten_percent_s: float | None = None


@dataclass(frozen=True)
class LocalStiffness:
    """Slope of the force over depth at rest, by which laws of different exponents can be compared [N/m].

    Attributes:
        depth_m: Depth at half of the deepest press [m].
        estimated: Estimated value; None without a model.
        true: Value of the law that holds at the end.
        error_percent: Estimated less true.
    """

    depth_m: float
    estimated: float | None
    true: float
    error_percent: float | None


@dataclass(frozen=True)
class Result(Brief):
    """The result of one combination.

    Attributes:
        recording: Name of the recording.
        model: Name of the law.
        estimator: Name of the estimator.
        status: ``"ok"`` or ``"failed"``.
        reason: Reason of the failure, None if it did not fail.
        samples: Number of samples of the recording.
        contact_samples: Number of samples that the estimator's conditioning takes for contact.
        residual_percent: One-step error: RMS residual as a ratio to the RMS force over the same samples [%].
        us_per_sample: Time of `identify` [us], which keeps every parameter at every sample; beside other jobs. ``==``
            leaves it out.
        parameters: The law's numbers after the last sample; None where undetermined.
        standard_errors: Standard errors by name, None where there are none.
        warnings: One sentence for each parameter that cannot be separated from the others.
        predictions: One for each delay.
        convergence: Convergence after the first touch and each change; empty where the truth is not known, as what
            follows.
        parameter_errors: Errors of the parameters by name.
        local_stiffness: Error of the local stiffness; None where no law is the true one.
    """

    recording: str
    model: str
    estimator: str
    status: str
    reason: str | None = None
    samples: int | None = None
    contact_samples: int | None = None
    residual_percent: float | None = None
    us_per_sample: float | None = field(default=None, compare=False)
    parameters: Mapping[str, float | None] = field(default_factory=dict)
    standard_errors: Mapping[str, float | None] | None = None
    warnings: tuple[str, ...] = ()
    predictions: tuple[Prediction, ...] = ()
    convergence: tuple[Convergence, ...] = ()
    parameter_errors: Mapping[str, ParameterError] = field(default_factory=dict)
    local_stiffness: LocalStiffness | None = None

    def as_row(self) -> dict[str, Any]:
        """The result as plain values for JSON: no NaN, no infinity."""
        row: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self, enc_hook=np.generic.item))
        return row


NEVER = "never"


def render_table(results: Sequence[Result]) -> str:
    """The results for a terminal, without a last line break: a block for each recording, and the medians over all.

    Results are as `compare` gave them, those of one recording together.
    """
    blocks = [_block(name, list(rows)) for name, rows in groupby(results, key=lambda result: result.recording)]
    if len(blocks) > 1:
        blocks.append(_summary(results))
    return "\n\n".join("\n".join(block) for block in blocks)


def middle(values: Sequence[float | None]) -> float | None:
    """Median of the finite values; None where there are none."""
    known = [value for value in values if value is not None and math.isfinite(value)]
    return median(known) if known else None


def note(result: Result) -> str:
    """The reason of a failure, or the remarks on a result; empty where there are none."""
    if result.status != "ok":
        return f"failed: {result.reason}"
    parts = []
    statuses = {p.status for p in result.predictions} - {"ok"}
    if statuses:
        parts.append(", ".join(sorted(statuses)))
    if result.warnings:
        parts.append("not separable: " + ", ".join(warning.split()[0] for warning in result.warnings))
    return "; ".join(parts)


def delays_of(results: Sequence[Result]) -> list[float]:
    """Delays of the first result that has predictions [s]."""
    return [p.delay_s for p in next((result.predictions for result in results if result.predictions), ())]


def same_reason(results: Sequence[Result]) -> str | None:
    """The reason that all failed, where it is the same, as with a file that cannot be read; else None."""
    reasons = {result.reason for result in results}
    return reasons.pop() if len(reasons) == 1 and len(results) > 1 else None


def convergence_text(result: Result) -> str:
    """Convergence times after the first touch and each change."""
    times = (NEVER if c.convergence_s is None else f"{c.convergence_s:.2f}" for c in result.convergence)
    return " ".join(times) or "-"


def parameter_text(result: Result) -> str:
    """Errors of the parameters, in short."""
    parts = []
    for name, parameter in result.parameter_errors.items():
        if name == "ln_k":
            continue
        error = parameter.error
        text = "-" if error is None else f"{error:+.3g} %" if name in ("stiffness", "damping") else f"{error:+.3f}"
        value = "undetermined" if parameter.estimated is None else text
        parts.append(f"{name} {value}")
    return ", ".join(parts)


def _block(name: str, rows: list[Result]) -> list[str]:
    reason = same_reason(rows)
    if reason is not None:
        return [name, f"  all {len(rows)} failed: {reason}"]
    delays = delays_of(rows)
    known = any(row.convergence for row in rows)
    head = f"  {'law':<21}{'estimator':<21}{'one step':>10}"
    for delay in delays:
        head += f"{f'{delay:g} s':>12}" + (f"{'foreseeable':>13}" if known else "")
    head += f"{'us':>7}" + (f"  {'converged [s]':<20}{'dF/dx':>9}" if known else "") + "  "
    lines = [name, head.rstrip()]
    if delays:
        line = f"  {'(the delayed force)':<52}"
        for index in range(len(delays)):
            line += _percent(_over(rows, index, "delayed_force_error_percent"), 12)
            line += _percent(_over(rows, index, "foreseeable_delayed_force_error_percent"), 13) if known else ""
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
    recordings = len({result.recording for result in results})
    delays = delays_of(results)
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


def _over(rows: Sequence[Result], index: int, name: str) -> float | None:
    return middle([getattr(row.predictions[index], name) for row in rows if row.predictions])


def _both(values: Sequence[float | None], width: int) -> str:
    known = [value for value in values if value is not None]
    text = f"{number(middle(known), '%')}  {number(max(known), '%')}" if known else "-"
    return f"{text:>{width}}"


def _percent(value: float | None, width: int) -> str:
    return f"{number(value, '%'):>{width}}"

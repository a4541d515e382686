"""What came of one law by one estimator on one recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.comparison.truth import Convergence, ParameterError
from foretouch.errors import plural
from foretouch.quantities import Brief, as_frame

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ["LocalStiffness", "Prediction", "Result", "Results"]


@dataclass(frozen=True)
class Prediction:
    """Errors under one delay, as shares of the contact-force RMS [%]; None where there is nothing to measure.

    Attributes:
        delay_s: Of the forces [s].
        prediction_error_percent: Of the predicted force.
        delayed_force_error_percent: Of the delayed force, over the same samples.
        within_jnd_percent: Share of contact samples whose error a hand cannot tell [%].
        status: As in `foretouch.report.STATUSES`.
        unforeseeable_percent: Share of the recording's samples that nothing before t - delay could tell [%]; None where
            the truth is not known, as the next two.
        foreseeable_prediction_error_percent: Of the predicted force without these samples.
        foreseeable_delayed_force_error_percent: Of the delayed force without them.
        whole_file_error_percent: Of the force that a fit of the whole recording gives, which knows no delay: a floor.
            None where the estimator is not such a fit, as the next.
        foreseeable_whole_file_error_percent: The same without the samples that nothing before t - delay could tell.
        largest_update_jump_N: Largest change of the predicted force that a new model made at one sample [N]; None where
            nothing was predicted, as the next two.
        largest_update_jump_N_per_s: Largest rate of one [N/s].
        largest_update_jump_at_s: When the largest came, since the first sample [s]; None where no model changed it.
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
        depth_m: At half of the deepest press.
        estimated: None without a model.
        true: Of the law that holds at the end.
        error_percent: Estimated less true.
    """

    depth_m: float
    estimated: float | None
    true: float
    error_percent: float | None


@dataclass(frozen=True)
class Result(Brief):
    """What came of one combination.

    Attributes:
        recording: Name of the recording.
        model: Name of the law.
        estimator: Name of the estimator.
        status: ``"ok"`` or ``"failed"``.
        reason: Why it failed, None if it did not.
        samples: Of the recording.
        contact_samples: As the estimator's conditioning judges it.
        residual_percent: One-step error: RMS residual as a share of the RMS force over the same samples [%].
        us_per_sample: Time of `identify` [us], which keeps every parameter at every sample; beside other jobs. ``==``
            leaves it out.
        parameters: The law's numbers after the last sample; None where undetermined.
        standard_errors: By name, None where there are none.
        warnings: One sentence for each parameter that cannot be told from the others.
        predictions: One for each delay.
        convergence: After the first touch and each change; empty where the truth is not known, as what follows.
        parameter_errors: By name.
        local_stiffness: None where no law is the true one.
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
        """As plain values for JSON: no NaN, no infinity."""
        row: dict[str, Any] = _finite(asdict(self))
        return row


class Results(list[Result]):
    """What `compare` found: one result for each combination, in the order of the recordings."""

    def __repr__(self) -> str:
        shown = [f"    {one.recording}: {one.model} by {one.estimator}, {one.status}" for one in self[:FEW]]
        more = [] if len(self) <= FEW else [f"    and {len(self) - FEW} more"]
        return "\n".join([f"Results({plural(len(self), 'combination')})", *shown, *more])

    def rows(self) -> list[dict[str, Any]]:
        """One row for each result and delay, with plain values; one for a result without any."""
        rows = []
        for result in self:
            kept = {name: getattr(result, name) for name in _IN_A_ROW}
            for prediction in result.predictions or (None,):
                found = {} if prediction is None else asdict(prediction)
                if prediction is not None:
                    found["prediction_status"] = found.pop("status")  # the result has one of its own
                rows.append(kept | found)
        return rows

    def to_pandas(self) -> pd.DataFrame:
        """`rows` as a data frame; what is not there is NaN or None.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return as_frame(self.rows())

    def to_numpy(self) -> NDArray[np.float64]:
        """Prediction errors [%], shape (results, delays), NaN where there is none."""
        delays = max((len(result.predictions) for result in self), default=0)
        errors = np.full((len(self), delays), np.nan)
        for row, result in enumerate(self):
            for column, prediction in enumerate(result.predictions):
                if prediction.prediction_error_percent is not None:
                    errors[row, column] = prediction.prediction_error_percent
        return errors

    def plot(self) -> Figure:
        """The prediction error under the longest delay, for every combination and recording.

        Raises:
            MissingExtraError: Matplotlib is not installed.
        """
        from foretouch.comparison.figures import matrix_figure

        def error(result: Result) -> float | None:
            return result.predictions[-1].prediction_error_percent if result.predictions else None

        longest = max((result.predictions[-1].delay_s for result in self if result.predictions), default=math.nan)
        figure: Figure = matrix_figure(self, error, f"Prediction error at a delay of {longest:g} s [% of force RMS]")
        return figure


FEW = 8
"""So many results are shown in the representation of all."""

_IN_A_ROW = ("recording", "model", "estimator", "status", "reason", "samples", "contact_samples", "residual_percent")
"""Of each result, in `Results.rows`."""


def _finite(value: Any) -> Any:
    """The same with None for every number that is not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    return value

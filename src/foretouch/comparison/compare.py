"""All laws by all estimators on all recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from foretouch.comparison.cases import Case, file_case
from foretouch.comparison.combination import Combination, Scoring, failed, try_combination
from foretouch.comparison.figures import matrix_figure
from foretouch.comparison.parallel import run_all
from foretouch.comparison.result import Result
from foretouch.errors import InputError, UnknownNameError, plural
from foretouch.errors.checks import require, require_type
from foretouch.identification import Estimator, all_estimators, load_estimator
from foretouch.quantities import Array, as_frame

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Progress = Callable[[int, int, Result], None]

FEW = 8  # Number of results shown in the representation of all

_IN_A_ROW = ("recording", "model", "estimator", "status", "reason", "samples", "contact_samples", "residual_percent")
"""Fields of each result in `Results.rows`."""


class Results(list[Result]):
    """The results of `compare`: one for each combination, in the order of the recordings."""

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
                columns = {} if prediction is None else asdict(prediction)
                if prediction is not None:
                    columns["prediction_status"] = columns.pop("status")  # the result has one of its own
                rows.append(kept | columns)
        return rows

    def to_pandas(self) -> pd.DataFrame:
        """`rows` as a data frame, NaN or None for what is not there; a MissingExtraError without pandas."""
        return as_frame(self.rows())

    def to_numpy(self) -> Array:
        """Prediction errors [%], shape (results, delays), NaN where there is none."""
        delays = max((len(result.predictions) for result in self), default=0)
        errors = np.full((len(self), delays), np.nan)
        for row, result in enumerate(self):
            for column, prediction in enumerate(result.predictions):
                if prediction.prediction_error_percent is not None:
                    errors[row, column] = prediction.prediction_error_percent
        return errors

    def plot(self) -> Figure:
        """The prediction error under the longest delay; a MissingExtraError where Matplotlib is not installed."""

        def error(result: Result) -> float | None:
            return result.predictions[-1].prediction_error_percent if result.predictions else None

        longest = max((result.predictions[-1].delay_s for result in self if result.predictions), default=math.nan)
        figure: Figure = matrix_figure(self, error, f"Prediction error at a delay of {longest:g} s [% of force RMS]")
        return figure


def combinations(models: Sequence[str] = (), estimators: Sequence[str | type[Estimator]] = ()) -> list[tuple[str, str]]:
    """Pairs of law and estimator that exist, of these laws by name and of these estimators; empty for all.

    Estimators are names, of all laws that have one so named, or their classes, each of its own law.

    Raises:
        UnknownNameError: No such law, or an estimator that none of these laws has.
        InputError: Names and classes together, or names of laws beside classes, which have their own.
    """
    kinds = [one for one in estimators if isinstance(one, type) and issubclass(one, Estimator)]
    if kinds:
        if models or len(kinds) < len(estimators):
            raise InputError("estimators are all classes, each of its own law, or all names beside those of models")
        return [pair for kind in kinds for pair in combinations([kind.model_name], [kind.name])]
    names = [str(one) for one in estimators]
    there = all_estimators()  # with those that other packages bring
    for model in models:
        if model not in there:
            raise UnknownNameError("model", model, there)
    chosen = list(dict.fromkeys(models)) or list(there)
    known = {name for model in chosen for name in there[model]}
    for estimator in names:
        if estimator not in known:
            load_estimator(estimator)  # says what is wrong with another package's
            raise UnknownNameError(f"estimator for {', '.join(chosen)}", estimator, known)
    return [(model, name) for model in chosen for name in there[model] if not names or name in names]


def compare(
    recordings: Sequence[Case | str | PathLike[str]],
    *,
    models: Sequence[str] = (),
    estimators: Sequence[str | type[Estimator]] = (),
    scoring: Scoring | None = None,
    processes: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Results:
    """Measure every combination of law and estimator on every recording.

    Args:
        recordings: Paths, or cases (`file_case` of a path whose units are to be given, `simulated_case`).
        models: Names of laws; empty for all.
        estimators: Names or classes, as of `combinations`; empty for all.
        scoring: Delays, window and floor.
        processes: Number at a time; None for as many as there are cores.
        cluster: Address of a Dask scheduler whose workers do it; None for this machine.
        progress: Called with the number of results there are, the total, and the newest.
        say: Called with a line for people where a cluster has no workers left and new ones are awaited.

    Returns:
        One result for each combination, those that failed too, in the order of the recordings.

    Raises:
        InputError: No recordings.
        ArgumentTypeError: Recordings or names that are none.
        UnknownNameError: As `combinations`.
        LinkError: No scheduler answers there, or it has no workers.
        MissingExtraError: The package ``distributed`` is not installed.
    """
    require_type("recordings", recordings, (list, tuple), "a list of paths, or of cases")
    cases = [one if isinstance(one, Case) else file_case(one) for one in recordings]
    for name, names in (("models", models), ("estimators", estimators)):
        require_type(name, names, Sequence, "a list of names; leave it out for all")
    if processes is not None:
        require("processes", processes, at_least=1)
    if not cases:
        raise InputError("nothing to compare: name recordings, or ask for the simulated ones with --simulated")
    scoring = Scoring() if scoring is None else scoring
    pairs = combinations(models, estimators)
    jobs = [Combination(case, model, name, scoring) for case in cases for model, name in pairs]
    results: dict[int, Result] = {}
    for index, result in run_all(try_combination, jobs, processes=processes, cluster=cluster, lost=failed, say=say):
        results[index] = result
        if progress is not None:
            progress(len(results), len(jobs), result)
    return Results(results[index] for index in range(len(jobs)))

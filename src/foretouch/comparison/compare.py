"""All laws by all estimators on all recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.comparison.cases import Case
from foretouch.comparison.combination import Combination, Scoring, failed, try_combination
from foretouch.comparison.figures import matrix_figure
from foretouch.comparison.parallel import run_all
from foretouch.comparison.result import Result
from foretouch.errors import InputError, UnknownNameError, plural
from foretouch.errors.checks import require, require_type
from foretouch.identification import all_estimators, load_estimator
from foretouch.quantities import as_frame

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Progress = Callable[[int, int, Result], None]

FEW = 8
"""So many results are shown in the representation of all."""


_IN_A_ROW = ("recording", "model", "estimator", "status", "reason", "samples", "contact_samples", "residual_percent")
"""Of each result, in `Results.rows`."""


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

        def error(result: Result) -> float | None:
            return result.predictions[-1].prediction_error_percent if result.predictions else None

        longest = max((result.predictions[-1].delay_s for result in self if result.predictions), default=math.nan)
        figure: Figure = matrix_figure(self, error, f"Prediction error at a delay of {longest:g} s [% of force RMS]")
        return figure


def combinations(models: Sequence[str] = (), estimators: Sequence[str] = ()) -> list[tuple[str, str]]:
    """Pairs of law and estimator that exist.

    Args:
        models: Names of laws; empty for all.
        estimators: Names of estimators; empty for all.

    Raises:
        UnknownNameError: No such law, or an estimator that none of these laws has.
    """
    there = all_estimators()  # with those that other packages bring
    for model in models:
        if model not in there:
            raise UnknownNameError("model", model, there)
    chosen = list(dict.fromkeys(models)) or list(there)
    known = {name for model in chosen for name in there[model]}
    for estimator in estimators:
        if estimator not in known:
            load_estimator(estimator)  # says what is wrong with another package's
            raise UnknownNameError(f"estimator for {', '.join(chosen)}", estimator, known)
    return [(model, name) for model in chosen for name in there[model] if not estimators or name in estimators]


def compare(
    cases: Sequence[Case],
    *,
    models: Sequence[str] = (),
    estimators: Sequence[str] = (),
    scoring: Scoring | None = None,
    processes: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Results:
    """Measure every combination of law and estimator on every recording.

    Args:
        cases: The recordings.
        models: Names of laws; empty for all.
        estimators: Names of estimators; empty for all.
        scoring: Delays, window and floor.
        processes: At a time; None for as many as there are cores.
        cluster: Address of a Dask scheduler whose workers do it; None for this machine.
        progress: Called with the number of results so far, that of all, and the newest.
        say: Told, in a line for people, where a cluster has no workers left and new ones are waited for.

    Returns:
        One result for each combination, those that failed too, in the order of the recordings.

    Raises:
        InputError: No recordings.
        ArgumentTypeError: Cases or names that are none.
        UnknownNameError: As `combinations`.
        LinkError: No scheduler answers there, or it has no workers.
        MissingExtraError: The package ``distributed`` is not installed.
    """
    require_type("cases", cases, Sequence, "a list of cases: file_case makes one of a path")
    for case in cases:
        require_type("case", case, Case, "a case: file_case makes one of a path")
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
    for place, result in run_all(try_combination, jobs, processes=processes, cluster=cluster, lost=failed, say=say):
        results[place] = result
        if progress is not None:
            progress(len(results), len(jobs), result)
    return Results(results[place] for place in range(len(jobs)))

"""All laws by all estimators on all recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from foretouch.comparison.cases import Case
from foretouch.comparison.combination import Combination, Scoring, failed, try_combination
from foretouch.comparison.parallel import run_all
from foretouch.comparison.result import Result, Results
from foretouch.errors import InputError, UnknownNameError
from foretouch.errors.checks import require, require_type
from foretouch.identification import all_estimators, load_estimator

Progress = Callable[[int, int, Result], None]


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

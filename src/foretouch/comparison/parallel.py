"""Many jobs on all cores; a worker process that dies takes no result with it."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from foretouch.comparison.cluster import run_on_cluster

__all__ = ["run_all"]

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


def run_all(
    work: Callable[[Job], Outcome],
    jobs: Sequence[Job],
    *,
    processes: int | None = None,
    cluster: str | None = None,
    lost: Callable[[Job, str], Outcome],
    say: Callable[[str], None] = lambda line: None,
) -> Iterator[tuple[int, Outcome]]:
    """Do all jobs, side by side.

    Where a worker process dies (killed, out of memory), the jobs that were not done are done one after the other,
    each beside nothing else, and one that kills its process again is lost: it alone.

    Args:
        work: Does one job; it does not raise.
        jobs: In the order in which they are begun.
        processes: At a time; None for as many as there are cores. 1 works in this process.
        cluster: Address of a Dask scheduler whose workers do them; None for this machine's.
        lost: Outcome of a job whose process died, from the job and the reason.
        say: As of `run_on_cluster`.

    Yields:
        Place of the job in `jobs` and its outcome, as they are done.

    Raises:
        LinkError: As `run_on_cluster`.
        MissingExtraError: As `run_on_cluster`.
    """
    if cluster is not None:
        yield from run_on_cluster(work, jobs, cluster, lost=lost, say=say)
        return
    count = min(processes or os.cpu_count() or 1, len(jobs))
    if count < 2:
        for place, job in enumerate(jobs):
            yield place, work(job)
        return
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    done: set[int] = set()
    try:
        for place, outcome in _side_by_side(work, jobs, range(len(jobs)), count):
            done.add(place)
            yield place, outcome
    except TerminatedWorkerError:
        pass
    for place in range(len(jobs)):
        if place in done:
            continue
        try:
            yield from _side_by_side(work, jobs, (place,), 2)  # one would be this process
        except TerminatedWorkerError:
            yield place, lost(jobs[place], "its process died: killed, or out of memory")


def _side_by_side(
    work: Callable[[Job], Outcome], jobs: Sequence[Job], places: Sequence[int], count: int
) -> Iterator[tuple[int, Outcome]]:
    from joblib import Parallel, delayed

    def one(place: int, job: Job) -> tuple[int, Outcome]:
        return place, work(job)

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)  # memory leaks, it thinks
        parallel = Parallel(n_jobs=count, backend="loky", return_as="generator_unordered", batch_size=1)
        with _deaf_to_interrupts():
            outcomes = parallel(delayed(one)(place, jobs[place]) for place in places)
        yield from outcomes


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """What is started meanwhile never hears Ctrl-C: its parent does, and ends it, without a traceback of each."""
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # before, for where this starts the tracker it lifts any mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited; heard here a moment later
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

"""The same jobs on other machines: a Dask cluster that somebody has started."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from foretouch.errors import LinkError, MissingExtraError

__all__ = ["run_on_cluster"]

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")

PATIENCE = 5.0
"""A scheduler answers within so long [s], or there is none."""


def run_on_cluster(
    work: Callable[[Job], Outcome], jobs: Sequence[Job], address: str, *, lost: Callable[[Job, str], Outcome]
) -> Iterator[tuple[int, Outcome]]:
    """Do all jobs on the workers of a Dask scheduler.

    Workers need the same foretouch, and files under the same paths: what is sent is a path, not its samples. Each
    should have one thread, for a job does not let go of the interpreter (`dask worker ADDRESS --nworkers 8 --nthreads
    1`). A job whose worker dies is tried on others, three times; then it alone is lost.

    Args:
        work: Does one job; it does not raise.
        jobs: In the order in which they are begun.
        address: Of the scheduler, as it prints it: `tcp://HOST:8786`.
        lost: Outcome of a job that no worker could do, from the job and the reason.

    Yields:
        Place of the job in `jobs` and its outcome, as they are done.

    Raises:
        LinkError: No scheduler answers there, or it has no worker.
        MissingExtraError: The package ``distributed`` is not installed.
    """
    try:
        from distributed import Client, as_completed
    except ModuleNotFoundError:
        raise MissingExtraError("distributed", "cluster") from None
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # silence, a name that is none, an address that is none
        said = " ".join(str(error).split()) or type(error).__name__
        raise LinkError(f"no Dask scheduler at {address!r} ({said}): start one with `dask scheduler`") from None
    with client:
        if not client.scheduler_info()["workers"]:
            raise LinkError(f"the Dask scheduler at {address} has no workers: start some with `dask worker {address}`")
        places = {client.submit(work, job, pure=False): place for place, job in enumerate(jobs)}
        for future in as_completed(list(places), loop=client.loop):
            place = places.pop(future)
            if future.status == "finished":
                yield place, future.result()
            else:
                yield place, lost(jobs[place], f"no worker of the cluster could do it: {_reason(future.exception())}")


def _reason(error: BaseException | None) -> str:
    """One line of what a worker died of."""
    name = type(error).__name__
    if name == "KilledWorker":
        return "its workers died, one after another"
    return f"{name}: {' '.join(str(error).split())}"

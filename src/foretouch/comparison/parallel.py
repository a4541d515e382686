"""Many jobs on all cores, or on a Dask cluster that is already running; a worker that dies takes no result with it."""

from __future__ import annotations

import logging
import os
import queue
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from foretouch.errors import LinkError, MissingExtraError

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")

PATIENCE = 5.0
"""Time within which a scheduler answers, or there is none [s]; connecting, with all its questions, takes twice that."""

ABSENCE = 60.0  # Time without any worker after which waiting for one ends [s]
NOTICE = 1.0  # Period at which the scheduler is asked for its workers while no outcome comes [s]
POLL = 0.02  # Time between two polls for outcomes [s]


def run_on_cluster(
    work: Callable[[Job], Outcome],
    jobs: Sequence[Job],
    address: str,
    *,
    lost: Callable[[Job, str], Outcome],
    say: Callable[[str], None] = lambda line: None,
) -> Iterator[tuple[int, Outcome]]:
    """Do all jobs on the workers of a Dask scheduler at an address such as ``tcp://HOST:8786``; else as `run_all`.

    Workers need the same foretouch, and files under the same paths: what is sent is a path, not its samples. Each
    should have one thread, for a job does not let go of the interpreter (`dask worker ADDRESS --nworkers 8 --nthreads
    1`). A job whose worker dies is tried on others; by Dask's own setting (`distributed.scheduler.allowed-failures`,
    3) the fourth death ends it, and it alone is lost. Where all workers are gone, new ones are waited for, `ABSENCE`
    long, and `say` is called with a line for people; then what is left is lost, and at once where the scheduler goes.
    """
    try:
        from distributed import as_completed
    except ModuleNotFoundError:
        raise MissingExtraError("distributed", "cluster") from None
    _check(address)
    with _without_its_log(), _connected(address) as client:
        if not client.scheduler_info()["workers"]:
            raise LinkError(f"the Dask scheduler at {address} has no workers: start some with `dask worker {address}`")
        indices = {client.submit(work, job, pure=False): index for index, job in enumerate(jobs)}
        done = as_completed(list(indices), loop=client.loop)
        watch = _Watch(client, say)
        while indices:
            if not done.has_ready():
                if reason := watch.gives_up():
                    break
                time.sleep(POLL)
                continue
            future = next(done)
            job = jobs[indices[future]]
            if future.status == "error":
                outcome = lost(job, f"no worker of the cluster could do it: {_reason(future.exception())}")
            elif future.status == "cancelled":
                outcome = lost(job, watch.gives_up() or "the scheduler of the cluster dropped it")
            else:
                try:
                    outcome = future.result(timeout=PATIENCE)
                except TimeoutError:  # its worker died with it: it is done once more
                    done.add(future)
                    if reason := watch.gives_up():
                        break
                    continue
                except Exception as error:
                    outcome = lost(job, watch.gives_up() or f"its result could not be fetched: {_reason(error)}")
            yield indices.pop(future), outcome
        for index in indices.values():
            yield index, lost(jobs[index], reason)


class _Watch:
    """Whether outcomes can still be expected; `say` is called when there are no workers any more."""

    def __init__(self, client: Any, say: Callable[[str], None]) -> None:
        self._client = client
        self._say = say
        self._next = time.monotonic() + NOTICE
        self._alone_since: float | None = None

    def gives_up(self) -> str:
        """Reason that no result can be expected any more; empty as long as it can."""
        if self._client.status != "running":
            return "the scheduler of the cluster is gone"
        now = time.monotonic()
        if now < self._next:
            return ""
        self._next = now + NOTICE
        try:
            workers = self._client.sync(self._client.scheduler.ncores, callback_timeout=PATIENCE)
        except Exception:  # silence, or the end of the scheduler, which the client's status tells soon
            workers = None
        if workers:
            self._alone_since = None
            return ""
        if self._alone_since is None:
            self._alone_since = now
            self._say(f"no workers: waiting up to {ABSENCE:g} s for one")
        if now - self._alone_since < ABSENCE:
            return ""
        return f"the cluster showed no workers for {ABSENCE:g} s"


def _check(address: str) -> None:
    """Refuse what is no address with a LinkError, before a client is made that would not know how to end."""
    from distributed.comm.addressing import get_address_host_port

    try:
        host, port = get_address_host_port(address)
        if not host or not 0 < port < 65536:
            raise ValueError("no host" if not host else f"no port {port}")
    except (ValueError, TypeError) as error:
        raise LinkError(
            f"no Dask scheduler at {address!r} ({_one_line(error)}): write its address as tcp://HOST:8786"
        ) from None


def _connected(address: str) -> Any:
    """A client of the scheduler, made in a thread of its own so that silence holds nothing up; else a LinkError."""
    from distributed import Client

    class Attempt(Client):  # type: ignore[misc]
        def __del__(self) -> None:  # one that never was connected would wait for what it cannot close
            if self.status == "running":
                super().__del__()

    answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def connect() -> None:
        try:
            answers.put(Attempt(address, timeout=PATIENCE, set_as_default=False))
        except (OSError, TypeError, ValueError) as error:  # silence, or a way of talking that lacks its keys
            answers.put(f"no Dask scheduler at {address!r} ({_one_line(error)})")
        except Exception as error:  # whatever foreign bytes mean where Dask's are expected
            answers.put(f"what answers at {address!r} is no Dask scheduler ({_one_line(error)})")

    threading.Thread(target=connect, daemon=True).start()
    try:
        answer = answers.get(timeout=2.0 * PATIENCE)
    except queue.Empty:
        answer = f"what listens at {address!r} is no Dask scheduler (it was silent for {2.0 * PATIENCE:g} s)"
    if isinstance(answer, str):
        raise LinkError(f"{answer}: start one with `dask scheduler`")
    return answer


@contextmanager
def _without_its_log() -> Iterator[None]:
    """Silence what the client logs on the error stream: outcomes and errors report it."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client", "tornado", "asyncio")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _reason(error: BaseException | None) -> str:
    if type(error).__name__ == "KilledWorker":
        return "its workers died, one after another"
    return type(error).__name__ if error is None else f"{type(error).__name__}: {_one_line(error)}"


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
    each alone, and only one that kills its process again is lost.

    The work does not raise. The jobs are begun in their order, as many at a time as there are processes (None for as
    many as cores; 1 works in this process), or on the workers of a cluster (`run_on_cluster`, with its errors). `lost`
    makes the outcome of a job whose process died from the job and the reason.

    Yields:
        Place of the job in `jobs` and its outcome, as they are done.
    """
    if cluster is not None:
        yield from run_on_cluster(work, jobs, cluster, lost=lost, say=say)
        return
    count = min(processes or os.cpu_count() or 1, len(jobs))
    if count < 2:
        for index, job in enumerate(jobs):
            yield index, work(job)
        return
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    done: set[int] = set()
    try:
        for index, outcome in _side_by_side(work, jobs, range(len(jobs)), count):
            done.add(index)
            yield index, outcome
    except TerminatedWorkerError:
        pass
    for index in range(len(jobs)):
        if index in done:
            continue
        try:
            yield from _side_by_side(work, jobs, (index,), 2)  # one would be this process
        except TerminatedWorkerError:
            yield index, lost(jobs[index], "its process died: killed, or out of memory")


def _side_by_side(
    work: Callable[[Job], Outcome], jobs: Sequence[Job], indices: Sequence[int], count: int
) -> Iterator[tuple[int, Outcome]]:
    from joblib import Parallel, delayed

    def one(index: int, job: Job) -> tuple[int, Outcome]:
        return index, work(job)

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)  # memory leaks, it thinks
        parallel = Parallel(n_jobs=count, backend="loky", return_as="generator_unordered", batch_size=1)
        with _deaf_to_interrupts():
            outcomes = parallel(delayed(one)(index, jobs[index]) for index in indices)
        yield from outcomes


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Processes started meanwhile ignore Ctrl-C: their parent ends them, without a traceback of each."""
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # before, for where this starts the tracker it lifts any mask
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # inherited; unblocked here a moment later
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

"""The same comparison by workers of a Dask cluster, which are processes of their own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from foretouch import comparison
from foretouch.cli.app import app
from foretouch.comparison.parallel import run_all
from foretouch.errors import LinkError
from foretouch.link import free_endpoint
from foretouch.models import KelvinVoigt
from foretouch.recordings import write_columns

pytest.importorskip("distributed")

pytestmark = pytest.mark.network

CHOSEN: dict[str, Any] = {"models": ("kelvin-voigt", "hunt-crossley"), "estimators": ("rls", "exact")}


@contextmanager
def started(count: int, *options: str) -> Iterator[tuple[str, subprocess.Popen[bytes], subprocess.Popen[bytes]]]:
    """A scheduler and workers on this machine: its address, and both."""
    port = free_endpoint().rpartition(":")[2]
    at = f"tcp://127.0.0.1:{port}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]
    workers = [*dask, "worker", at, "--nworkers", str(count), "--nthreads", "1", "--no-dashboard", *options]
    with subprocess.Popen(scheduler, **quiet) as head, subprocess.Popen(workers, **quiet) as hands:  # type: ignore[call-overload]
        try:
            from distributed import Client

            with Client(at, timeout=60, set_as_default=False) as client:
                client.wait_for_workers(count, timeout=60)
            yield at, head, hands
        finally:
            hands.terminate()
            hands.wait()  # workers without a scheduler would look for it for a while
            head.terminate()


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Path:
    time = np.arange(0.0, 4.0, 2e-3)
    depth = 0.01 * np.sin(2 * np.pi * 0.8 * np.maximum(time - 1.0, 0.0))
    force = KelvinVoigt(300.0, 2.0).force(depth, np.gradient(depth, time))
    noise = np.random.default_rng(0).normal(0.0, 5e-3, time.size)
    path = tmp_path_factory.mktemp("recordings") / "press.csv"
    write_columns(path, {"time_s": time, "position_m": depth + 0.01, "force_N": force + noise})
    return path


@pytest.mark.long  # in parallel, test_comparison_compare compares them
def test_the_results_are_those_of_one_process(press: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(press.parent)  # workers stand elsewhere
    cases = [comparison.file_case("press.csv"), comparison.file_case("no.csv"), comparison.simulated_case("tapping")]
    alone = comparison.compare(cases, **CHOSEN, processes=1)
    with started(1, "--no-nanny") as (address, _, _):
        far = comparison.compare(cases, **CHOSEN, cluster=address)
    assert [timeless(result) for result in alone] == [timeless(result) for result in far]
    assert {result.status for result in far} == {"ok", "failed"}


def timeless(result: comparison.Result) -> dict[str, Any]:
    return replace(result, us_per_sample=None).as_row()


@pytest.mark.long
def test_a_worker_that_dies_takes_one_job_with_it() -> None:
    def work(job: int) -> int:
        if job == 2:
            os._exit(1)
        return 10 * job

    with started(1) as (address, _, _):
        lost = dict(run_all(work, range(5), cluster=address, lost=lambda job, reason: -job if "died" in reason else 0))
    assert lost == {0: 0, 1: 10, 2: -2, 3: 30, 4: 40}


def test_where_no_scheduler_is_one_line_says_so(press: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foretouch.comparison.parallel.PATIENCE", 0.5)
    nowhere = f"tcp://127.0.0.1:{free_endpoint().rpartition(':')[2]}"
    with pytest.raises(LinkError, match="no Dask scheduler at"):
        comparison.compare([comparison.file_case(press)], **CHOSEN, cluster=nowhere)
    result = CliRunner().invoke(app, ["compare", str(press), "--cluster", nowhere])
    assert result.exit_code != 0


MALFORMED = (
    "",
    "foo",
    "tcp://",
    "tcp://127.0.0.1",
    "tcp://:8786",
    "tcp://h:x",
    "tcp://h:99999",
    "http://h:80",
    "x://h:1",
)


@pytest.mark.parametrize("given", MALFORMED)
def test_what_is_no_address_is_refused_before_anything_is_tried(given: str) -> None:
    with pytest.raises(LinkError, match=r"no Dask scheduler at .*: write its address as tcp://HOST:8786"):
        list(run_all(abs, [1], cluster=given, lost=lambda job, reason: job))


PROGRAM = """
import sys, time
from foretouch.comparison import parallel as cluster
from foretouch.errors import LinkError
cluster.PATIENCE, cluster.ABSENCE = float(sys.argv[1]), 1.0
def slow(job):
    time.sleep(0.5)
    return job
def say(line):
    print(line, flush=True)
for at in sys.argv[2:]:
    try:
        for place, outcome in cluster.run_on_cluster(slow, range(4), at, lost=lambda job, reason: reason, say=say):
            print(place, outcome, flush=True)
    except LinkError as error:
        print(error)
"""
"""Four jobs, a line for each, in a process whose error stream is its own."""


def command(patience: float, *addresses: str) -> list[str]:
    return [sys.executable, "-c", PROGRAM, str(patience), *addresses]


@pytest.mark.long
def test_a_port_that_is_no_scheduler_is_one_line_and_no_traceback() -> None:
    with socket.create_server(("127.0.0.1", 0)) as web, socket.create_server(("127.0.0.1", 0)) as mute:
        for server, answer in ((web, b"HTTP/1.1 400 Bad Request\r\n\r\n"), (mute, b"")):
            threading.Thread(target=serve, args=(server, answer), daemon=True).start()
        addresses = [f"tcp://127.0.0.1:{server.getsockname()[1]}" for server in (web, mute)]
        ended = subprocess.run(command(0.5, *addresses), capture_output=True, text=True, timeout=30, check=True)
    of_web, of_mute = ended.stdout.splitlines()
    assert of_web.startswith(f"what answers at '{addresses[0]}' is no Dask scheduler (")
    assert of_mute.startswith(f"what listens at '{addresses[1]}' is no Dask scheduler (it was silent for 1 s)")
    assert not ended.stderr


def serve(server: socket.socket, answer: bytes) -> None:
    """Give everybody the same answer; without one, listen and say nothing."""
    callers = []
    while True:
        try:
            caller, _ = server.accept()
        except OSError:  # the test is over
            return
        callers.append(caller)
        if answer:
            caller.sendall(answer)
            caller.close()


def said_where_one_is_killed(at: str, victim: subprocess.Popen[bytes]) -> list[str]:
    """Lines after that of the first job, at which a process is killed."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command(5.0, at), stdout=pipe, stderr=pipe, text=True) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "0 0\n"
        victim.kill()
        lines, wrong = running.communicate(timeout=30)
    assert not wrong
    assert running.returncode == 0
    return lines.splitlines()


@pytest.mark.long
def test_workers_that_stay_away_are_waited_for_and_given_up() -> None:
    with started(1, "--no-nanny") as (at, _, hands):
        lines = said_where_one_is_killed(at, hands)
    assert lines.count("no workers: waiting up to 1 s for one") == 1
    assert lines[-2:] == [f"{index} the cluster showed no workers for 1 s" for index in (2, 3)]


@pytest.mark.long
def test_a_scheduler_that_dies_is_said_in_each_row_that_is_left() -> None:
    with started(1, "--no-nanny") as (at, head, hands):
        lines = said_where_one_is_killed(at, head)
        hands.kill()
    assert [line for line in lines if line[0] != "1"] == [
        f"{index} the scheduler of the cluster is gone" for index in (2, 3)
    ]

"""The same comparison by workers of a Dask cluster, which are processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
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

pytestmark = pytest.mark.live

CHOSEN: dict[str, Any] = {"models": ("kelvin-voigt", "hunt-crossley"), "estimators": ("rls", "exact")}


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A scheduler and two workers on this machine."""
    port = free_endpoint().rpartition(":")[2]
    at = f"tcp://127.0.0.1:{port}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]
    workers = [*dask, "worker", at, "--nworkers", "2", "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1"]
    with subprocess.Popen(scheduler, **quiet) as head, subprocess.Popen(workers, **quiet) as hands:  # type: ignore[call-overload]
        try:
            from distributed import Client

            with Client(at, timeout=60, set_as_default=False) as client:
                client.wait_for_workers(2, timeout=60)
            yield at
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


def test_the_results_are_those_of_one_process(address: str, press: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(press.parent)  # workers stand elsewhere
    cases = [comparison.file_case("press.csv"), comparison.file_case("no.csv"), comparison.simulated_case("tapping")]
    alone = comparison.compare(cases, **CHOSEN, processes=1)
    far = comparison.compare(cases, **CHOSEN, cluster=address)
    assert [timeless(result) for result in alone] == [timeless(result) for result in far]
    assert {result.status for result in far} == {"ok", "failed"}


def timeless(result: comparison.Result) -> dict[str, Any]:
    return replace(result, us_per_sample=None).as_row()


def test_a_worker_that_dies_takes_one_job_with_it(address: str) -> None:
    def work(job: int) -> int:
        if job == 2:
            os._exit(1)
        return 10 * job

    lost = dict(run_all(work, range(5), cluster=address, lost=lambda job, reason: -job if "died" in reason else 0))
    assert lost == {0: 0, 1: 10, 2: -2, 3: 30, 4: 40}


def test_where_no_scheduler_is_one_line_says_so(press: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foretouch.comparison.cluster.PATIENCE", 0.5)
    for nowhere in (f"tcp://127.0.0.1:{free_endpoint().rpartition(':')[2]}", "nonsense://x", "tcp://"):
        with pytest.raises(LinkError, match="no Dask scheduler at"):
            comparison.compare([comparison.file_case(press)], **CHOSEN, cluster=nowhere)
    result = CliRunner().invoke(app, ["compare", str(press), "--cluster", nowhere])
    assert result.exit_code != 0

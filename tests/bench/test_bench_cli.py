"""`foretouch bench`: what it prints and how it ends."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from foretouch.bench import BENCHMARKS, benchmark, read_baseline
from foretouch.cli.app import app
from foretouch.errors import ForetouchError, install_command
from foretouch.files.children import children

ROW = {"what": str, "figure": float, "unit": str, "reach": float | None, "reached": bool | None}


def rows_of(*arguments: str) -> list[dict[str, Any]]:
    result = CliRunner().invoke(app, ["bench", "--json", *arguments])
    assert result.exit_code == 0, result.output
    rows: list[dict[str, Any]] = json.loads(result.stdout)
    for row in rows:
        assert list(row) == list(ROW)
        assert all(isinstance(row[name], kind | int if kind is float else kind) for name, kind in ROW.items())
        assert (row["reach"] is None) == (row["reached"] is None)
    assert len({row["what"] for row in rows}) == len(rows), "two rows are called alike"
    return rows


def test_an_unknown_name_is_one_line_and_exit_code_2() -> None:
    result = CliRunner().invoke(app, ["bench", "--only", "startup", "--only", "starting"])
    assert isinstance(result.exception, ForetouchError)  # one line and exit code 2
    assert result.stdout == ""
    assert str(result.exception) == f"unknown benchmark 'starting': choose one of {', '.join(sorted(BENCHMARKS))}"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--check", "--only", "batch"), "--check and --only"),
        (("--check", "--full"), "--check and --full"),
        (("--write-baseline", "kept.json", "--check"), "--write-baseline and --check"),
        (("--write-baseline", "kept.json", "--json"), "--write-baseline and --json"),
        (("--write-baseline", "kept.json", "--only", "batch"), "--write-baseline and --only"),
    ],
)
def test_options_that_do_not_go_together_are_one_line(
    options: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["bench", *options])
    assert isinstance(result.exception, ForetouchError)  # one line and exit code 2
    assert str(result.exception) == f"{said} do not go together: leave out one of them"
    assert not list(tmp_path.iterdir())


def test_a_baseline_that_cannot_be_kept_is_refused_before_measuring(tmp_path: Path) -> None:
    kept = tmp_path / "none" / "kept.json"
    begin = time.monotonic()
    result = CliRunner().invoke(app, ["bench", "--write-baseline", str(kept)])
    assert time.monotonic() - begin < 15.0  # all ratios take a minute
    assert isinstance(result.exception, ForetouchError)
    assert str(result.exception) == f"{kept}: cannot be written: No such file or directory"


@pytest.mark.long
def test_each_table_is_printed_when_its_benchmark_ends() -> None:
    command = [sys.executable, "-m", "foretouch", "bench", "--only", "batch", "--only", "startup"]
    with children() as started:
        asked = started.start(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert asked.stdout is not None
        lines: list[str] = []
        while "the same in NumPy" not in "".join(lines[-1:]):  # a row of the first, while the second runs
            lines.append(asked.stdout.readline())
            assert lines[-1], "it ended"
        assert asked.poll() is None
    assert "startup" not in "".join(lines)


MARK = "FORETOUCH_TEST_OF_BENCH"


def marked(mark: str) -> list[int]:
    """Processes that have a mark in their environment."""
    result = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if f"{MARK}={mark}".encode() in (folder / "environ").read_bytes():
                result.append(int(folder.name))
    return result


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="it looks for processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.long
def test_who_ends_the_parent_alone_leaves_nothing_running_and_has_what_was_done(number: int) -> None:
    mark = uuid.uuid4().hex
    command = [sys.executable, "-m", "foretouch", "bench", "--json", "--only", "batch", "--only", "startup"]
    with children() as started:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        asked = started.start(command, env={**os.environ, MARK: mark}, **pipes)
        assert asked.stderr is not None
        assert asked.stderr.readline().startswith(" 1 of 2  batch")
        until = time.monotonic() + 30.0
        while len(marked(mark)) < 4:  # the command, the benchmark, who times, who is timed
            assert time.monotonic() < until
            time.sleep(0.01)
        os.kill(asked.pid, number)
        output, text = asked.communicate(timeout=30.0)
        left = marked(mark)
    assert not left
    assert asked.returncode == 130
    assert text.splitlines() == ["1 of 2 benchmarks were done", "foretouch: interrupted"]
    assert len(json.loads(output)) == 4


def test_what_a_child_started_ends_with_it_even_if_it_does_not_want_to() -> None:
    stubborn = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True)"
    script = (
        f"import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', {stubborn + '; time.sleep(60)'!r}])\n"
        "time.sleep(60)"
    )
    mark = uuid.uuid4().hex
    with children(grace=0.5) as started:
        pipes = {"stdout": subprocess.PIPE, "text": True, "env": {**os.environ, MARK: mark}}
        child = started.start([sys.executable, "-c", script], **pipes)
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
    assert child.returncode == -signal.SIGTERM
    until = time.monotonic() + 5.0
    while Path("/proc/self/environ").exists() and marked(mark):
        assert time.monotonic() < until
        time.sleep(0.01)


def test_every_benchmark_can_be_had() -> None:
    assert all(callable(benchmark(name)) and BENCHMARKS[name] for name in BENCHMARKS)


@pytest.mark.long  # all of them are run by the next one, and rows are checked in test_bench_page
def test_one_benchmark_as_json() -> None:
    rows = rows_of("--only", "batch", "--only", "batch")
    assert [(row["unit"], row["reach"]) for row in rows] == [
        ("x", 10.0),
        *[("ns/sample", r) for r in (8.0, 16.0, None)],
    ]
    assert rows[0]["figure"] == pytest.approx(rows[3]["figure"] / rows[1]["figure"], rel=0.5)


@pytest.mark.long
@pytest.mark.live
def test_all_benchmarks_as_json() -> None:
    rows = rows_of()
    assert len(rows) > 2 * len(BENCHMARKS)
    assert any(row["unit"] == "x" for row in rows)


@pytest.mark.live
@pytest.mark.long
def test_one_way_times_are_of_every_wire() -> None:
    pytest.importorskip("zenoh")
    pytest.importorskip("cryptography")
    from foretouch.bench.benchmarks.link import DELAYED, KINDS, SEGMENT, one_way_times

    times = one_way_times((DELAYED, *KINDS), 1)
    for sent in times.values():
        assert sent.size > 0.9 * SEGMENT
        assert 0.0 < float(sorted(sent)[sent.size // 2]) < 50.0  # milliseconds; the delay itself is taken off


@pytest.mark.live
@pytest.mark.long
def test_a_session_is_timed_beside_a_bare_loop(tmp_path: Any) -> None:
    from foretouch.bench.benchmarks.loops import SIDES, bare_round, session_round

    assert bare_round(tmp_path, 1.0).size == 1000
    result = session_round(tmp_path, 4.0)
    for name in SIDES:
        ticks, why = result[name]
        assert ticks.late_ns.size > 1000
        assert sum(why.values()) == int((ticks.late_ns > 500_000).sum())


@pytest.mark.long
def test_what_is_missing_is_said_and_left_out(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mujoco.py").write_text("raise ImportError('No module named mujoco')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    result = CliRunner().invoke(app, ["bench", "--json", "--only", "simulate", "--only", "batch"])
    assert result.exit_code == 0
    assert f"simulate is left out: mujoco is not installed: {install_command('sim')}" in result.stderr
    assert {row["unit"] for row in json.loads(result.stdout)} == {"x", "ns/sample"}


@pytest.mark.long
def test_a_benchmark_that_fails_is_said_and_the_others_go_on(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mujoco.py").write_text("raise RuntimeError('no luck')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    result = CliRunner().invoke(app, ["bench", "--json", "--only", "simulate", "--only", "batch"])
    assert result.exit_code == 1
    assert "the benchmark simulate failed, exit code 1: RuntimeError: no luck" in result.stderr
    assert len(json.loads(result.stdout)) == 4


@pytest.mark.long
def test_ratios_are_checked_against_those_kept_before(tmp_path: Any) -> None:
    kept = tmp_path / "baseline.json"
    assert CliRunner().invoke(app, ["bench", "--write-baseline", str(kept)]).exit_code == 0
    assert set(json.loads(kept.read_text())) == set(read_baseline())
    result = CliRunner().invoke(app, ["bench", "--check", "--json"])
    rows = json.loads(result.stdout)
    assert result.exit_code == (0 if all(row["passed"] for row in rows) else 1)
    assert {row["what"] for row in rows} == set(read_baseline())

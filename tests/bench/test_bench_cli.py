"""`foretouch bench`: what it prints and how it ends."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest
from typer.testing import CliRunner

from foretouch.bench import BENCHMARKS, benchmark, read_baseline
from foretouch.cli.app import app

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
    command = [sys.executable, "-m", "foretouch", "bench", "--only", "startup", "--only", "starting"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.splitlines() == [
        f"foretouch: unknown benchmark 'starting': choose one of {', '.join(sorted(BENCHMARKS))}"
    ]


def test_every_benchmark_can_be_had() -> None:
    assert all(callable(benchmark(name)) and BENCHMARKS[name] for name in BENCHMARKS)


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
    from foretouch.bench.benchmarks.link import one_way_times
    from foretouch.bench.wire import DELAYED, KINDS, STRETCH

    times = one_way_times((DELAYED, *KINDS), 1)
    for sent in times.values():
        assert sent.size > 0.9 * STRETCH
        assert 0.0 < float(sorted(sent)[sent.size // 2]) < 50.0  # milliseconds; the delay itself is taken off


@pytest.mark.live
@pytest.mark.long
def test_a_session_is_timed_beside_a_bare_loop(tmp_path: Any) -> None:
    from foretouch.bench.benchmarks.loops import SIDES, bare_round, session_round

    assert bare_round(tmp_path, 1.0).size == 1000
    found = session_round(tmp_path, 4.0)
    for name in SIDES:
        ticks, why = found[name]
        assert ticks.late_ns.size > 1000
        assert sum(why.values()) == int((ticks.late_ns > 500_000).sum())


def test_what_is_missing_is_said_and_left_out(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mujoco.py").write_text("raise ImportError('No module named mujoco')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    result = CliRunner().invoke(app, ["bench", "--json", "--only", "simulate", "--only", "batch"])
    assert result.exit_code == 0
    assert "simulate is left out: mujoco is not installed: pip install 'foretouch[sim]'" in result.stderr
    assert {row["unit"] for row in json.loads(result.stdout)} == {"x", "ns/sample"}


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

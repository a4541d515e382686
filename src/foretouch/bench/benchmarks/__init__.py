"""The benchmarks, those of one kind in a file: `measure_NAME(scope)` returns the rows of one.

Each runs in a process of its own: no other's memory, garbage or threads are in its figures.
"""

from __future__ import annotations

import importlib
import subprocess
import sys
from collections.abc import Callable, Sequence

import msgspec

from foretouch.bench.timing import Row, Scope
from foretouch.errors import UnknownNameError
from foretouch.files.children import GRACE, children

__all__ = ["BENCHMARKS", "Measure", "benchmark", "run_benchmarks"]

Measure = Callable[[Scope], list[Row]]
"""What a benchmark is."""

BENCHMARKS: dict[str, tuple[str, str]] = {
    "fprls": ("updates", "the paper's estimator over one recording, beside peers"),
    "batch": ("streams", "the paper's estimator over thousands of recordings at once"),
    "call": ("updates", "one call a sample from Python, and what it leaves in memory"),
    "map": ("updates", "the contact map over one recording, and against its cells"),
    "mesh": ("updates", "the proxy on a mesh, against its triangles"),
    "steps": ("steps", "the steps of leader and follower"),
    "profile": ("profile", "where the time of both steps goes, part by part"),
    "simulate": ("steps", "a session in simulated time"),
    "loops": ("loops", "a session in real time with console and recorder, beside a bare loop"),
    "link": ("link", "one-way times between two processes, over TCP, TLS and QUIC"),
    "identify": ("commands", "an hour of samples through `foretouch identify`"),
    "compare": ("commands", "many recordings through `foretouch compare`, two at a time"),
    "growth": ("streams", "time and memory of ever longer streams"),
    "startup": ("commands", "fresh processes"),
}
"""Names, the module of each and what it measures, in the order in which they run."""


def benchmark(name: str) -> Measure:
    """The function that measures a benchmark, imported only now; an UnknownNameError where there is none."""
    if name not in BENCHMARKS:
        raise UnknownNameError("benchmark", name, BENCHMARKS)
    measure: Measure = getattr(importlib.import_module(f"{__name__}.{BENCHMARKS[name][0]}"), f"measure_{name}")
    return measure


def run_benchmarks(
    names: Sequence[str] = (),
    *,
    full: bool = False,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, list[Row]], None] = lambda name, rows: None,
) -> dict[str, list[Row]]:
    """Run benchmarks of `BENCHMARKS` one after another, or all: the rows of each, those that failed left out.

    Args:
        names: Names of benchmarks; all where none is given.
        full: All that is asked for, however long it takes; else a short form that says so.
        say: Called with a line for each part left out and each benchmark that failed.
        progress: Called with the name and the rows of each that has ended.

    Raises:
        UnknownNameError: There is no benchmark of a name.
    """
    for name in names:
        if name not in BENCHMARKS:
            raise UnknownNameError("benchmark", name, BENCHMARKS)
    done = {}
    for name in dict.fromkeys(names or BENCHMARKS):
        rows = _run(name, full, say)
        if rows is not None:
            done[name] = rows
            progress(name, rows)
    return done


def _run(name: str, full: bool, say: Callable[[str], None]) -> list[Row] | None:
    command = [sys.executable, "-m", "foretouch.bench", name, *(["--full"] if full else [])]
    with children(grace=3.0 * GRACE) as started:  # it has processes of its own to end first
        child = started.start(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert child.stdout is not None
        assert child.stderr is not None
        last = ""
        for line in child.stderr:  # all of the rows come at the end, in one line
            last = line.rstrip() or last
            if line.startswith("foretouch: "):
                say(line.removeprefix("foretouch: ").rstrip())
        output = child.stdout.read()
        child.wait()
    if child.returncode:
        say(f"the benchmark {name} failed, exit code {child.returncode}: {last}")
        return None
    return msgspec.json.decode(output, type=list[Row])

"""Running benchmarks, each in a process of its own: no other's memory, garbage or threads are in its figures."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence

import msgspec

from foretouch.bench.benchmarks import BENCHMARKS
from foretouch.bench.children import GRACE, children
from foretouch.bench.rows import Row
from foretouch.errors import UnknownNameError


def run_benchmarks(
    names: Sequence[str] = (),
    *,
    full: bool = False,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, list[Row]], None] = lambda name, rows: None,
) -> dict[str, list[Row]]:
    """Run benchmarks one after another.

    Args:
        names: Of `BENCHMARKS`; all where none is given.
        full: All that is asked for, however long it takes; else a short form that says so.
        say: Told what is left out and which benchmark failed, a line each.
        progress: Called with the name and the rows of each that has ended.

    Returns:
        The rows of each, those that failed left out.

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

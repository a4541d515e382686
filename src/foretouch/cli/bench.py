"""The command that measures how fast everything is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import say, show
from foretouch.cli.progress import progress_bar
from foretouch.errors import ForetouchError

if TYPE_CHECKING:
    from foretouch.bench import Row

__all__ = ["COMMANDS", "bench"]

WIDTH = 130
"""Of tables that go into a file or a pipe."""


def bench(
    only: Annotated[list[str] | None, typer.Option(help="One benchmark; may be given more than once.")] = None,
    full: Annotated[
        bool, typer.Option("--full", help="All that is asked for, which takes hours; else scaled down, and said so.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Instead: is anything slower than it was? Ratios against the baseline.")
    ] = False,
    write_baseline: Annotated[
        Path | None, typer.Option(help="Instead: keep the ratios that --check compares, in this file.")
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the rows as a JSON array, at the end.")] = False,
) -> None:
    """How fast everything is on this machine, beside others that do the same, and beside what is asked for.

    Example: foretouch bench --only fprls --only call
    """
    given = {"--only": bool(only), "--full": full, "--check": check, "--json": json_output}
    if write_baseline is not None:
        _refuse("--write-baseline", given)
        _keep_ratios(write_baseline)
    elif check:
        _refuse("--check", {name: given[name] for name in ("--only", "--full")})
        _judge_ratios(json_output)
    else:
        _measure(only or [], full, json_output)


COMMANDS = (bench,)


def _refuse(option: str, others: dict[str, bool]) -> None:
    """An option that does something else instead goes with no other."""
    for other, there in others.items():
        if there:
            raise ForetouchError(f"{option} and {other} do not go together: leave out one of them")


def _measure(only: list[str], full: bool, json_output: bool) -> None:
    """Run benchmarks; the table of each as soon as it has ended, JSON at the end, however that comes."""
    from foretouch.bench import BENCHMARKS, run_benchmarks
    from foretouch.bench.children import interruptible

    names = list(dict.fromkeys(only or BENCHMARKS))
    done: dict[str, list[Row]] = {}

    def progress(name: str, rows: list[Row]) -> None:
        done[name] = rows
        bar.update(len(done), len(names))
        bar.say(f"{len(done):2} of {len(names)}  {name}: {BENCHMARKS[name]}")
        if rows and not json_output:
            with bar.aside():
                _print_table(name, rows)

    interrupted = False
    with interruptible(), progress_bar("measuring", refreshing=False) as bar:
        bar.update(0, len(names))
        try:
            run_benchmarks(names, full=full, say=bar.say, progress=progress)
        except KeyboardInterrupt:
            interrupted = True
    if json_output:
        show(json.dumps([row.as_row() for rows in done.values() for row in rows], allow_nan=False))
    if interrupted:
        say(f"{len(done)} of {len(names)} benchmarks were done")
        raise KeyboardInterrupt
    if len(done) < len(names):  # said when it happened
        raise typer.Exit(1)


def _print_table(name: str, rows: list[Row]) -> None:
    from rich.console import Console

    from foretouch.bench import render_table

    console = Console()
    console.width = max(console.width, WIDTH) if not console.is_terminal else console.width
    console.print(render_table({name: rows}))


def _keep_ratios(path: Path) -> None:
    from foretouch.bench.check import measure_ratios, try_to_write, write_baseline

    try_to_write(path)
    write_baseline(path, measure_ratios(short=False))
    say(f"baseline: {path}")


def _judge_ratios(json_output: bool) -> None:
    from foretouch.bench.check import check

    checked = check()
    if json_output:
        rows = [{"what": c.name, "figure": c.ratio, "baseline": c.baseline, "passed": c.passed} for c in checked]
        show(json.dumps(rows, allow_nan=False))
    else:
        for one in checked:
            show(one.sentence)
    if not all(one.passed for one in checked):
        raise typer.Exit(1)

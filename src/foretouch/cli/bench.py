"""The command that measures how fast everything is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from foretouch.cli.options import say
from foretouch.cli.progress import progress_bar

__all__ = ["COMMANDS", "bench"]


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
    json_output: Annotated[bool, typer.Option("--json", help="Print the rows as a JSON array.")] = False,
) -> None:
    """How fast everything is on this machine, beside others that do the same, and beside what is asked for.

    Example: foretouch bench --only fprls --only call
    """
    if check or write_baseline is not None:
        _ratios(write_baseline, json_output)
        return
    from foretouch.bench import BENCHMARKS, render_table, run_benchmarks

    names = only or list(BENCHMARKS)
    done = []

    def progress(name: str, rows: object) -> None:
        done.append(name)
        bar.update(len(done), len(dict.fromkeys(names)))
        bar.say(f"{len(done):2} of {len(dict.fromkeys(names))}  {name}: {BENCHMARKS[name]}")

    with progress_bar("measuring", refreshing=False) as bar:
        bar.update(0, len(dict.fromkeys(names)))
        measured = run_benchmarks(names, full=full, say=bar.say, progress=progress)
    if json_output:
        typer.echo(json.dumps([row.as_row() for rows in measured.values() for row in rows], allow_nan=False))
    else:
        from rich.console import Console

        console = Console()
        console.width = max(console.width, 130) if not console.is_terminal else console.width
        console.print(render_table(measured))
    if len(measured) < len(set(names)):  # said when it happened
        raise typer.Exit(1)


COMMANDS = (bench,)


def _ratios(write_to: Path | None, json_output: bool) -> None:
    """Measure the ratios, and keep or judge them."""
    from foretouch.bench.check import check, measure_ratios, write_baseline

    if write_to is not None:
        write_baseline(write_to, measure_ratios(short=False))
        say(f"baseline: {write_to}")
        return
    checked = check()
    if json_output:
        rows = [{"what": c.name, "figure": c.ratio, "baseline": c.baseline, "passed": c.passed} for c in checked]
        typer.echo(json.dumps(rows, allow_nan=False))
    else:
        for one in checked:
            typer.echo(one.sentence)
    if not all(one.passed for one in checked):
        raise typer.Exit(1)

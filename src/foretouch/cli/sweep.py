"""The command that runs many simulated sessions."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Cluster, Json, made_by, make_folder, print_json, say, show
from foretouch.cli.progress import compile_first
from foretouch.errors import SettingError

if TYPE_CHECKING:
    from foretouch.sweep import Outcome

__all__ = ["SWEEP", "sweep"]

LINES = 20
"""Where nobody watches a terminal, progress is said so often."""


def sweep(
    out: Annotated[Path, typer.Option(help="Folder for the rows and the page; what it has is not run again.")] = Path(
        "sweep"
    ),
    sessions: Annotated[int, typer.Option(help="How many.")] = 1000,
    baselines: Annotated[
        int | None, typer.Option(help="With how many of them each baseline is run too; without it 100 at most.")
    ] = None,
    duration: Annotated[
        float, typer.Option(help="Of a session without delay [s]; 4 round trips more with one.")
    ] = 30.0,
    seed: Annotated[int, typer.Option(help="Of all sessions.")] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes at a time; without it, one for each core.")] = None,
    cluster: Cluster = None,
    quick: Annotated[bool, typer.Option("--quick", help="12 sessions of 4 s, 2 of them with the baselines.")] = False,
    replay: Annotated[
        int | None, typer.Option(help="Run the session with this number again and compare it with its row.")
    ] = None,
    baseline: Annotated[str, typer.Option(help="Of the session to replay: none, delayed or delayed-tdpa.")] = "none",
    json_output: Json = False,
) -> None:
    """Many simulated sessions over delays, losses, materials, grips and model rates: are all stable, how do they feel.

    Example: foretouch sweep --out sweep --sessions 100 --baselines 20
    """
    if replay is not None:
        _replay(out, replay, baseline, json_output)
        return
    if baseline != "none":
        raise SettingError("baseline", baseline, "is of the session to replay: give its number by --replay")
    from foretouch.sweep import Plan, render_table, run_sweep, summary, write_sweep_page

    make_folder(out)
    compared = min(100, sessions) if baselines is None else baselines
    plan = Plan(12, 2, 4.0, seed) if quick else Plan(sessions, compared, duration, seed)
    compile_first()
    with _progress() as progress:
        rows = run_sweep(out, plan, processes=jobs, cluster=cluster, progress=progress, say=say)
    made = made_by(plan=", ".join(f"{name} {value:g}" for name, value in asdict(plan).items()))
    page = write_sweep_page(out, rows, made)
    content = summary(rows)
    if json_output:
        print_json({**content, "page": str(page)})
    else:
        show(render_table(content))
        say(f"page: {page}")
    if content["objections"]:
        raise typer.Exit(1)


SWEEP = (sweep,)


def _replay(folder: Path, number: int, baseline: str, json_output: bool) -> None:
    from foretouch.sweep import replay_session

    replayed = replay_session(folder, number, baseline=baseline)
    if json_output:
        print_json({"number": number, "baseline": baseline, **replayed.as_row()})
    else:
        show(replayed.sentence)
        show(replayed.stored.command)
    if not replayed.identical:
        raise typer.Exit(1)


@contextmanager
def _progress() -> Iterator[Callable[[int, int, Outcome], None]]:
    """A bar on a terminal; elsewhere a line now and then. What is wrong with a session is said at once on both."""
    if not sys.stderr.isatty():
        yield _say_some
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("sessions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("sessions", total=None)

        def show(done: int, total: int, row: Outcome) -> None:
            bar.update(task, completed=done, total=total)
            for line in _wrong(row):
                bar.console.print(line, highlight=False)

        yield show


def _say_some(done: int, total: int, row: Outcome) -> None:
    for line in _wrong(row):
        say(line)
    if done == total or done * LINES // total > (done - 1) * LINES // total:
        say(f"{done} of {total} sessions")


def _wrong(row: Outcome) -> list[str]:
    """A baseline is expected to fail where theory says so; ours is not."""
    return [f"session {row.number}: {text}" for text in row.objections] if row.baseline == "none" else []

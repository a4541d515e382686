"""Commands that run studies: laws and estimators compared, many simulated sessions, and the paper made again."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import (
    ContactFloor,
    Json,
    ReportDirectory,
    ScoreTo,
    made_by,
    make_folder,
    print_json,
    say,
    show,
    with_options,
)
from foretouch.cli.progress import compile_first, progress_bar
from foretouch.cli.reading import RECORDING_HELP, recording_options, say_how_it_is_read
from foretouch.errors import SettingError, plural

if TYPE_CHECKING:
    from foretouch.comparison import Case
    from foretouch.recordings import RecordingOptions
    from foretouch.sweep import Outcome, Plan


@dataclass(frozen=True)
class ComparedOn:
    """The recordings that laws and estimators are compared on."""

    recordings: Annotated[list[Path] | None, typer.Argument(help=f"{RECORDING_HELP} Any number.")] = None
    datasets: Annotated[
        list[str] | None,
        typer.Option("--dataset", help="One of `foretouch datasets list`; may be given more than once."),
    ] = None
    simulated: Annotated[
        bool, typer.Option("--simulated", help="On simulated recordings too, whose truth is known.")
    ] = False
    seed: Annotated[int, typer.Option(min=0, help="Of the simulated recordings; everything was chosen on seed 0.")] = 0

    def cases(self, options: RecordingOptions) -> list[Case]:
        """All of them; how each file is read is said, and one that cannot be read fails later, with its reason."""
        from foretouch import comparison
        from foretouch.recordings import excerpt

        cases = []
        for path in self.recordings or ():
            say_how_it_is_read(path, options)
            cases.append(comparison.file_case(path, options))
        cases += [replace(comparison.file_case(excerpt(name), options), name=name) for name in self.datasets or ()]
        return cases + (comparison.simulated_cases(self.seed) if self.simulated else [])


@dataclass(frozen=True)
class Compared:
    """What is compared: laws and estimators, each under each of the delays."""

    models: Annotated[
        list[str] | None, typer.Option("--models", help="Contact law; may be given more than once. Without it, all.")
    ] = None
    estimators: Annotated[
        list[str] | None, typer.Option("--estimators", help="Estimator; may be given more than once. Without it, all.")
    ] = None
    delay: Annotated[list[float] | None, typer.Option(help="Of the forces [s], 0.3; may be given more than once.")] = (
        None
    )
    swept: Annotated[
        bool, typer.Option("--sweep", help="At 0, 50, 100, 200, 300, 500 and 1000 ms too: error against delay.")
    ] = False

    def delays(self) -> tuple[float, ...]:
        """Of the forces [s]."""
        from foretouch.comparison import SWEEP

        return tuple(sorted({*(self.delay or ()), *SWEEP}) if self.swept else self.delay or [0.3])


@dataclass(frozen=True)
class Scored:
    """Which part of each recording is scored; the recording says what is not given."""

    score_from: Annotated[
        float | None, typer.Option(help="Scoring begins [s after the first sample]: 1.5, simulated recordings 3.")
    ] = None
    score_to: ScoreTo = None
    contact_floor: ContactFloor = None


@dataclass(frozen=True)
class Workers:
    """Which processes share the work."""

    jobs: Annotated[int | None, typer.Option(min=1, help="Processes at a time; without it, one for each core.")] = None
    cluster: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler, such as tcp://HOST:8786: its workers do it (extra cluster)."),
    ] = None


@with_options(on=ComparedOn, compared=Compared, options=recording_options, scored=Scored, workers=Workers)
def compare(
    *,
    on: ComparedOn,
    compared: Compared,
    options: RecordingOptions,
    scored: Scored,
    workers: Workers,
    report_directory: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """Compare contact laws and estimators on recordings: every law by every estimator that it has.

    Example: foretouch compare press.csv session.mcap --delay 0.1 --delay 0.3 --report comparison
    """
    from foretouch import comparison

    make_folder(report_directory)
    cases, delays = on.cases(options), compared.delays()

    def progress(done: int, total: int, result: comparison.Result) -> None:
        failed = "" if result.status == "ok" else f"  failed: {result.reason}"
        bar.update(done, total)
        if failed or not bar.shown:
            job = f"{result.recording}: {result.model} by {result.estimator}"
            bar.say(f"{done:{len(str(total))}} of {total}  {job}{failed}")

    compile_first()
    with progress_bar("comparing") as bar:
        bar.pulse()
        results = comparison.compare(
            cases,
            models=compared.models or (),
            estimators=compared.estimators or (),
            scoring=comparison.Scoring(delays, scored.score_from, scored.score_to, scored.contact_floor),
            processes=workers.jobs,
            cluster=workers.cluster,
            progress=progress,
            say=bar.say,
        )
    if json_output:
        print_json({"results": [result.as_row() for result in results]})
    else:
        show(comparison.render_table(results))
    if report_directory is not None:
        said = made_by(
            on.recordings or [],
            datasets=", ".join(on.datasets or []) or None,
            simulated=f"seed {on.seed}" if on.simulated else None,
            laws=", ".join(dict.fromkeys(row.model for row in results)),
            estimators=", ".join(dict.fromkeys(row.estimator for row in results)),
            delays=", ".join(f"{one:g} s" for one in delays),
            **{name: value or None for name, value in asdict(options).items()},
        )
        say(f"report: {comparison.write_comparison_page(report_directory, results, said)}")
    if all(result.status != "ok" for result in results):
        raise typer.Exit(1)


LINES = 20
"""How many lines of progress are printed where the output is not a terminal."""


@dataclass(frozen=True)
class Sessions:
    """Which sessions a sweep runs."""

    sessions: Annotated[int, typer.Option(help="How many.")] = 1000
    baselines: Annotated[
        int | None, typer.Option(help="With how many of them each baseline is run too; without it 100 at most.")
    ] = None
    duration: Annotated[float, typer.Option(help="Of a session without delay [s]; 4 round trips more with one.")] = 30.0
    seed: Annotated[int, typer.Option(help="Of all sessions.")] = 0

    def plan(self, quick: bool) -> Plan:
        """What is run, or a dozen short sessions."""
        from foretouch.sweep import Plan

        if quick:
            return Plan(12, 2, 4.0, self.seed)
        compared = min(100, self.sessions) if self.baselines is None else self.baselines
        return Plan(self.sessions, compared, self.duration, self.seed)


@with_options(which=Sessions, workers=Workers)
def sweep(
    *,
    out: Annotated[Path, typer.Option(help="Folder for the rows and the page; what it has is not run again.")] = Path(
        "sweep"
    ),
    which: Sessions,
    workers: Workers,
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
    from foretouch.sweep import render_table, run_sweep, summary, write_sweep_page

    make_folder(out)
    plan = which.plan(quick)
    compile_first()
    with _progress() as progress:
        rows = run_sweep(out, plan, processes=workers.jobs, cluster=workers.cluster, progress=progress, say=say)
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


def reproduce(
    out: Annotated[Path | None, typer.Option(help="Folder for the page, the figures and the data.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="One section; may be given more than once.")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the claims as a JSON array.")] = False,
) -> None:
    """Make the figures of the paper again and say which of its claims hold.

    What was measured, and under which setting, is on the page, in --json, and here where sections are named by --only.

    Example: foretouch reproduce --out paper
    """
    import json

    from foretouch.reproduction import PAPER, SECTIONS, counted, write_report
    from foretouch.reproduction import reproduce as run

    names = only or list(SECTIONS)
    make_folder(out)

    def progress(name: str, seconds: float) -> None:
        done.append(name)
        left = [other for other in names if other not in done]
        more = f" and {len(left) - 3} more" if len(left) > 3 else ""
        bar.update(len(done), len(names), f"making {', '.join(left[:3])}{more}" if left else "")
        bar.say(f"{len(done):2} of {len(names)}  {name:<12} after {seconds:.0f} s")

    done: list[str] = []
    compile_first()
    with progress_bar("making the paper again") as bar:
        bar.update(0, len(names))
        bar.pulse()
        sections = run(names, progress=progress)
        if out is not None:
            drawn = iter(range(len(sections)))
            made = made_by(paper=PAPER, sections=", ".join(section.name for section in sections))
            page = write_report(
                out, sections, made, progress=lambda name: bar.update(next(drawn), len(sections), f"drawing {name}")
            )
    if out is not None:
        say(f"report: {page}")
    claims = [claim for section in sections for claim in section.claims]
    if json_output:
        show(json.dumps([claim.as_row() for claim in claims], allow_nan=False))
        return
    for section in sections:
        show(f"\n{section.title}")
        for claim in section.claims:
            show(_lines(WORDS[claim.verdict], claim.claim))
            if only:
                for name, text in (("paper", claim.paper), ("measured", claim.measured), ("setting", claim.setting)):
                    show(_lines("", f"{name}: {text}"))
    counts = counted(claims)
    show(
        f"\nOf {plural(len(claims), 'claim')}: {counts['holds']} hold as printed, "
        f"{counts['holds under stated choice']} under a stated choice, {counts['does not hold']} not."
    )


WORDS = {"holds": "holds", "holds under stated choice": "by choice", "does not hold": "does not"}
"""Verdicts in a narrow column."""


def _lines(first: str, text: str) -> str:
    """A row of two columns that is no wider than the terminal, nor than a page."""
    width = min(shutil.get_terminal_size((100, 24)).columns, 120)
    return textwrap.fill(text, max(width, 40), initial_indent=f"  {first:<11}", subsequent_indent=" " * 13)

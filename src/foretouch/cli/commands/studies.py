"""Commands that run studies: laws and estimators compared, many simulated sessions, and the paper made again."""

from __future__ import annotations

import shutil
import textwrap
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Answer, ReportDirectory, command, made_by, require_folder, say
from foretouch.cli.progress import compile_first, progress_bar
from foretouch.cli.reading import RECORDING_HELP, Scored, recording_options, say_how_it_is_read
from foretouch.errors import SettingError, UnknownNameError, plural
from foretouch.settings import SIMULATED

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
class Workers:
    """Which processes share the work."""

    jobs: Annotated[int | None, typer.Option(min=1, help="Processes at a time; without it, one for each core.")] = None
    cluster: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler, such as tcp://HOST:8786: its workers do it (extra cluster)."),
    ] = None


@command(on=ComparedOn, compared=Compared, options=recording_options, scored=Scored, workers=Workers)
def compare(
    *,
    on: ComparedOn,
    compared: Compared,
    options: RecordingOptions,
    scored: Scored,
    workers: Workers,
    report_directory: ReportDirectory = None,
) -> Answer:
    """Compare contact laws and estimators on recordings: every law by every estimator that it has.

    Example: foretouch compare press.csv session.mcap --delay 0.1 --delay 0.3 --report comparison
    """
    from foretouch import comparison

    require_folder(report_directory)
    comparison.combinations(compared.models or (), compared.estimators or ())  # a wrong name is refused at once
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
    if report_directory is not None:
        made = made_by(
            on.recordings or [],
            datasets=", ".join(on.datasets or []) or None,
            simulated=f"seed {on.seed}" if on.simulated else None,
            laws=", ".join(dict.fromkeys(row.model for row in results)),
            estimators=", ".join(dict.fromkeys(row.estimator for row in results)),
            delays=", ".join(f"{one:g} s" for one in delays),
            **{name: value or None for name, value in asdict(options).items()},
        )
        say(f"report: {comparison.write_comparison_page(report_directory, results, made)}")
    content = {"results": [result.as_row() for result in results]}
    failed = all(result.status != "ok" for result in results)
    return Answer(content, comparison.render_table(results), code=int(failed))


LINES = 20  # How many lines of progress are printed where the output is not a terminal


@dataclass(frozen=True)
class Sessions:
    """Which sessions a sweep runs."""

    sessions: Annotated[int, typer.Option(help="How many.")] = 1000
    baselines: Annotated[
        int | None, typer.Option(help="With how many of them each baseline is run too; without it 100 at most.")
    ] = None
    duration: Annotated[float, typer.Option(help="Of a session without delay [s]; 4 round trips more with one.")] = 30.0
    seed: Annotated[int, typer.Option(help="Of all sessions.")] = 0
    robot: Annotated[
        str, typer.Option(help="Of all sessions: simulated, fr3, ur5e, so101, or the file of an arm's description.")
    ] = SIMULATED
    network: Annotated[
        str,
        typer.Option(
            help="Of all sessions, instead of drawn delays and faults: `foretouch network list`, or a file; each "
            "session begins somewhere in it."
        ),
    ] = ""
    budget: Annotated[
        float, typer.Option(help="Bytes that each side of a session may send in a second; 0 for all messages.")
    ] = 0.0
    protection: Annotated[
        str, typer.Option(help="What they send against loss, with a budget: none, parity or strong.")
    ] = "parity"

    def plan(self, quick: bool) -> Plan:
        """What is run, or a dozen short sessions."""
        from foretouch.sweep import Plan

        same = self.seed, self.robot, self.network, self.budget, self.protection
        if quick:
            return Plan(12, 2, 4.0, *same)
        compared = min(100, self.sessions) if self.baselines is None else self.baselines
        return Plan(self.sessions, compared, self.duration, *same)


@command(which=Sessions, workers=Workers)
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
) -> Answer:
    """Many simulated sessions over delays, losses, materials, grips and model rates: are all stable, how do they feel.

    Example: foretouch sweep --out sweep --sessions 100 --baselines 20
    """
    if replay is not None:
        from foretouch.sweep import replay_session

        replayed = replay_session(out, replay, baseline=baseline)
        again = {"number": replay, "baseline": baseline, **replayed.as_row()}
        return Answer(again, [replayed.sentence, replayed.stored.command], code=int(not replayed.identical))
    if baseline != "none":
        raise SettingError("baseline", baseline, "is of the session to replay: give its number by --replay")
    from foretouch.sweep import render_table, run_sweep, summary, write_sweep_page

    plan = which.plan(quick)
    require_folder(out)
    compile_first()
    with progress_bar("sessions") as bar:

        def progress(done: int, total: int, row: Outcome) -> None:
            bar.update(done, total, f"sessions, {done} of {total}")
            for text in row.objections if row.baseline == "none" else ():  # a baseline may fail where theory says so
                bar.say(f"session {row.number}: {text}")
            if not bar.shown and (done == total or done * LINES // total > (done - 1) * LINES // total):
                bar.say(f"{done} of {total} sessions")

        rows = run_sweep(out, plan, processes=workers.jobs, cluster=workers.cluster, progress=progress, say=say)
    made = made_by(
        plan=", ".join(
            f"{name} {value if isinstance(value, str) else format(value, 'g')}" for name, value in asdict(plan).items()
        )
    )
    page = write_sweep_page(out, rows, made)
    content = summary(rows)
    say(f"page: {page}")
    return Answer(content | {"page": str(page)}, render_table(content), code=int(bool(content["objections"])))


@command(json_help="Print the claims as a JSON array.")
def reproduce(
    out: Annotated[Path | None, typer.Option(help="Folder for the page, the figures and the data.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="One section; may be given more than once.")] = None,
) -> Answer:
    """Make the figures of the paper again and say which of its claims hold.

    What was measured, and under which setting, is on the page, in --json, and here where sections are named by --only.

    Example: foretouch reproduce --out paper
    """
    from foretouch.reproduction import PAPER, SECTIONS, counted, write_report
    from foretouch.reproduction import reproduce as run

    names = only or list(SECTIONS)
    for name in names:
        if name not in SECTIONS:
            raise UnknownNameError("section", name, SECTIONS)
    require_folder(out)

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
    rows = [claim.as_row() for claim in claims]
    counts = counted(claims)
    end = (
        f"\nOf {plural(len(claims), 'claim')}: {counts['holds']} hold as printed, "
        f"{counts['holds under stated choice']} under a stated choice, {counts['does not hold']} not."
    )
    lines = []
    for section in sections:
        lines.append(f"\n{section.title}")
        for claim in section.claims:
            lines.append(_wrapped(WORDS[claim.verdict], claim.claim))
            lines += [_wrapped("", f"{name}: {getattr(claim, name)}") for name in FULL] if only else []
    return Answer(rows, [*lines, end])


FULL = ("paper", "measured", "setting")  # What is printed of a claim too, where its section is named
WORDS = {"holds": "holds", "holds under stated choice": "by choice", "does not hold": "does not"}
"""Verdicts in a narrow column."""


def _wrapped(first: str, text: str) -> str:
    """A row of two columns that is no wider than the terminal, nor than a page."""
    width = min(shutil.get_terminal_size((100, 24)).columns, 120)
    return textwrap.fill(text, max(width, 40), initial_indent=f"  {first:<11}", subsequent_indent=" " * 13)

"""Commands about this machine: how fast everything is, whether it is fit for a session, and what readies it for one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.commands.networks import answer_questions
from foretouch.cli.options import Answer, Duration, Endpoints, command, open_link, require_duration, say
from foretouch.cli.progress import compile_first, progress_bar
from foretouch.errors import ForetouchError, LinkError, SettingError
from foretouch.settings import is_arm

if TYPE_CHECKING:
    from rich.console import Console

    from foretouch.bench import Row
    from foretouch.link import ZenohLink
    from foretouch.messages import Message


WIDTH = 130  # Width in columns of tables that go into a file or a pipe


@command(json_help="Print the rows as a JSON array, at the end.")
def bench(
    *,
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
    json_output: bool,
) -> Answer | None:
    """How fast everything is on this machine, beside others that do the same, and beside what is asked for.

    Example: foretouch bench --only fprls --only call
    """
    given = {"--only": bool(only), "--full": full, "--check": check, "--json": json_output}
    if write_baseline is not None:
        from foretouch.bench.check import measure_ratios, try_to_write
        from foretouch.bench.check import write_baseline as write

        _refuse("--write-baseline", given)
        try_to_write(write_baseline)
        write(write_baseline, measure_ratios(short=False))
        say(f"baseline: {write_baseline}")
        return None
    if check:
        from foretouch.bench.check import check as check_ratios

        _refuse("--check", {name: given[name] for name in ("--only", "--full")})
        checked = check_ratios()
        rows = [{"what": c.name, "figure": c.ratio, "baseline": c.baseline, "passed": c.passed} for c in checked]
        return Answer(rows, (one.sentence for one in checked), code=int(not all(one.passed for one in checked)))
    return _measure(only or [], full, json_output)


def _refuse(option: str, others: dict[str, bool]) -> None:
    """An option that does something else instead goes with no other."""
    for other, there in others.items():
        if there:
            raise ForetouchError(f"{option} and {other} do not go together: leave out one of them")


def _measure(only: list[str], full: bool, json_output: bool) -> Answer:
    """Run benchmarks; the table of each as soon as it has ended, JSON at the end, however that comes."""
    from foretouch.bench import BENCHMARKS, render_table, run_benchmarks
    from foretouch.files.children import interruptible

    names = list(dict.fromkeys(only or BENCHMARKS))
    done: dict[str, list[Row]] = {}

    def progress(name: str, rows: list[Row]) -> None:
        done[name] = rows
        bar.update(len(done), len(names))
        bar.say(f"{len(done):2} of {len(names)}  {name}: {BENCHMARKS[name][1]}")
        if rows and not json_output:
            with bar.aside():
                _console().print(render_table({name: rows}))

    interrupted = False
    with interruptible(), progress_bar("measuring", refreshing=False) as bar:
        bar.update(0, len(names))
        try:
            run_benchmarks(names, full=full, say=bar.say, progress=progress)
        except KeyboardInterrupt:
            interrupted = True
    answer = Answer([row.as_row() for rows in done.values() for row in rows])
    if interrupted:
        answer.give(json_output)
        say(f"{len(done)} of {len(names)} benchmarks were done")
        raise KeyboardInterrupt
    return replace(answer, code=int(len(done) < len(names)))  # what failed was reported when it did


def _console() -> Console:
    """The output, at least `WIDTH` wide where it is a file or a pipe."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, WIDTH)
    return console


LONGEST = 600.0  # The longest examination of loops and peers [s]
FARTHEST = 20.0  # Way of a robot that is looked at, at most [mm]


@command(endpoints=Endpoints)
def doctor(
    *,
    endpoints: Endpoints,
    seconds: Annotated[float, typer.Option(help="That the loops run, and that a peer is asked [s].")] = 5.0,
    robot: Annotated[
        str,
        typer.Option(help="A robot that is looked at too: a simulated arm, its file, or a real one."),
    ] = "",
    device: Annotated[
        str, typer.Option(help="A device that is looked at too, as --operator of a session names it.")
    ] = "",
    move: Annotated[
        float, typer.Option(help="How far a real robot may go out and back, in free air [mm]; 0: not.")
    ] = 0.0,
    network: Annotated[
        str,
        typer.Option(
            help="A network, of `foretouch network list` or a file of its delays, that a session is simulated over."
        ),
    ] = "",
    duration: Duration = None,
    json_output: bool,
) -> Answer:
    """Is this machine fit for a session, and the way to another? Each check with a verdict and what mends it.

    With --robot and --device what is connected is looked at, at rest: rate, noise, drift, steps; with --move a robot
    goes out and back, for latency, sign and frame. With --network it says how a session over one would feel. With
    --connect a peer is asked too: a `foretouch doctor --listen` there answers, and a session that runs there is
    listened to. With --listen nothing is checked: it answers until Ctrl-C, or for --duration. Exit code 1 where
    something is bad.

    Example: foretouch doctor --connect tcp/127.0.0.1:7447 --seconds 5
    """
    if not 0.0 < seconds <= LONGEST:
        raise SettingError("seconds", seconds, f"must be above 0 and at most {LONGEST:g}")
    require_duration(duration)
    if not 0.0 <= move <= FARTHEST:
        raise SettingError("move", move, f"must be 0 to {FARTHEST:g} mm")
    if move and not robot:
        raise SettingError("move", move, "is of a robot: add --robot NAME")
    if endpoints.listen:
        _refuse("--listen", {"--robot": bool(robot), "--device": bool(device), "--network": bool(network)})
        if endpoints.connect:
            raise LinkError("give --listen on one machine and --connect on the other")
        return answer_questions(endpoints, duration)
    from foretouch.doctor import Verdict, examine, render_findings, worst

    ways = tuple(_way(endpoints, each) for each in endpoints.connect or ())
    with progress_bar("looking at this machine", refreshing=False) as bar:
        findings = list(
            examine(
                seconds=seconds,
                keys=endpoints.keys,
                ways=ways,
                arm=robot if is_arm(robot) else "",
                machines=tuple(_connected(robot, device)),
                move=1e-3 * move,
                network=network,
                say=lambda what: bar.update(0.0, None, what),
            )
        )
    verdict, lines = worst(findings), ""
    if not json_output:
        _console().print(render_findings(findings))
        counts = {each: sum(finding.verdict is each for finding in findings) for each in Verdict}
        text = ", ".join(f"{count} {each.value}" for each, count in counts.items() if count)
        lines = f"{text}; all in all: {verdict.value}"
    content = {"verdict": verdict.value, "findings": [finding.as_row() for finding in findings]}
    return Answer(content, lines, code=int(verdict is Verdict.BAD))


def _connected(robot: str, device: str) -> Iterator[tuple[str, str]]:
    """What is looked at beside the machine, once its name is known to be one; simulated arms are timed instead."""
    from foretouch.session import SessionSettings

    if robot and not is_arm(robot):
        yield "robot", SessionSettings(robot=robot).robot
    if device:
        yield "device", SessionSettings(operator=device).operator


@command()
def warm_up() -> None:
    """Compile what sessions and estimators run, once on this machine, in about a minute; `make setup` does it.

    Without it the first command that needs it does the same. Exit code 1 where it could not be kept.

    Example: foretouch warm-up
    """
    if not compile_first():
        say("not everything could be compiled and kept: each start compiles what it needs")
        raise typer.Exit(1)
    say("everything is compiled")


def _way(endpoints: Endpoints, endpoint: str) -> tuple[str, str, int, Callable[[Callable[[Message], None]], ZenohLink]]:
    """To one peer; a malformed endpoint, or one that is not allowed, is refused before anything is checked."""
    from foretouch.doctor.network import DOCTOR_CHANNELS
    from foretouch.link import check_endpoint

    check_endpoint(endpoint, insecure=endpoints.insecure)
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    one = replace(endpoints, connect=[endpoint])
    return endpoint, host.strip("[]"), int(port), lambda watch: open_link("doctor", one, DOCTOR_CHANNELS, watch)

"""Commands about networks that sessions can be run over: what there is, what one is like, and measuring one's own."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from foretouch.cli.options import (
    Answer,
    Duration,
    Endpoints,
    KeysFolder,
    command,
    open_link,
    require_duration,
    require_writable,
    say,
)
from foretouch.cli.progress import progress_bar, pulsing
from foretouch.errors import SettingError

network = typer.Typer(help="Measured networks that a session can be run over.", no_args_is_help=True)

NETWORK_HELP = "A name of `foretouch network list`, or a file of time and delay."


@network.command("list")
@command()
def list_networks() -> Answer:
    """The networks that --network takes by name: how long, how late, whose, and as what they are published.

    Those of others are fetched when they are first used; what is not here yet is listed without figures.

    Example: foretouch network list
    """
    from foretouch.link import NETWORK_NAMES, PUBLISHED_NETWORKS, network_trace
    from foretouch.report import LIST_HEAD, network_figures, network_row

    content: list[dict[str, Any]] = []
    lines = [LIST_HEAD]
    for name in NETWORK_NAMES:
        published = PUBLISHED_NETWORKS.get(name)
        if published is not None and not published.here:
            about = {"source": published.source, "licence": published.licence}
            content.append({"name": name, "here": False, **about})
            lines.append(f"{name:<20}  not here yet: foretouch network show {name} fetches it")
        else:
            trace = network_trace(name)
            about = {"source": trace.source, "licence": trace.licence}
            content.append({"here": True, **network_figures(trace)})
            lines.append(network_row(trace))
        lines += [f"    {text}" for text in about.values() if text]
    return Answer({"networks": content}, lines)


@network.command("show")
@command()
def show_network(
    network: Annotated[str, typer.Argument(metavar="NETWORK", help=NETWORK_HELP)],
    figure: Annotated[Path | None, typer.Option(help="PNG file for a drawing of the delay over time.")] = None,
) -> Answer:
    """What a network does to a session: its delays, its stalls, and whether the safety at the robot acts in them.

    Example: foretouch network show low-orbit --figure low-orbit.png
    """
    from foretouch.link import network_trace
    from foretouch.recordings import atomic_path
    from foretouch.report import network_figure, network_figures, network_lines

    if figure is not None:
        if figure.suffix.lower() != ".png":
            raise SettingError("figure", str(figure), "must end with .png")
        require_writable(figure.parent)
    trace = pulsing(f"reading {network}", network_trace, network)
    if figure is not None:
        with atomic_path(figure) as part:
            network_figure(trace).savefig(part, format="png", dpi=120)
        say(f"figure: {figure}")
    return Answer(network_figures(trace), network_lines(trace))


PORT = 7447  # Of the other machine, where none is named
HERE = ("localhost", "127.", "[::1]")  # Beginnings of the names of this machine: nothing leaves it
HOST_HELP = "The other machine: HOST, HOST:PORT or an endpoint such as tls/HOST:7447."
Insecure = Annotated[bool, typer.Option("--insecure", help="Without keys, over tcp: anybody may listen.")]


def endpoint_of(host: str, *, insecure: bool) -> str:
    """The endpoint of a machine: with keys, unless nothing leaves this one, or none are wanted."""
    if "/" in host:
        return host
    named = host.rpartition(":")[2].isdecimal() and (host.count(":") == 1 or "]:" in host)
    protocol = "tcp" if insecure or host.startswith(HERE) else "tls"
    return f"{protocol}/{host}" if named else f"{protocol}/{host}:{PORT}"


@network.command("measure")
@command()
def measure_network(
    host: Annotated[str, typer.Argument(metavar="HOST", help=HOST_HELP)],
    seconds: Annotated[float, typer.Option(help="How long it is measured [s].")] = 120.0,
    out: Annotated[
        Path | None, typer.Option(help="CSV file for the trace; without it foretouch-network-DATE-TIME.csv here.")
    ] = None,
    insecure: Insecure = False,
    keys: KeysFolder = None,
) -> Answer:
    """Measure your own link, with as many and as large messages as a session's, as a file that --network takes.

    `foretouch network answer` has to run on the other machine. No command is sent, so that no robot moves. Ctrl-C ends
    it early, and what was measured is kept.

    Example: foretouch network measure 127.0.0.1 --seconds 5 --out home.csv
    """
    from foretouch.doctor.measuring import MOST_SECONDS, measure
    from foretouch.doctor.network import DOCTOR_CHANNELS
    from foretouch.link import read_trace
    from foretouch.recordings import atomic_path
    from foretouch.report import network_figures, network_lines
    from foretouch.session import StopFlag, be_prompt

    if not 1.0 <= seconds <= MOST_SECONDS:
        raise SettingError("seconds", seconds, f"must be 1 to {MOST_SECONDS:g}")
    path = out or Path(time.strftime("foretouch-network-%Y%m%d-%H%M%S.csv"))
    require_writable(path.parent)
    endpoint = endpoint_of(host, insecure=insecure)
    ends = Endpoints(connect=[endpoint], insecure=insecure, keys=keys)
    be_prompt()
    stop = StopFlag().on_signals()
    with progress_bar(f"measuring {endpoint}") as bar:
        measured = measure(
            lambda watch: open_link("doctor", ends, DOCTOR_CHANNELS, watch),
            seconds,
            should_stop=lambda: bool(stop.reason),
            progress=lambda now: bar.update(now, seconds),
        )
    begun = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    with atomic_path(path) as part:
        part.write_text("\n".join(measured.lines(f"foretouch network measure {endpoint}, until {begun}")) + "\n")
    say(f"trace: {path}")
    trace = read_trace(path)
    content = network_figures(trace) | {"file": str(path), "asked": measured.sent.size, "lost": measured.lost}
    lost = f"{measured.lost} of {measured.sent.size} messages without an answer; they count as late"
    hint = f"foretouch simulate --network {path} --grip normal"
    return Answer(content, [*network_lines(trace), f"  lost            {lost}", f"  next            {hint}"])


@network.command("answer")
@command()
def answer_network(
    host: Annotated[
        str, typer.Argument(metavar="HOST", help="Address of this machine to answer at; 0.0.0.0 for all of them.")
    ] = "127.0.0.1",
    duration: Duration = None,
    insecure: Insecure = False,
    keys: KeysFolder = None,
) -> Answer:
    """Answer a `foretouch network measure` on another machine, until Ctrl-C or for --duration.

    Example: foretouch network answer 127.0.0.1 --duration 30
    """
    require_duration(duration)
    ends = Endpoints(listen=[endpoint_of(host, insecure=insecure)], insecure=insecure, keys=keys)
    return answer_questions(ends, duration)


def answer_questions(endpoints: Endpoints, duration: float | None) -> Answer:
    """Answer doctors, and those who measure, until it is ended; what was answered."""
    from foretouch.doctor.network import DOCTOR_CHANNELS, Answerer

    end = None if duration is None else time.monotonic() + duration
    answerer = Answerer(lambda watch: open_link("doctor", endpoints, DOCTOR_CHANNELS, watch))
    say(f"answers on {endpoints}; Ctrl-C ends it")
    try:
        answerer.run(lambda: end is not None and time.monotonic() >= end)
    except KeyboardInterrupt:  # the usual end
        pass
    finally:
        answerer.close()
    return Answer({"answered": answerer.answered}, f"{answerer.answered} questions answered")

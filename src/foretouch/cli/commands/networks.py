"""Commands about networks that sessions can be run over: what there is, and what one is like."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from foretouch.cli.options import Answer, command, require_writable, say
from foretouch.cli.progress import pulsing
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

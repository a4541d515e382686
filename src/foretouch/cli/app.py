"""All commands, gathered."""

from __future__ import annotations

from typing import Annotated

import typer

from foretouch import __version__
from foretouch.cli import (
    bench,
    bridge,
    calibrate,
    comparison,
    data,
    doctor,
    keys,
    offline,
    paper,
    plugins,
    recordings,
    release,
    replay,
    sessions,
    sides,
    sweep,
    watchers,
)
from foretouch.cli.exit_codes import epilog
from foretouch.cli.help import PanelledCommand

__all__ = ["app"]

app = typer.Typer(
    name="foretouch",
    help="Model-mediated teleoperation: feel what the remote robot touches before the network can tell you.",
    epilog=epilog(),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"foretouch {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and end.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    pass


for module in (sessions, sides, release, watchers, offline, replay, comparison, sweep, paper, bench, doctor):
    for command in module.COMMANDS:
        app.command(cls=PanelledCommand)(command)
app.add_typer(bridge.bridge, name="bridge")
app.add_typer(calibrate.calibrate, name="calibrate")
app.add_typer(data.datasets, name="datasets")
app.add_typer(data.materials, name="materials")
app.add_typer(keys.keys, name="keys")
app.add_typer(plugins.plugins, name="plugins")
app.add_typer(recordings.recordings, name="recordings")

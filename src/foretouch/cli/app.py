"""The command `foretouch`: all commands gathered, their help under headings, and the meaning of exit codes."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from foretouch import __version__
from foretouch.cli.commands import (
    calibrate,
    exports,
    keys,
    machine,
    networks,
    offline,
    plugins,
    recordings,
    sessions,
    sides,
    studies,
    watchers,
)

EXIT_CODES: dict[int, tuple[str, str]] = {
    0: ("done", "Done. `predict` on a recording that never touches is done too: null metrics and status `no_contact`"),
    1: (
        "done, and the answer is no",
        "Done, and the answer is no: `doctor` found something bad, `stop` stopped nothing, a benchmark became slower, "
        "a session of a sweep has objections, no comparison succeeded. Or a process of a session failed",
    ),
    2: (
        "bad input, or something is missing",
        "Bad input, or something is missing: one line that says what, where, which rule and what to do; no traceback",
    ),
    3: (
        "the recording is not all there",
        "The session went on to its end, but its recording is not all there, or not where it was asked for",
    ),
    130: (
        "interrupted by Ctrl-C",
        "Interrupted by Ctrl-C, with nothing left running. A session in real time ends so with code 0",
    ),
}
"""By code, in a few words for the help, and in a sentence for the documentation."""


def epilog() -> str:
    """One line on all of them, for the end of the help."""
    return "Exit codes: " + "; ".join(f"{code} {short}" for code, (short, _) in EXIT_CODES.items()) + "."


class PanelledCommand(TyperCommand):
    """A command whose help puts options under the heading that each names as its `rich_help_panel`, in plain text."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write all options, those without a heading first."""
        panels: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else "Options"
                panels.setdefault(getattr(parameter, "rich_help_panel", None) or kind, []).append(record)
        for panel, records in panels.items():
            with formatter.section(panel):
                formatter.write_dl(records)


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


for command in (
    *(sessions.teleop, sessions.simulate),
    *(sides.leader, sides.follower, sides.gate, sides.stop, keys.release),
    *(watchers.camera, watchers.record, watchers.console),
    *(offline.identify, offline.predict, offline.report, sessions.replay),
    *(studies.compare, studies.sweep, studies.reproduce),
    *(machine.bench, machine.doctor, machine.warm_up),
):
    app.command(cls=PanelledCommand)(command)
for name, group in {
    "arms": plugins.arms,
    "bridge": watchers.bridge,
    "calibrate": calibrate.calibrate,
    "datasets": recordings.datasets,
    "export": exports.export,
    "materials": recordings.materials,
    "keys": keys.keys,
    "map": exports.maps,
    "network": networks.network,
    "plugins": plugins.plugins,
    "recordings": recordings.recordings,
}.items():
    app.add_typer(group, name=name)

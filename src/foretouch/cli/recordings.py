"""Commands about recordings of sessions."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Json, print_json, require_recording, say

if TYPE_CHECKING:
    from foretouch.messages import SessionLog

__all__ = ["recordings", "say_if_cut", "say_what_is_left_out"]

recordings = typer.Typer(help="Recordings of sessions: making whole what was cut.", no_args_is_help=True)


@recordings.callback()
def _group() -> None:
    """A group of commands, even while it has only one."""


@recordings.command("repair")
def repair(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="MCAP of a session.")],
    output: Annotated[
        Path | None, typer.Option("--output", help="Where the whole recording goes; without it, in FILE's place.")
    ] = None,
    json_output: Json = False,
) -> None:
    """Make a recording whole whose recorder was killed, or whose disk was full, and say what it holds.

    Every block that can be read stays as it is, byte by byte; the index is written anew.

    Example: foretouch recordings repair session.mcap
    """
    from foretouch.recordings import repair_session

    if output is not None:
        require_recording(output)
    found = repair_session(path, output)
    if json_output:
        print_json({**asdict(found), "path": str(found.path)})
        return
    if found.was_whole:
        typer.echo(f"{path}: is whole")
    else:
        left_out = f"{found.damaged_blocks} damaged blocks left out" if found.damaged_blocks else "no block was damaged"
        typer.echo(f"{path}: {found.bytes_cut} bytes cut behind the last whole block; {left_out}")
    held = ", ".join(f"{count} {topic}" for topic, count in found.messages.items())
    typer.echo(f"{found.path}: holds {found.duration:.3f} s in {found.bytes_kept} bytes: {held}")


def say_what_is_left_out(path: Path, log: SessionLog | None = None) -> None:
    """One line on each thing that is left out of a session's recording by those who learn from it; else nothing."""
    from foretouch.recordings import follower_samples, read_follower_samples
    from foretouch.report import left_out

    if path.suffix.lower() != ".mcap":
        return
    say_if_cut(path)
    for sentence in left_out(read_follower_samples(path) if log is None else follower_samples(log)):
        say(f"{path}: {sentence}")


def say_if_cut(path: Path, log: SessionLog | None = None) -> None:
    """One line on a session's recording that was read and ends before its session did: what can be done about it."""
    from foretouch.recordings import is_whole

    if path.suffix.lower() != ".mcap":
        return
    if not is_whole(path):
        mend = f"`foretouch recordings repair {path}` makes it whole"
        say(f"{path}: was not ended by its recorder; read as far as it goes; {mend}")
    elif log is not None and log.counts.get("truncated"):
        say(f"{path}: ends before its session did")

"""The command that lets a stopped robot follow again, at the robot's own machine and nowhere else."""

from __future__ import annotations

import os
import signal
import time
from typing import Annotated

import typer

from foretouch.cli.options import Json, print_json, say, show
from foretouch.errors import InputError, one_line

__all__ = ["RELEASE", "release"]

PATIENCE, LOOK = 5.0, 0.1
"""For so long [s] it is looked whether the robot follows again, and each time after so long."""

SAID = 1.0
"""A follower that was stopped has said so after so long [s]."""


def release(
    process: Annotated[
        int | None,
        typer.Argument(help="Number of the follower's process, where there are several.", show_default=False),
    ] = None,
    json_output: Json = False,
) -> None:
    """Let a robot of this machine that was stopped follow commands again; asked twice, at the robot itself.

    A robot whose sensors were not to be trusted, too, once that is mended. Only at rest: slower than 10 mm/s, with less
    than 1 N. Exit code 1 where it was not released.

    Example: foretouch release
    """
    from foretouch.session.waiting import followers

    chosen, why = _the_one(process)
    say(f"follower {chosen}: {one_line(why)}")
    try:
        near = typer.confirm("Is the reason for the stop mended, and everybody out of the robot's reach?", err=True)
        sure = near and typer.prompt('Type "release" to let it follow commands again', err=True).strip() == "release"
    except typer.Abort:  # the end of what is typed, or Ctrl-C
        say("\nforetouch: not released: nobody answered")
        raise typer.Exit(1) from None
    if not sure:
        say("foretouch: not released")
        raise typer.Exit(1)
    os.kill(chosen, signal.SIGUSR2)
    end, now = time.monotonic() + PATIENCE, why
    while _waits(now) and time.monotonic() < end:
        time.sleep(LOOK)
        now = followers().get(chosen, "")
    if json_output:
        print_json({"released": not _waits(now), "follower": chosen})
    if not _waits(now):
        if not json_output:
            show("the robot follows again, slowly at first")
        return
    say(f"foretouch: NOT released (after {PATIENCE:g} s): {one_line(now)}")
    raise typer.Exit(1)


RELEASE = (release,)


def _waits(sentence: str) -> bool:
    """Whether a follower that says this waits to be released."""
    return "foretouch release" in sentence


def _the_one(process: int | None) -> tuple[int, str]:
    """The number of the process that is meant, and what it says."""
    from foretouch.session.waiting import followers

    end = time.monotonic() + SAID
    while True:
        stopped = {number: sentence for number, sentence in followers().items() if _waits(sentence)}
        meant = [number for number in stopped if process in (None, number)]
        if len(meant) == 1:
            return meant[0], stopped[meant[0]]
        if time.monotonic() > end:
            break
        time.sleep(LOOK)
    raise InputError(_none_or_several(process, sorted(stopped)))


def _none_or_several(process: int | None, stopped: list[int]) -> str:
    """Why nothing is released: no follower waits, a different one waits, or several wait and none of them was named."""
    if not stopped:
        return "no follower of yours on this machine waits to be released"
    numbers = ", ".join(map(str, stopped))
    if process is None:
        return f"followers {numbers} of yours wait to be released: say which, such as `foretouch release {stopped[0]}`"
    return f"process {process} is no follower of yours that waits to be released; these are: {numbers}"

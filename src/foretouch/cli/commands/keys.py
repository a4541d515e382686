"""Commands on permissions: the keys that two machines show each other, and the release of a stopped robot.

A robot is released at its own machine and nowhere else.
"""

from __future__ import annotations

import itertools
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Answer, KeysFolder, command, say
from foretouch.errors import InputError, one_line

if TYPE_CHECKING:
    from datetime import datetime

    from foretouch.link import Identity, KeyFolder


keys = typer.Typer(help="Keys for sessions between machines: a private authority.", no_args_is_help=True)

Days = Annotated[float, typer.Option(help="How long a certificate lasts; never longer than the authority.")]


@keys.command("init")
@command()
def init_keys(folder: KeysFolder = None) -> Answer:
    """Make a private authority, on one machine that you trust.

    Example: foretouch keys init
    """
    opened, now = _opened(folder)
    authority = opened.init(now)
    if opened.tightened:
        say(f"{opened.path}: others could look into it; it has mode 700 now")
    say("Next: foretouch keys issue leader, foretouch keys issue follower. authority.key stays on this machine.")
    return _made({opened.path / "authority.key": authority})


@keys.command("issue")
@command()
def issue_keys(
    role: Annotated[str, typer.Argument(help="leader, follower or watcher (recorder and console).")],
    name: Annotated[str, typer.Argument(help="Tells several of a role apart: a-z, 0-9 and -.")] = "",
    folder: KeysFolder = None,
    days: Days = 365.0,
) -> Answer:
    """Make the key and the certificate of one process.

    Example: foretouch keys issue follower
    """
    opened, now = _opened(folder)
    identity = opened.issue(role, name, now, days)
    path = opened.path / f"{identity.common_name}.pem"
    say(f"Copy to the machine of the {role}: authority.crt, allowed.txt, {path.name}")
    return _made({path: identity})


@keys.command("rotate")
@command()
def rotate_keys(
    common_name: Annotated[str | None, typer.Argument(help="ROLE or ROLE.NAME; without it, all that are here.")] = None,
    authority: Annotated[
        bool, typer.Option("--authority", help="A new authority first: all old keys are void.")
    ] = False,
    folder: KeysFolder = None,
    days: Days = 365.0,
) -> Answer:
    """Make new keys and certificates in place of those here; if anything fails, all stay as they were.

    Example: foretouch keys rotate
    """
    opened, now = _opened(folder)
    made = opened.rotate(common_name, now, days, authority=authority)
    if authority:
        say("Copy authority.crt and the new keys to every machine: the old ones are let in nowhere that has it.")
    elif not made:
        say(f"no certificate in {opened.path}: foretouch keys issue makes one")
    return _made({opened.path / f"{identity.common_name}.pem": identity for identity in made})


@keys.command("show")
@command()
def show_keys(folder: KeysFolder = None) -> Answer:
    """The keys here, until when they last, and who is let in.

    Example: foretouch keys show
    """
    from foretouch.link import WARNING_DAYS

    opened, now = _opened(folder)
    authority, here, allowed = opened.read()
    of_processes = {opened.path / f"{name}.pem": identity for name, identity in here.items()}
    shown = {opened.path / "authority.crt": authority, **of_processes}
    for path, identity in shown.items():
        if not identity.issued_by(authority):
            say(f"{path} is from another authority: it is let in nowhere")
        if identity.days_left(now) <= WARNING_DAYS:
            say(f"{path} {'ends soon' if identity.days_left(now) > 0 else 'has expired'}: foretouch keys rotate")
    certificates = {
        path.name: _row(identity)
        | {"days_left": identity.days_left(now), "of_this_authority": identity.issued_by(authority)}
        for path, identity in shown.items()
    }
    content = {"folder": str(opened.path), "allowed": list(allowed), "certificates": certificates}
    return Answer(content, [*itertools.starmap(_line, shown.items()), f"let in: {', '.join(allowed)}"])


def _opened(folder: Path | None) -> tuple[KeyFolder, datetime]:
    from foretouch.link import KeyFolder
    from foretouch.link.certificates import utc_now

    return KeyFolder(folder), utc_now()


def _made(made: dict[Path, Identity]) -> Answer:
    certificates = {path.name: _row(identity) | {"path": str(path)} for path, identity in made.items()}
    return Answer({"certificates": certificates}, itertools.starmap(_line, made.items()))


def _row(identity: Identity) -> dict[str, object]:
    expires = identity.expires.isoformat()
    return {"common_name": identity.common_name, "expires": expires, "sha256": identity.fingerprint}


def _line(path: Path, identity: Identity) -> str:
    return f"{path}  until {identity.expires:%Y-%m-%d}  SHA-256 {identity.fingerprint[:16]}"


PATIENCE, LOOK = 5.0, 0.1
"""Longest time for which it is looked whether the robot follows again, and the time between two looks [s]."""

WORD = "release"  # Word that has to be typed to release a robot
SAID = 1.0  # Time after which a follower that was stopped has reported it [s]


@command()
def release(
    process: Annotated[
        int | None,
        typer.Argument(help="Number of the follower's process, where there are several.", show_default=False),
    ] = None,
) -> Answer:
    """Let a robot of this machine that was stopped follow commands again; asked twice, at the robot itself.

    A robot whose sensors were not to be trusted, too, once that is mended. Only at rest: slower than 10 mm/s, with less
    than 1 N. Exit code 1 where it was not released.

    Example: foretouch release
    """
    from foretouch.link import followers

    chosen, why = _the_one(process)
    say(f"follower {chosen}: {one_line(why)}")
    try:
        _ask("Is the reason for the stop mended, and everybody out of the robot's reach? [y/N]", "y", "yes")
        _ask(f'Type "{WORD}" to let it follow commands again:', WORD)
    except (EOFError, KeyboardInterrupt):  # the end of what is typed, or Ctrl-C
        say("\nforetouch: not released: nobody answered")
        raise typer.Exit(1) from None
    os.kill(chosen, signal.SIGUSR2)
    end, now = time.monotonic() + PATIENCE, why
    while _waits(now) and time.monotonic() < end:
        time.sleep(LOOK)
        now = followers().get(chosen, "")
    released = not _waits(now)
    if not released:
        say(f"foretouch: NOT released (after {PATIENCE:g} s): {one_line(now)}")
    lines = "the robot follows again, slowly at first" if released else ()
    return Answer({"released": released, "follower": chosen}, lines, code=int(not released))


def _ask(question: str, *wanted: str) -> None:
    """Ask, and end the command where the answer is not wanted; an EOFError says that nothing is typed."""
    typer.echo(f"{question} ", nl=False, err=True)
    answer = sys.stdin.readline().strip()
    if not answer:
        raise EOFError
    if answer.lower() not in wanted:
        say(f'foretouch: not released: "{one_line(answer)}" was typed, and "{wanted[0]}" releases it')
        raise typer.Exit(1)


def _waits(sentence: str) -> bool:
    return "foretouch release" in sentence


def _the_one(process: int | None) -> tuple[int, str]:
    from foretouch.link import followers

    end = time.monotonic() + SAID
    while True:
        stopped = {number: sentence for number, sentence in followers().items() if _waits(sentence)}
        meant = [number for number in stopped if process in (None, number)]
        if len(meant) == 1:
            return meant[0], stopped[meant[0]]
        if time.monotonic() > end:
            break
        time.sleep(LOOK)
    numbers = ", ".join(map(str, sorted(stopped)))
    if not stopped:
        why = "no follower of yours on this machine waits to be released"
    elif process is None:
        which = f"say which, such as `foretouch release {min(stopped)}`"
        why = f"followers {numbers} of yours wait to be released: {which}"
    else:
        why = f"process {process} is no follower of yours that waits to be released; these are: {numbers}"
    raise InputError(why)

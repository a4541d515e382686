"""The command that makes the paper again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from foretouch.cli.options import make_folder, say, show
from foretouch.cli.progress import compile_first, progress_bar

__all__ = ["COMMANDS", "reproduce"]


def reproduce(
    out: Annotated[Path | None, typer.Option(help="Folder for the page, the figures and the data.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="One section; may be given more than once.")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the claims as a JSON array.")] = False,
) -> None:
    """Make the figures of the paper again and say which of its claims hold.

    Example: foretouch reproduce --out paper
    """
    import json

    from foretouch.reproduction import SECTIONS, write_report
    from foretouch.reproduction import reproduce as run

    names = only or list(SECTIONS)
    if out is not None:
        make_folder(out)

    def progress(name: str, seconds: float) -> None:
        done.append(name)
        bar.update(len(done), len(names))
        bar.say(f"{len(done):2} of {len(names)}  {name:<12} after {seconds:.0f} s")

    done: list[str] = []
    compile_first()
    with progress_bar("making the paper again") as bar:
        bar.update(0, len(names))
        bar.pulse()
        sections = run(names, progress=progress)
    if out is not None:
        say(f"report: {write_report(out, sections)}")
    claims = [claim for section in sections for claim in section.claims]
    if json_output:
        show(json.dumps([claim.as_row() for claim in claims], allow_nan=False))
        return
    for section in sections:
        show(f"{section.title}")
        for claim in section.claims:
            show(f"  {claim.verdict:<26} {claim.claim}: paper {claim.paper}; measured {claim.measured}")
            show(f"  {'':<26} ({claim.setting})")


COMMANDS = (reproduce,)

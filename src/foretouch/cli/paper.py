"""The command that makes the paper again."""

from __future__ import annotations

import shutil
import textwrap
from pathlib import Path
from typing import Annotated

import typer

from foretouch.cli.options import made_by, make_folder, say, show
from foretouch.cli.progress import compile_first, progress_bar
from foretouch.errors import plural

__all__ = ["PAPER", "reproduce"]


def reproduce(
    out: Annotated[Path | None, typer.Option(help="Folder for the page, the figures and the data.")] = None,
    only: Annotated[list[str] | None, typer.Option(help="One section; may be given more than once.")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the claims as a JSON array.")] = False,
) -> None:
    """Make the figures of the paper again and say which of its claims hold.

    What was measured, and under which setting, is on the page, in --json, and here where sections are named by --only.

    Example: foretouch reproduce --out paper
    """
    import json

    from foretouch.reproduction import PAPER, SECTIONS, counted, write_report
    from foretouch.reproduction import reproduce as run

    names = only or list(SECTIONS)
    if out is not None:
        make_folder(out)

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
    if json_output:
        show(json.dumps([claim.as_row() for claim in claims], allow_nan=False))
        return
    for section in sections:
        show(f"\n{section.title}")
        for claim in section.claims:
            show(_lines(WORDS[claim.verdict], claim.claim))
            if only:
                for name, text in (("paper", claim.paper), ("measured", claim.measured), ("setting", claim.setting)):
                    show(_lines("", f"{name}: {text}"))
    counts = counted(claims)
    show(
        f"\nOf {plural(len(claims), 'claim')}: {counts['holds']} hold as printed, "
        f"{counts['holds under stated choice']} under a stated choice, {counts['does not hold']} not."
    )


PAPER = (reproduce,)

WORDS = {"holds": "holds", "holds under stated choice": "by choice", "does not hold": "does not"}
"""Verdicts in a narrow column."""


def _lines(first: str, text: str) -> str:
    """A row of two columns that is no wider than the terminal, nor than a page."""
    width = min(shutil.get_terminal_size((100, 24)).columns, 120)
    return textwrap.fill(text, max(width, 40), initial_indent=f"  {first:<11}", subsequent_indent=" " * 13)

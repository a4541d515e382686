"""All sections at once, on all cores, into one page with its data beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from html import escape
from pathlib import Path

from foretouch.comparison.parallel import run_all
from foretouch.errors import InputError
from foretouch.recordings import atomic_path, write_columns
from foretouch.report import embedded, table, write_html
from foretouch.reproduction.registry import SECTIONS, make_section
from foretouch.reproduction.section import Section

__all__ = ["reproduce", "write_report"]


def reproduce(names: Sequence[str], *, progress: Callable[[str, float], None] | None = None) -> list[Section]:
    """Make sections, side by side on the cores of this machine.

    Args:
        names: Of the sections.
        progress: Called with the name of each section that is done and the time since the start [s].

    Returns:
        The sections in the order of the paper.

    Raises:
        UnknownNameError: No such section.
    """
    started = time.perf_counter()
    made: dict[str, Section] = {}
    for section in _made(names):
        made[section.name] = section
        if progress is not None:
            progress(section.name, time.perf_counter() - started)
    return [made[name] for name in SECTIONS if name in made]


def _made(names: Sequence[str]) -> Iterator[Section]:
    """The sections as they are done."""

    def lost(name: str, reason: str) -> Section:
        raise RuntimeError(f"section {name}: {reason}")

    yield from (section for _, section in run_all(make_section, names, lost=lost))


def write_report(directory: Path, sections: Sequence[Section]) -> Path:
    """Write the page, and each section's figure as SVG and PNG and its data as Parquet beside it.

    Args:
        directory: Made if it is not there.
        sections: To write.

    Returns:
        Path of the page.

    Raises:
        InputError: Something cannot be written there.
        MissingExtraError: A package of the extras ``report`` or ``recordings`` is not installed.
    """
    claims = [claim for section in sections for claim in section.claims]
    body = ["<h1>The paper, reproduced</h1>"]
    if claims:
        head = ("claim", "the paper", "measured", "verdict", "setting")
        rows = [(c.claim, c.paper, c.measured, c.verdict, c.setting) for c in claims]
        body += ["<h2>Claims</h2>", table(head, rows)]
    for section in sections:
        body += [f"<h2>{escape(section.title)}</h2>", f"<p>{escape(section.text)}</p>"]
        if section.figure is not None:
            body.append(embedded(section.figure, section.title))
    page = write_html(directory, "The paper, reproduced", body)
    try:
        for section in sections:
            _write_files(directory, section)
    except OSError as error:
        raise InputError(f"{directory}: the data cannot be written there: {error.strerror}") from None
    return page


def _write_files(directory: Path, section: Section) -> None:
    if section.figure is not None:
        for suffix in ("svg", "png"):
            with atomic_path(directory / f"{section.name}.{suffix}") as part:
                section.figure.savefig(
                    part, format=suffix, dpi=150, metadata={"Date": None} if suffix == "svg" else None
                )
    for name, columns in section.data.items():
        write_columns(directory / f"{section.name}-{name}.parquet", dict(columns))

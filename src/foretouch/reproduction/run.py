"""All sections at once, on all cores, into one page with its data beside it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from foretouch.comparison.parallel import run_all
from foretouch.errors import InputError
from foretouch.recordings import atomic_path, write_columns
from foretouch.reproduction.page import write_paper_page
from foretouch.reproduction.registry import SECTIONS, make_section
from foretouch.reproduction.section import Section

__all__ = ["reproduce", "write_report"]

SLOWEST = "fig11"
"""Half of all the work: begun first, while the other cores make the rest, so that something is done all the time."""


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

    ordered = sorted(names, key=lambda name: name != SLOWEST)
    yield from (section for _, section in run_all(make_section, ordered, lost=lost))


def write_report(
    directory: Path,
    sections: Sequence[Section],
    made: Mapping[str, Any] | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write the page, and each section's figure as SVG and PNG and its data as Parquet beside it.

    Args:
        directory: Made if it is not there.
        sections: To write.
        made: What made it, for the end of the page, as `foretouch.report.write_html` takes it.
        progress: Called with the name of each section before it is written.

    Returns:
        Path of the page.

    Raises:
        InputError: Something cannot be written there.
        MissingExtraError: A package of the extras ``report`` or ``recordings`` is not installed.
    """
    page = write_paper_page(directory, sections, made)
    try:
        for section in sections:
            if progress is not None:
                progress(section.name)
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

"""Every section of the reproduction, in the order of the paper."""

from __future__ import annotations

import importlib
from typing import Any

from foretouch.errors import UnknownNameError
from foretouch.reproduction.section import Section

__all__ = ["SECTIONS", "make_section"]

SECTIONS: dict[str, str] = {
    "fig2": "fig2",
    "fig3": "fig3",
    "shock": "shock",
    "fig4": "fig4",
    "fig5": "fig5",
    "table1": "table1",
    "fig6": "fig6",
    "fig7a": "fig7a",
    "fig7b": "fig7b",
    "fig7c": "fig7c",
    "fig8": "fig8",
    "choices": "search",
    "arguments": "arguments",
    "fast": "fast",
    "fig10": "fig10",
    "fig11": "fig11",
}
"""Name of each section, and the module of this room whose ``make()`` makes it."""


def make_section(name: str) -> Section:
    """Make one section; it may take a minute.

    Raises:
        UnknownNameError: No such section.
    """
    if name not in SECTIONS:
        raise UnknownNameError("section", name, SECTIONS)
    module: Any = importlib.import_module(f"foretouch.reproduction.{SECTIONS[name]}")
    section: Section = module.make()
    return section

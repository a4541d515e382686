"""The rows as a table for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.table import Table

from foretouch.bench.rows import Row

__all__ = ["HEADS", "cells", "render_table"]

HEADS = ("What", "Median", "Quartiles", "Rounds", "Unit", "Asked", "Reached")


def cells(row: Row) -> tuple[str, ...]:
    """What stands in a row, under `HEADS`."""
    quartiles = "" if row.quartiles is None else f"{_said(row.quartiles[0])} to {_said(row.quartiles[1])}"
    asked = "" if row.reach is None else f"{'≥' if row.at_least else '≤'} {_said(row.reach)}"
    reached = {True: "yes", False: "no", None: ""}[row.reached]
    return row.what, _said(row.figure), quartiles, str(row.rounds), row.unit, asked, reached


def render_table(done: Mapping[str, Sequence[Row]]) -> Table:
    """One table of some benchmarks, ratios first in each, as wide as there is room.

    Args:
        done: Rows by benchmark.
    """
    table = Table(*HEADS, header_style="bold", expand=True)
    table.columns[0].ratio = 1
    for column in (1, 2, 3):
        table.columns[column].justify = "right"
    for name, rows in done.items():
        table.add_section()
        table.add_row(f"[bold]{name}[/bold]")
        for row in sorted(rows, key=lambda one: one.unit != "x"):
            style = {True: "green", False: "red", None: ""}[row.reached]
            *most, last = cells(row)
            table.add_row(*most, f"[{style}]{last}[/]" if style else last)
    return table


def _said(value: float) -> str:
    """Three figures that count, without an exponent where it can be."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"

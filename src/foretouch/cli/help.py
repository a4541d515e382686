"""Help of commands with many options, under headings."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

__all__ = ["PanelledCommand"]


class PanelledCommand(TyperCommand):
    """A command whose help puts options under the heading that each names as its `rich_help_panel`, in plain text."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write all options, those without a heading of their own first."""
        panels: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                kind = "Arguments" if parameter.param_type_name == "argument" else "Options"
                panels.setdefault(getattr(parameter, "rich_help_panel", None) or kind, []).append(record)
        for panel, records in panels.items():
            with formatter.section(panel):
                formatter.write_dl(records)

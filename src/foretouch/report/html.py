"""Pages of HTML that need nothing else: one style, figures inside, no request to anywhere."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

from foretouch.errors import InputError
from foretouch.recordings import atomic_path

__all__ = ["embedded", "named_values", "table", "write_html"]

STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --quiet: #5c5c5c; --paper: #fafafa; --card: #fff; --line: #ddd;
  --bad: #a33c00; }
@media (prefers-color-scheme: dark) { :root { --ink: #ececec; --quiet: #aaa; --paper: #161616; --card: #222;
  --line: #444; --bad: #ffa36b; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  padding: 1.5rem; max-width: 64rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p { margin: .3rem 0; } .quiet { color: var(--quiet); } .bad, .good { font-weight: 600; } .bad { color: var(--bad); }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(8.5rem, 1fr)); gap: .8rem; margin: 1rem 0; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.3rem; white-space: nowrap; }
.tile span { color: var(--quiet); font-size: .85rem; }
figure { margin: 1rem 0; background: #fff; border: 1px solid var(--line); border-radius: .5rem; padding: .5rem; }
figure img { width: 100%; height: auto; display: block; } figcaption { color: #444; font-size: .85rem; padding: .3rem; }
table { border-collapse: collapse; }
th, td { text-align: left; vertical-align: top; padding: .25rem 1.5rem .25rem 0; }
td { border-bottom: 1px solid var(--line); }
pre { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .8rem;
  font-size: .8rem; }
"""


def embedded(figure: Any, caption: str) -> str:
    """A figure as an image inside the page; as an image of its own, its inner names clash with no other's."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    text = escape(caption, quote=True)
    return f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}"><figcaption>{text}</figcaption></figure>'


def named_values(values: Mapping[str, Any]) -> str:
    """A table of names and values."""
    return table((), [(name, value) for name, value in values.items()])


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table; numbers with six digits, None as a dash."""

    def cell(value: Any) -> str:
        return "-" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)

    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    lines = ("".join(f"<td>{escape(cell(value))}</td>" for value in row) for row in rows)
    return f"<table>{f'<tr>{titles}</tr>' if head else ''}{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def write_html(directory: str | PathLike[str], title: str, body: list[str]) -> Path:
    """Write ``index.html`` in a folder, which is made if it is not there.

    Args:
        directory: The folder.
        title: Of the page.
        body: HTML of the page's parts.

    Raises:
        InputError: The folder cannot be made or the page cannot be written.
    """
    folder = Path(directory)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the report cannot be written there: {error.strerror}") from None
    page = folder / "index.html"
    text = "\n".join(
        (
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>",
            *body,
            "</body></html>\n",
        )
    )
    with atomic_path(page) as part:
        part.write_text(text, encoding="utf-8")
    return page

"""Pages of HTML that need nothing else: one style, figures inside, no request to anywhere."""

from __future__ import annotations

import base64
import importlib.metadata
import io
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any

from foretouch.errors import InputError
from foretouch.recordings import atomic_path

STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --quiet: #5c5c5c; --paper: #fafafa; --card: #fff; --line: #ddd;
  --bad: #a33c00; }
@media (prefers-color-scheme: dark) { :root { --ink: #ececec; --quiet: #aaa; --paper: #161616; --card: #222;
  --line: #444; --bad: #ffa36b; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  padding: 1.5rem; max-width: 64rem; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; }
p { margin: .3rem 0; } .quiet { color: var(--quiet); } .bad, .good { font-weight: 600; } .bad { color: var(--bad); }
.tiles { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1rem 0; }
.tile { flex: 1 1 max(7.5rem, calc(100% / var(--columns) - .8rem)); box-sizing: border-box;
  background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.3rem; white-space: nowrap; }
.tile span { color: var(--quiet); font-size: .85rem; }
figure { margin: 1rem 0; background: #fff; border: 1px solid var(--line); border-radius: .5rem; padding: .5rem; }
figure img { width: 100%; height: auto; display: block; } figcaption { color: #444; font-size: .85rem; padding: .3rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; max-width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .25rem 1.5rem .25rem 0; }
td { border-bottom: 1px solid var(--line); }
.wide { overflow-x: auto; } .made { margin-top: 3rem; border-top: 1px solid var(--line); font-size: .85rem; }
.made td { overflow-wrap: anywhere; } .made td:first-child { white-space: nowrap; }
code { font-family: ui-monospace, monospace; font-size: .9em; }
pre { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: .5rem; padding: .8rem;
  font-size: .8rem; }
"""


MOST_COLUMNS = 6
"""Largest number of cards beside each other on a wide page."""


MOST_BYTES = 400_000
"""Most bytes that a figure may take as lines; one with more has its curves as pixels."""

MOST_WORDS = 100
"""Words among the curves are pixels too where there are more than this: the numbers of a matrix."""

PIXELS = 150
"""Pixels per inch of such curves: half as many again as the widest page has."""


def embedded(figure: Any, caption: str) -> str:
    """A figure as an image inside the page; as an image of its own, its inner names clash with no other's.

    However much there is to draw, the image stays small: see `MOST_BYTES`. Axes, titles and legends are lines anyway.
    """
    drawn = _svg(figure)
    if len(drawn) > MOST_BYTES:
        for axes in figure.axes:
            words = axes.texts if len(axes.texts) > MOST_WORDS else ()
            for artist in (*axes.lines, *axes.collections, *axes.patches, *words):
                artist.set_rasterized(True)
        drawn = _svg(figure)
    data = base64.b64encode(drawn).decode("ascii")
    text = escape(caption, quote=True)
    return f'<figure><img alt="{text}" src="data:image/svg+xml;base64,{data}"><figcaption>{text}</figcaption></figure>'


def _svg(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", dpi=PIXELS, metadata={"Date": None})
    return buffer.getvalue()


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


def tiles(figures: Sequence[tuple[str, str]]) -> str:
    """Cards side by side, in rows of equal length where that can be: none is left alone in a row of its own.

    Args:
        figures: Of each its value with unit, and what it is.
    """
    rows = -(-len(figures) // MOST_COLUMNS) or 1
    cards = (f'<div class="tile"><b>{escape(value)}</b><span>{escape(what)}</span></div>' for value, what in figures)
    return f'<div class="tiles" style="--columns: {-(-len(figures) // rows)}">{"".join(cards)}</div>'


def _origin(made: Mapping[str, Any]) -> str:
    """What made the page, and how to make it again."""
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    command = f"<code>{escape(made['command'])}</code>" if made.get("command") else "none: written from Python"
    version = importlib.metadata.version("foretouch")
    rows = [
        ("made by", escape(f"foretouch {version}, Python {platform.python_version()}, {platform.machine()}")),
        ("made on", now),
        ("command, to repeat it", command),
        *((name.replace("_", " "), escape(str(what))) for name, what in made.items() if name != "command"),
    ]
    lines = "".join(f"<tr><td>{name}</td><td>{what}</td></tr>" for name, what in rows)
    return f'<footer class="made"><h2>How this page was made</h2><table>{lines}</table></footer>'


def write_html(
    directory: str | PathLike[str], title: str, body: list[str], made: Mapping[str, Any] | None = None
) -> Path:
    """Write ``index.html`` in a folder, which is made if it is not there; at its end it says what made it.

    Args:
        directory: The folder.
        title: Of the page.
        body: HTML of the page's parts.
        made: What made it, by name: the ``command`` that repeats it, the recording, the law, the settings; version and
            date are said in any case.

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
            _origin(made or {}),
            "</body></html>\n",
        )
    )
    with atomic_path(page) as part:
        part.write_text(text, encoding="utf-8")
    return page

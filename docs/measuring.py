"""How the scripts that measure run commands, and write what they printed."""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from statistics import median

__all__ = ["Row", "console", "figure", "foretouch", "middle", "table", "two_at_a_time"]

SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")

Row = list[str]


def foretouch(arguments: str, folder: str | None = None) -> str:
    """What a command prints, in a folder of its own or in this one."""
    command = [sys.executable, "-m", "foretouch", *shlex.split(arguments)]
    with tempfile.TemporaryDirectory() as empty:
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder or empty)
    if done.returncode:
        raise SystemExit(f"foretouch {arguments}: {done.stderr.strip()}")
    return done.stdout.strip()


def two_at_a_time(commands: Iterable[str]) -> Iterator[str]:
    """What each command prints, in order; each is a process of its own."""
    with ThreadPoolExecutor(2) as pool:
        yield from pool.map(foretouch, commands)


def console(arguments: str, folder: str | None = None) -> str:
    """A command and what it prints, as a terminal shows them."""
    return f"```console\n$ foretouch {arguments}\n{foretouch(arguments, folder)}\n```\n"


def middle(values: Iterable[float | None]) -> float | None:
    """The median; None, which is worse than every number, where half of them are None."""
    known = [float("inf") if value is None else value for value in values]
    found = median(known)
    return found if found < float("inf") else None


def figure(value: float | None) -> str:
    """Three figures; a dash where there is nothing to measure."""
    if value is None:
        return "–"
    if abs(value) >= 1e5:
        mantissa, exponent = f"{value:.1e}".split("e")
        return f"{mantissa}·10" + str(int(exponent)).translate(SUPERSCRIPTS)
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def table(heads: tuple[str, ...], rows: list[Row]) -> str:
    """A Markdown table, numbers to the right."""
    numeric = [all(row[i][0].isdigit() or row[i] == "–" for row in rows) for i in range(len(heads))]
    lines = [list(heads), ["--:" if right else "---" for right in numeric], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"

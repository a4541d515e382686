"""The rooms of the package, before and after they were put in order: `docs/images/rooms.png`.

Usage: `.venv/bin/python docs/draw_rooms.py`, in a clone with its history; it takes a second.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import tarfile
import tomllib
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
ROOT = Path(__file__).resolve().parents[1]
BEFORE = "d106c7a"
"""Version 0.1 as it was first reviewed."""
SHADES = ("#4C78A8", "#9DB8D6")
"""Neighbouring folders of a room."""
GAP = 700
"""Between two rooms [lines of code]."""

Files = dict[str, dict[str, list[int]]]
"""Length of each file [lines], by room and folder."""


def earlier() -> dict[str, str]:
    """Every file of `BEFORE` that matters here, by its path."""
    archive = subprocess.run(
        ["git", "archive", BEFORE, "src", "pyproject.toml"], cwd=ROOT, capture_output=True, check=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        members = [member for member in files if member.isfile() and member.name.endswith((".py", ".toml"))]
        return {member.name: files.extractfile(member).read().decode() for member in members}


def present() -> dict[str, str]:
    """The same of the code as it is."""
    paths = [ROOT / "pyproject.toml", *(ROOT / "src").rglob("*.py")]
    return {str(path.relative_to(ROOT)): path.read_text() for path in paths}


def layers(texts: dict[str, str]) -> list[list[str]]:
    """Rooms from the top layer down."""
    contracts = tomllib.loads(texts["pyproject.toml"])["tool"]["importlinter"]["contracts"]
    whole = next(one for one in contracts if one["type"] == "layers" and one["containers"] == ["foretouch"])
    return [layer.split(" | ") for layer in whole["layers"]]


def files(texts: dict[str, str]) -> Files:
    """Those of rooms; the package's own few files belong to none."""
    found: Files = {}
    for path, text in texts.items():
        parts = path.split("/")[2:]
        if len(parts) > 1:
            found.setdefault(parts[0], {}).setdefault("/".join(parts[1:-1]), []).append(len(text.splitlines()))
    return found


def draw(axes: mpl.axes.Axes, title: str, texts: dict[str, str]) -> None:
    """A layer a row, a room a box, a file a strip as wide as it is long."""
    rooms = files(texts)
    for row, names in enumerate(layers(texts)):
        left = 0
        for name in (name for name in names if name in rooms):
            folders = sorted(rooms[name].items())
            count = sum(len(lengths) for _, lengths in folders)
            start = left
            for index, (_, lengths) in enumerate(folders):
                for length in sorted(lengths, reverse=True):
                    axes.barh(-row, length, left=left, height=0.42, color=SHADES[index % 2], edgecolor="white", lw=0.35)
                    left += length
            axes.text(start, 0.27 - row, f"{name} {count}", fontsize=7.5, va="bottom")
            left = max(left, start + 165 * len(f"{name} {count}")) + GAP
    total = sum(len(lengths) for room in rooms.values() for lengths in room.values())
    lines = sum(sum(lengths) for room in rooms.values() for lengths in room.values())
    axes.set_title(f"{title}: {total} files, {lines:,} lines", loc="left")
    axes.set_ylim(0.75 - len(layers(texts)), 0.75)
    axes.axis("off")


def main() -> None:
    """Draw."""
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    import matplotlib.pyplot as plt

    figure, both = plt.subplots(2, 1, figsize=(10.0, 9.4), layout="constrained", sharex=True)
    draw(both[0], "Before", earlier())
    draw(both[1], "Now", present())
    key = "A strip is a file, as wide as it has lines; shades tell folders apart; imports go down. Number: files."
    figure.supxlabel(key, fontsize=8.5, x=0.01, ha="left")
    figure.savefig(ROOT / "docs" / "images" / "rooms.png", dpi=110)


if __name__ == "__main__":
    main()

"""Measure how fast everything is and write it where it stands: the blocks of `docs/speed.md`, and its plots.

Usage: `.venv/bin/python docs/measure_speed.py [NAME ...]`: a benchmark each, or `plots`; without names all, which takes
some quarter of an hour. Each block says when, at which commit and under which load it was measured.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numba
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from measured_blocks import chosen, fill

from foretouch.bench import BENCHMARKS, Row, run_benchmarks
from foretouch.bench.benchmarks import profile, steps, streams, updates
from foretouch.bench.timing import cells, interleave

DOCS = Path(__file__).parent
PAGE = DOCS / "speed.md"
BLUE, VERMILLION = "#0072B2", "#D55E00"  # Okabe and Ito's
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#56B4E9", "#D55E00", "#CC79A7", "#F0E442")
"""Of Okabe and Ito, for the parts of a step in turn; the second time hatched."""

STREAMS = (4, 16, 64, 256, 1024, 4096)
ROUNDS = 7


def main(names: list[str]) -> None:
    """Fill blocks and draw."""
    for name in names:
        if name == "plots":
            draw()
            continue
        when = circumstances()
        rows = run_benchmarks([name], say=print)[name]
        fill(PAGE, {name: block(name, rows, when), "machine": machine() + "\n"})
        print(name)


def block(name: str, rows: list[Row], when: str) -> str:
    """One benchmark's rows as a list on the page, ratios first, and when they were measured.

    The page shows rows of which something is asked, or ratios where nothing is; the command prints all.
    """
    if name == "profile":
        lines = parts_table(rows)
    else:
        ratios = [row for row in rows if row.unit == "x"]
        shown = [row for row in rows if row.reach is not None] or ratios
        lines = [line(row) for row in sorted(shown, key=lambda row: row.unit != "x")]
    return f"`foretouch bench --only {name}`, {when}:\n\n" + "\n".join(lines) + "\n"


def line(row: Row) -> str:
    """One item of the list: the median, bold where it misses what is asked, and what is asked."""
    what, median, _, _, unit, asked, _ = cells(row)
    if row.reached is None:
        return f"- {what}: {median} {unit}"
    if row.reached:
        return f"- {what}: {median} {unit} (asked: {asked})"
    return f"- {what}: **{median} {unit}** (asked: {asked}, missed)"


def parts_table(rows: list[Row]) -> list[str]:
    """Both steps and those of their parts that take a tenth of the step in either band; the figure has all parts."""
    said, times_of = {row.what: cells(row)[1] for row in rows}, {row.what: row.figure for row in rows}
    lines = ["| Part | 50 %: µs | 99 %: µs |", "| --- | --: | --: |"]
    for side, parts in profile.PARTS.items():
        whole = [said[profile.named(side, profile.STEP, percentile)] for percentile in profile.BANDS]
        lines.append(f"| **{side}: {profile.STEP}** | **{whole[0]}** | **{whole[1]}** |")
        for part in parts:
            names = [profile.named(side, part.name, percentile) for percentile in profile.BANDS]
            steps_of = [profile.named(side, profile.STEP, percentile) for percentile in profile.BANDS]
            if any(times_of[name] >= 0.1 * times_of[step] for name, step in zip(names, steps_of, strict=True)):
                lines.append(f"| {part.name} | {said[names[0]]} | {said[names[1]]} |")
    return lines


def machine() -> str:
    """What it was measured on."""
    versions = f"Python {platform.python_version()}, NumPy {np.__version__}, Numba {numba.__version__}"
    return f"Measured on {platform.machine()}, {os.cpu_count()} cores; {versions}."


def circumstances() -> str:
    """The date, the commit, and what else the machine did just before."""
    said = [f"{datetime.now(UTC):%Y-%m-%d}"]
    git = shutil.which("git")
    if git is not None:
        asked = [git, "-C", str(DOCS), "rev-parse", "--short", "HEAD"]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        said += [done.stdout.strip()] if done.returncode == 0 else []
    if hasattr(os, "getloadavg"):
        said.append(f"load {os.getloadavg()[0]:.1f}")
    return ", ".join(said)


def draw() -> None:
    """Plots, two a picture."""
    for name, panels in {"growth": (over_samples, over_streams), "size": (over_cells, over_triangles)}.items():
        figure, axes = plt.subplots(1, 2, figsize=(8.8, 3.4), layout="constrained")
        for panel, one in zip(panels, axes, strict=True):
            panel(one)
            one.grid(alpha=0.3)
            one.legend(frameon=False, loc="upper right" if panel is over_streams else "lower right")
            if panel is not over_streams:
                one.set_ylim(0.0, 1.1 * one.get_ylim()[1])
        figure.savefig(DOCS / "images" / f"speed-{name}.png", dpi=110)
        print(f"docs/images/speed-{name}.png")
    draw_profile()


def draw_profile() -> None:
    """Where the time of both steps goes: bars of parts, the median step and the 99th percentile."""
    found = profile.profile(steps.TapedSession(steps.DURATION), ROUNDS)
    figure, axes = plt.subplots(2, 1, figsize=(9.6, 5.6), layout="constrained")
    for one, (side, parts) in zip(axes, profile.PARTS.items(), strict=True):
        for place, percentile in enumerate(profile.BANDS):
            stacked(one, place, [found[side, percentile][part.name] for part in parts])
        wholes = [found[side, percentile][profile.STEP] for percentile in profile.BANDS]
        heads = ("median", "99th percentile")
        one.set_yticks(range(2), [f"{head}:\n{whole:.0f} µs" for head, whole in zip(heads, wholes, strict=True)])
        one.invert_yaxis()
        one.set(title=f"A {side}'s step", xlabel="share of the step [%], times in µs", xlim=(0.0, 100.0))
        patches = [Patch(label=part.name, **style(place, len(parts))) for place, part in enumerate(parts)]
        one.legend(handles=patches, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    figure.savefig(DOCS / "images" / "speed-profile.png", dpi=110)
    print("docs/images/speed-profile.png")


def stacked(axes: Axes, place: int, times: list[float]) -> None:
    """One bar of parts [us]; where there is room their time stands in them."""
    shares = 100.0 * np.maximum(times, 0.0) / np.sum(np.maximum(times, 0.0))
    for part, (left, share, time) in enumerate(zip(np.cumsum(shares) - shares, shares, times, strict=True)):
        axes.barh(place, share, left=left, edgecolor="white", **style(part, len(times)))
        if share > 4.0:
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0}
            axes.text(left + 0.5 * share, place, f"{time:.1f}", ha="center", va="center", fontsize=8, bbox=box)


def style(part: int, parts: int) -> dict[str, str]:
    """Colour and hatching of a part; the last is what is left."""
    if part == parts - 1:
        return {"facecolor": "#BBBBBB"}
    return {"facecolor": COLOURS[part % len(COLOURS)], "hatch": "" if part < len(COLOURS) else "///"}


def over_samples(axes: Axes) -> None:
    """Streams of FPRLS: cost of a sample, quickest of three."""
    streamed = streams.curve(streams.LARGEST)
    sizes = [one.size for one in streamed]
    axes.semilogx(sizes, [1e9 * one.seconds / one.size for one in streamed], "o-", color=BLUE, label="FPRLS")
    axes.set(title="One recording", xlabel="samples", ylabel="ns a sample")


def over_streams(axes: Axes) -> None:
    """Many recordings at once: cost of a sample."""
    measured = {number: interleave(streams.contestants(number), ROUNDS) for number in STREAMS}
    for name, label, colour, style in (("ours", "FPRLS", BLUE, "o-"), ("NumPy", "NumPy", VERMILLION, "^--")):
        costs = [1e9 * np.median(measured[number][name]) for number in STREAMS]
        axes.loglog(STREAMS, costs, style, color=colour, label=label)
    axes.set(title="Many recordings at once, one core", xlabel="recordings", ylabel="ns a sample")


def over_cells(axes: Axes) -> None:
    """The contact map: cost of a sample, median and quartiles."""
    size = updates.CELLS_SIZE
    cells_of = {updates.cells(deepest): updates.map_contestant(size, deepest) for deepest in updates.DEEPEST}
    times = interleave({str(count): one for count, one in cells_of.items()}, ROUNDS)
    _with_quartiles(axes, list(cells_of), lambda count: 1e9 * times[str(count)], "contact map, one recording")
    axes.set(title="Contact map", xlabel="cells of the coarse map that are visited", ylabel="ns a sample")


def over_triangles(axes: Axes) -> None:
    """The proxy on a mesh: cost of a tick, median and quartiles."""
    sides = {2 * side**2: updates.mesh_contestant(side) for side in updates.SIDES}
    times = interleave({str(count): one for count, one in sides.items()}, ROUNDS)
    _with_quartiles(axes, list(sides), lambda count: 1e6 * times[str(count)], "proxy, one call a tick")
    axes.set_xscale("log")
    axes.set(title="Surface of triangles", xlabel="triangles", ylabel="µs a tick")


def _with_quartiles(axes: Axes, at: list[int], of: Callable[[int], np.ndarray], label: str) -> None:
    lower, middle, upper = np.array([np.percentile(of(count), (25, 50, 75)) for count in at]).T
    axes.errorbar(at, middle, (middle - lower, upper - middle), fmt="o-", capsize=4, color=BLUE, label=label)


if __name__ == "__main__":
    main(chosen(sys.argv[1:], [*BENCHMARKS, "plots"]))

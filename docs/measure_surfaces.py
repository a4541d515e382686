"""Measure the proxy on surfaces and the material over them: the tables and images of `docs/surfaces.md`.

Usage: `.venv/bin/python docs/measure_surfaces.py [god-object] [palpation]`; both without arguments, in a minute.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from measured_blocks import chosen, fill
from numpy.typing import NDArray

from foretouch.identification import FrictionEstimator, Learner, ScaleFieldLearner
from foretouch.models import FIELD_DEPTH, stiffness_at_rest
from foretouch.rendering import HeightField, Plane, SurfaceProxy

mpl.use("Agg")
from matplotlib import pyplot as plt

Array = NDArray[np.float64]

PAGE = Path(__file__).parent / "surfaces.md"
IMAGES = Path(__file__).parent / "images"
TICK = 1e-3
BLUE, VERMILLION, GREEN, SKY, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#56b4e9", "#5c6a78", "#000000"

# --- the god object ---------------------------------------------------------------------------------------------------

CELLS = (10, 32, 100, 224)
"""Along a side of the height fields that are timed: two triangles each."""

TICKS = 20_000


def hills(cells: int) -> HeightField:
    """A field of 0.1 m with hills of 4 mm."""
    axis = np.linspace(-0.05, 0.05, cells + 1)
    return HeightField(
        0.004 * np.outer(np.sin(150.0 * axis), np.cos(120.0 * axis)), 0.1 / cells, (float(axis[0]), float(axis[0]))
    )


def timed(surface: Any) -> Array:
    """What each tick costs [us]: a hand that goes over the field at some 0.2 m/s, 10 mm deep and 10 mm above it."""
    t = np.arange(TICKS) * TICK
    path = np.stack([0.045 * np.sin(4.1 * t), 0.045 * np.sin(2.9 * t + 1.0), 0.01 * np.sin(7.3 * t)], axis=1).tolist()
    proxy, costs = SurfaceProxy(surface), []
    proxy.follow(path[0])  # compiles
    for place in path:
        start = time.perf_counter_ns()
        proxy.follow(place)
        costs.append(time.perf_counter_ns() - start)
    return np.array(costs) / 1000.0


def edge_of_a_plate() -> tuple[Array, Array, Array]:
    """A section: a probe presses on a plate with a groove, past the plate's middle and over its edge."""
    x = np.linspace(-0.03, 0.03, 61)
    heights = -0.006 * np.maximum(0.0, 1.0 - np.abs(x + 0.008) / 0.006)
    plate = HeightField(np.repeat(heights[:, None], 3, axis=1), 1e-3, (-0.03, -1e-3))
    corners = np.array([(-0.028, 0.004), (-0.024, -0.004), (-0.008, -0.011), (0.006, -0.005), (0.024, -0.005)])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    along = np.linspace(0.0, lengths[-1], 1200)
    places = np.stack([np.interp(along, lengths, corners[:, k]) for k in (0, 1)], axis=1)
    proxy = SurfaceProxy(plate)
    proxies = np.array([proxy.follow((px, 0.0, pz)).point for px, pz in places.tolist()])
    return np.stack([x, heights], axis=1), places, proxies[:, [0, 2]]


def god_object() -> str:
    """Time a tick for meshes of many sizes, and draw the proxy beside it."""
    surfaces = [("plane", 0, Plane())] + [(f"{2 * n * n:,} triangles", 2 * n * n, hills(n)) for n in CELLS]
    rows, sizes, middle, rare = [], [], [], []
    for name, size, surface in surfaces:
        costs = timed(surface)
        half, most = np.percentile(costs, (50, 99))
        rows.append(f"| {name} | {half:.1f} | {most:.1f} |")
        if size:
            sizes.append(size)
            middle.append(half)
            rare.append(most)
    figure, (section, cost) = plt.subplots(1, 2, figsize=(11.0, 4.2), width_ratios=(1.5, 1.0), layout="constrained")
    plate, places, proxies = edge_of_a_plate()
    section.fill_between(1e3 * plate[:, 0], 1e3 * plate[:, 1], -14.0, color="#f0d7be", label="material")
    section.plot(*(1e3 * places.T), color=BLUE, label="probe")
    section.plot(*(1e3 * proxies.T), color=VERMILLION, linewidth=2.5, label="proxy (god object)")
    for at in range(0, len(places), 60):
        section.plot(*(1e3 * np.stack([places[at], proxies[at]]).T), color=GREY, linewidth=0.8)
    section.set(xlabel="x [mm]", ylabel="z [mm]", title="The proxy stays outside and slides", aspect="equal")
    section.legend(loc="lower right", fontsize=8)
    cost.plot(sizes, middle, "o-", color=BLUE, label="median")
    cost.plot(sizes, rare, "s--", color=VERMILLION, label="99 %")
    cost.axhline(20.0, color=GREY, linestyle=":", label="what it may take")
    cost.set(xscale="log", ylim=(0.0, 22.0), xlabel="triangles", ylabel="a tick [µs]", title="Cost of a tick")
    cost.legend(fontsize=8)
    figure.savefig(IMAGES / "god-object.png", dpi=110)
    plt.close(figure)
    return "\n".join(["| Surface | Median [us] | 99 % [us] |", "| --- | --: | --: |", *rows]) + "\n"


# --- palpation --------------------------------------------------------------------------------------------------------

HALF_SIDE = 0.033
CENTRE, RADIUS, TIMES, EDGE = np.array([0.009, -0.004]), 0.012, 4.0, 7e-4
"""The inclusion: where [m], how large [m], how much stiffer, and over which length its edge is spread [m]."""

SOFT = np.array([300.0, 4e4, 200.0])
FRICTION, NOISE = 0.4, 0.02
"""Coefficient, and the standard deviation of each axis of the force sensor [N]."""


def height(x: Array | float, y: Array | float) -> Any:
    """A hill of 4 mm [m]."""
    return 0.004 * np.exp(-((x + 0.005) ** 2 + (y - 0.005) ** 2) / (2.0 * 0.02**2))


def stiffer(x: Array | float, y: Array | float) -> Any:
    """By how much the material is stiffer than around."""
    away = np.hypot(x - CENTRE[0], y - CENTRE[1]) - RADIUS
    return 1.0 + (TIMES - 1.0) / (1.0 + np.exp(away / EDGE))


def presses() -> Array:
    """Places [m] of 121 presses of 3 mm, 6 mm apart."""
    rows = []
    depth = np.concatenate([np.linspace(-1e-3, 3e-3, 160), np.linspace(3e-3, -1e-3, 160)])
    for x in np.arange(-5, 6) * 0.006 + 0.0023:
        for y in np.arange(-5, 6) * 0.006 + 0.0017:
            rows.append(np.stack([np.full(320, x), np.full(320, y), height(x, y) - depth], axis=1))
    return np.concatenate(rows)


def slides() -> Array:
    """Places [m] of lines 4 mm apart at 40 mm/s, pressed 1 to 3 mm deep in turns, 4 times a second."""
    rows, steps = [], int(2.0 * HALF_SIDE / 0.04 / TICK)
    for number, y in enumerate(np.arange(-8, 9) * 0.004):
        x = np.linspace(-HALF_SIDE, HALF_SIDE, steps)[:: 1 if number % 2 else -1]
        depth = 2e-3 + 1e-3 * np.sin(2.0 * np.pi * 4.0 * TICK * np.arange(steps))
        depth *= np.minimum(np.arange(steps), np.arange(steps)[::-1]) / 50.0 > 1.0
        rows.append(np.stack([x, np.full(steps, y), height(x, y) - depth], axis=1))
    return np.concatenate(rows)


class Palpated(NamedTuple):
    """What a palpation found."""

    learner: Learner
    friction: FrictionEstimator
    seconds: float
    cost: float


def palpate(path: Array) -> Palpated:
    """Feel the material along a path and learn: once a tick, and from forces of all three axes."""
    axis = np.arange(-40, 41) * 1e-3
    surface = HeightField(height(axis[:, None], axis[None, :]), 1e-3, (-0.04, -0.04))
    random, proxy = np.random.default_rng(3), SurfaceProxy(surface)
    places, friction, costs = ScaleFieldLearner(), FrictionEstimator(), []
    learner = Learner(places=places)
    before, last_depth = None, 0.0
    for tick, place in enumerate(path.tolist()):
        contact = proxy.follow(place)
        depth, normal, point = contact.depth, np.array(contact.normal), np.array(contact.point)
        sliding = np.zeros(3) if before is None else (point - before) / TICK
        rate, last_depth, before = (depth - last_depth) / TICK, depth, point
        if depth <= 0.0:
            before = None
            learner.update(tick * TICK, depth, random.normal(0.0, NOISE))
            continue
        a, b, c = SOFT * stiffer(point[0], point[1])
        pressed = max(depth * (a + b * depth + c * rate), 0.0)
        speed = float(np.linalg.norm(sliding))
        force = pressed * normal - (FRICTION * pressed * sliding / speed if speed > 1e-3 else 0.0)
        force = force + random.normal(0.0, NOISE, 3)
        along = float(force @ normal)
        start = time.perf_counter_ns()
        places.touch_at(contact.point)
        learner.update(tick * TICK, depth, along)
        costs.append(time.perf_counter_ns() - start)
        friction.update(along, (force - along * normal).tolist(), sliding.tolist(), TICK)
    return Palpated(learner, friction, len(path) * TICK, float(np.median(costs)) / 1000.0)


def maps(learner: Learner, axis: Array) -> tuple[Array, Array]:
    """Local stiffness and its uncertainty over the square [N/mm]."""
    x, y = np.meshgrid(axis, axis, indexing="ij")
    learnt, places = learner.learnt(), learner.places
    assert learnt.model is not None
    assert places is not None
    law = 1e-3 * stiffness_at_rest(learnt.model, FIELD_DEPTH - learnt.surface)
    scales, deviations = places.field.scales_at(np.stack([x.ravel(), y.ravel()], axis=1))
    return (law * scales).reshape(x.shape), (law * scales * deviations).reshape(x.shape)


def found_inclusion(stiffness: Array, axis: Array) -> tuple[Array, float]:
    """Centre and radius [m] of what is stiffer than half way between the median and the stiffest."""
    inside = stiffness > 0.5 * (np.median(stiffness) + np.percentile(stiffness, 98))
    x, y = np.meshgrid(axis, axis, indexing="ij")
    area = inside.sum() * (axis[1] - axis[0]) ** 2
    return np.array([x[inside].mean(), y[inside].mean()]), float(np.sqrt(area / np.pi))


def palpation() -> str:
    """Palpate in two ways, and draw what was learnt beside the truth."""
    axis = np.linspace(-0.03, 0.03, 121)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    true = 1e-3 * (SOFT[0] + 2.0 * FIELD_DEPTH * SOFT[1]) * stiffer(x, y)
    away = np.abs(np.hypot(x - CENTRE[0], y - CENTRE[1]) - RADIUS) > 4e-3
    ways = {"121 presses": palpate(presses()), "sliding": palpate(slides())}
    rows, drawn = [], {}
    for name, felt in ways.items():
        stiffness, uncertainty = maps(felt.learner, axis)
        drawn[name] = stiffness, uncertainty
        error = stiffness / true - 1.0
        centre, radius = found_inclusion(stiffness, axis)
        friction = (
            f"{felt.friction.coefficient:.3f} ± {felt.friction.deviations[0]:.3f}" if felt.friction.known else "-"
        )
        rows.append(
            f"| {name} | {felt.seconds:.0f} | {100.0 * np.sqrt(np.mean(error**2)):.1f} | "
            f"{100.0 * np.sqrt(np.mean(error[away] ** 2)):.1f} | {1e3 * np.linalg.norm(centre - CENTRE):.1f} | "
            f"{1e3 * radius:.1f} | {friction} | {100.0 * np.mean(np.abs(stiffness - true) < 2.0 * uncertainty):.0f} |"
        )
    draw_palpation(axis, true, drawn)
    head = (
        "| Palpated by | Seconds | Error, RMS [%] | 4 mm off the edge [%] | Centre off by [mm] | Radius [mm] | "
        "Friction | Within two deviations [%] |"
    )
    return "\n".join([head, "| --- |" + " --: |" * 7, *rows]) + "\n"


def draw_palpation(axis: Array, true: Array, drawn: dict[str, tuple[Array, Array]]) -> None:
    """Truth, what was learnt, its uncertainty, and a cut through the inclusion: `docs/images/palpation.png`."""
    figure, panes = plt.subplots(2, 3, figsize=(12.0, 7.4), layout="constrained")
    extent = (1e3 * axis[0], 1e3 * axis[-1], 1e3 * axis[0], 1e3 * axis[-1])
    top = 1.15 * float(true.max())
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    ring = 1e3 * (CENTRE[:, None] + RADIUS * np.stack([np.cos(angle), np.sin(angle)]))

    def picture(pane: Any, values: Array, title: str, largest: float, colours: str, ring_colour: str) -> Any:
        shown = pane.imshow(values.T, origin="lower", extent=extent, vmin=0.0, vmax=largest, cmap=colours)
        pane.plot(*ring, color=ring_colour, linestyle="--", linewidth=1.0)
        pane.set(title=title, xlabel="x [mm]", ylabel="y [mm]")
        return shown

    shown = picture(panes[0, 0], true, "Truth (dashed: the inclusion)", top, "viridis", "white")
    for column, (name, (stiffness, uncertainty)) in enumerate(drawn.items(), start=1):
        picture(panes[0, column], stiffness, f"Learnt, {name}", top, "viridis", "white")
        uncertain = picture(panes[1, column], uncertainty, f"Its uncertainty, {name}", 0.6, "magma_r", INK)
        centre, radius = found_inclusion(stiffness, axis)
        circle = 1e3 * (centre[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)]))
        panes[0, column].plot(*circle, color=INK, linewidth=1.5, label="found")
        panes[0, column].legend(loc="upper left", fontsize=8)
    figure.colorbar(shown, ax=panes[0, :], label="local stiffness at 2 mm [N/mm]", shrink=0.85)
    figure.colorbar(uncertain, ax=panes[1, 1:], label="standard deviation [N/mm]", shrink=0.85)
    cut = panes[1, 0]
    row = int(np.argmin(np.abs(axis - CENTRE[1])))
    cut.set_box_aspect(1.0)
    cut.plot(1e3 * axis, true[:, row], color=INK, label="truth")
    for (name, (stiffness, uncertainty)), colour, style in zip(
        drawn.items(), (BLUE, VERMILLION), ("-", "--"), strict=True
    ):
        line, spread = stiffness[:, row], uncertainty[:, row]
        cut.plot(1e3 * axis, line, color=colour, linestyle=style, label=name)
        cut.fill_between(1e3 * axis, line - spread, line + spread, color=colour, alpha=0.2, linewidth=0.0)
    cut.set(
        title=f"Cut at y = {1e3 * CENTRE[1]:.0f} mm",
        xlabel="x [mm]",
        ylabel="local stiffness [N/mm]",
        ylim=(0.0, 1.2 * top),
    )
    cut.legend(fontsize=8, loc="upper left")
    figure.savefig(IMAGES / "palpation.png", dpi=110)
    plt.close(figure)


MEASURED = {"god-object": god_object, "palpation": palpation}


def main() -> None:
    """Measure what was asked for, print it, and write it into the page."""
    for name in chosen(sys.argv[1:], MEASURED):
        table = MEASURED[name]()
        print(table, flush=True)
        fill(PAGE, {name: table})


if __name__ == "__main__":
    main()

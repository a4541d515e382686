"""The proxy on a mesh: a tick against the number of triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread
from foretouch.rendering.surfaces import TriangleMesh

SIDES = (10, 32, 100, 316)
"""Squares along each side of the sheet; each is two triangles."""

WIDTH, HEIGHT, DEPTH, SPEED, PERIOD = 0.1, 2e-3, 1e-3, 0.05, 1e-3
"""Of the sheet and its waves [m]; how deep the probe goes below it [m], its speed [m/s], time of a tick [s]."""

TICKS, ROUNDS = 2_000, 11

Array = NDArray[np.float64]


def sheet(side: int) -> TriangleMesh:
    """A wavy sheet of `2 side^2` triangles."""
    along = np.linspace(0.0, WIDTH, side + 1)
    x, y = (part.ravel() for part in np.meshgrid(along, along, indexing="ij"))
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    right, over, up = first + side + 1, first + side + 2, first + 1
    faces = np.concatenate([np.stack([first, right, over], axis=1), np.stack([first, over, up], axis=1)])
    return TriangleMesh(np.stack([x, y, _height(x, y)], axis=1), faces)


def _height(x: Array, y: Array) -> Array:
    return HEIGHT * np.sin(2.0 * np.pi * x / 0.04) * np.cos(2.0 * np.pi * y / 0.05)


def slide() -> list[tuple[float, float, float]]:
    """Places of the probe, a tick each: from above into the sheet, then below it round a circle."""
    angle = SPEED * PERIOD / (0.3 * WIDTH) * np.arange(TICKS)
    x, y = (0.5 * WIDTH + 0.3 * WIDTH * part for part in (np.cos(angle), np.sin(angle)))
    depth = np.minimum(DEPTH, SPEED * PERIOD * np.arange(TICKS) - DEPTH)
    return list(zip(x.tolist(), y.tolist(), (_height(x, y) - depth).tolist(), strict=True))


def contestant(side: int) -> Contestant:
    """Ticks on such a sheet."""
    surface, places = sheet(side), slide()

    def run() -> Array:
        follow: Callable[..., object] = surface.follow
        memory = surface.initial_memory()
        for x, y, z in places:
            follow(memory, x, y, z)
        return memory

    return Contestant(run, TICKS)


def measure(scope: Scope) -> list[Row]:
    """Microseconds a tick, and how they grow with the triangles."""
    times = interleave({f"{2 * side**2:,}": contestant(side) for side in SIDES}, ROUNDS)
    few, *_, many = times
    return [
        Row.of(f"proxy on {many} triangles over that on {few}", ratio(times, many, few), "x"),
        *(Row.of(f"proxy on a mesh of {count} triangles, a tick", spread(times[count], 1e6), "us") for count in times),
    ]

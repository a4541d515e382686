"""The contact map over one recording, and against how many of its cells the recording visits."""

from __future__ import annotations

import numpy as np

from foretouch.bench.press import press
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread
from foretouch.identification import ContactMapBank
from foretouch.models.contact_map.layout import LENGTHS

SIZE, CELLS_SIZE, ROUNDS = 100_000, 20_000, 9
"""Samples of the recording, and of each of those that visit more cells."""

DEEPEST = (4e-3, 8e-3, 16e-3, 32e-3)
"""Depths that they reach [m]; all begin at 2 mm."""

REACH_NS = 500.0


def cells(deepest: float) -> int:
    """Cells of the coarse map, 1 mm each, between the shallowest and the deepest place [m] of a press."""
    depth = press(CELLS_SIZE, deepest).depth
    return int(np.ptp(np.floor(depth / LENGTHS[0]))) + 1


def contestant(size: int, deepest: float) -> Contestant:
    """The map over a press, from nothing."""
    estimator, pressed = ContactMapBank(), press(size, deepest)
    touching = np.ones(size, dtype=np.bool_)
    return Contestant(lambda: estimator.run(*pressed, touching), size, estimator.reset)


def measure(scope: Scope) -> list[Row]:
    """Nanoseconds a sample, and how they grow with the cells."""
    times = interleave({"recording": contestant(SIZE, 10e-3)}, ROUNDS)
    visited = {str(cells(deepest)): contestant(CELLS_SIZE, deepest) for deepest in DEEPEST}
    times |= interleave(visited, ROUNDS)
    few, *_, many = visited
    return [
        Row.of(f"contact map, {many} cells over {few} cells", ratio(times, many, few), "x"),
        Row.of(
            "contact map over a recording of 10^5 samples, all in contact",
            spread(times["recording"], 1e9),
            "ns/sample",
            REACH_NS,
        ),
        *(
            Row.of(f"contact map over {CELLS_SIZE} samples in {name} cells", spread(times[name], 1e9), "ns/sample")
            for name in visited
        ),
    ]

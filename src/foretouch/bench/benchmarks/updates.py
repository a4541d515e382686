"""What one sample costs an estimator, and one tick the proxy on a mesh.

The paper's estimator runs over one recording beside peers that are given its regressors ready-made, and one call a
sample from Python, as in a control loop, with what many calls leave in memory. The contact map runs over one recording,
and against how many of its cells a recording visits; the proxy against the number of triangles.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.bench import peers
from foretouch.bench.timing import Array, Contestant, Row, Scope, interleave, ratio, resident_bytes, spread
from foretouch.identification import (
    FPRLS,
    ContactMap,
    ContactSample,
    ContactSamples,
    Estimator,
    ExactContinuousSwitching,
)
from foretouch.models.contact_map.layout import COARSE
from foretouch.rendering.surfaces import TriangleMesh

FPRLS_SIZE, PEER_SIZE, FPRLS_ROUNDS = 1_000_000, 3_000, 15
"""Samples of ours and of the peers, whose cost a sample does not depend on how many there are."""

FPRLS_REACH_NS = 40.0

REACHES = {"padasip": 200.0, "filterpy": 400.0, "river": 400.0, peers.RIVER_WITHOUT_FORGETTING: None}
"""Smallest speed over each peer's [-]."""


def theta_of(pressed: peers.Press) -> Array:
    """(ln k, s, b1, b2) after a recording, features included."""
    estimator = FPRLS(peers.OPTIONS)
    estimator.run(ContactSamples(*pressed))
    return np.array(estimator.linear_parameters)


def measure_fprls(scope: Scope) -> list[Row]:
    """Nanoseconds a sample, and how many times as fast as each peer and as a bare compiled loop."""
    pressed, small = peers.press(FPRLS_SIZE), peers.Problem.of(peers.press(PEER_SIZE))
    problem = peers.Problem.of(pressed)
    bounds: list[float] = []
    contestants = {
        "ours": Contestant(
            lambda: theta_of(pressed), FPRLS_SIZE, lambda: bounds.append(peers.measure_latencies(1).fused_bound)
        ),
        "bare": Contestant(lambda: peers.recursion_over(problem), FPRLS_SIZE),
    }
    for name in peers.PEERS:
        run = peers.peer(name, small, scope.say)
        if run is not None:
            contestants[name] = Contestant(run, PEER_SIZE)
    times = interleave(contestants, FPRLS_ROUNDS)
    there = [name for name in peers.PEERS if name in times]
    what = "FPRLS over 10^6 samples"
    rows = [
        Row.of(f"{what}, times as fast as {name}", ratio(times, name, "ours"), "x", REACHES[name], at_least=True)
        for name in there
    ]
    over_bound = 1e9 * times["ours"] / bounds[1:]  # the first was that of the warm-up
    rows.append(Row.of(f"{what}, over the bound by its dependency chain", spread(over_bound), "x", 2.5))
    rows.append(Row.of(f"{what}, over a bare compiled recursion", ratio(times, "ours", "bare"), "x"))
    rows.append(Row.of(f"{what}, features included", spread(times["ours"], 1e9), "ns/sample", FPRLS_REACH_NS))
    rows.append(Row.of("the bound by the dependency chain of FPRLS", spread(bounds[1:]), "ns/sample"))
    rows += [Row.of(f"{name}, {PEER_SIZE} samples", spread(times[name], 1e6), "us/sample") for name in there]
    return rows


CALL_SIZE, CALL_ROUNDS = 10_000, 11
CALLS = 100_000  # Number of calls after which nothing may have grown
TURNS = 3  # Repetitions of these calls; a leak shows in each of them, other growth of the process only in some

CALLED: dict[str, tuple[Callable[[], Estimator], float]] = {
    "FPRLS": (lambda: FPRLS(peers.OPTIONS), 1.0),
    "exact": (ExactContinuousSwitching, 3.0),
    "contact map": (ContactMap, 5.0),
}
"""Function that makes each estimator, by name, and the largest time that a call may take [us]."""


def update_all(estimator: Estimator, pressed: list[ContactSample]) -> Callable[[], None]:
    """Calls `update` once a sample."""

    def run() -> None:
        update = estimator.update
        for sample in pressed:
            update(sample)

    return run


def bare(pressed: list[ContactSample]) -> Callable[[], None]:
    """A compiled call that does next to nothing once a sample."""
    state = np.zeros(1)

    def run() -> None:
        for time, depth, velocity, force, _ in pressed:
            peers.bare_call(state, time, depth, velocity, force)

    return run


def memory_growth(estimator: Estimator, pressed: list[ContactSample]) -> int:
    """Bytes that the second half of the calls leave; the first half of the samples fills what is filled once."""
    half = len(pressed) // 2
    update_all(estimator, pressed[:half])()
    return growth(update_all(estimator, pressed[half:]))


def growth(run: Callable[[], None]) -> int:
    """Bytes that this process holds more after a run than before, the least of some turns.

    Memory is counted in whole pages, of Python and of compiled code alike.
    """
    held = []
    for turn in range(TURNS + 1):
        if turn:
            run()
        gc.collect()
        held.append(resident_bytes())
    return int(np.diff(held).min())


def measure_call(scope: Scope) -> list[Row]:
    """Microseconds a call, times a bare compiled call, and bytes that are left."""
    pressed = peers.samples(peers.press(CALL_SIZE))
    contestants = {"bare": Contestant(bare(pressed), CALL_SIZE)}
    for name, (make, _) in CALLED.items():
        estimator = make()
        contestants[name] = Contestant(update_all(estimator, pressed), CALL_SIZE, estimator.reset)
    times = interleave(contestants, CALL_ROUNDS)
    rows = [Row.of(f"{name} update over a bare compiled call", ratio(times, name, "bare"), "x") for name in CALLED]
    for name, (_, reach) in CALLED.items():
        rows.append(Row.of(f"{name} update, one call a sample", spread(times[name], 1e6), "us", reach))
    rows.append(Row.of("a bare compiled call from Python", spread(times["bare"], 1e6), "us"))
    if not resident_bytes():
        scope.say("this system does not say how much memory a process holds: those rows are left out")
        return rows
    many = peers.samples(peers.press(2 * CALLS))
    rows += [
        Row(f"{name} update, memory that 10^5 calls leave", float(memory_growth(make(), many)), "B", 1024.0)
        for name, (make, _) in CALLED.items()
    ]
    return rows


MAP_SIZE, CELLS_SIZE, MAP_ROUNDS = 100_000, 20_000, 9
"""Samples of the recording, and of each of those that visit more cells."""

DEEPEST = (4e-3, 8e-3, 16e-3, 32e-3)  # Depths that they reach [m]; all begin at 2 mm

MAP_REACH_NS = 500.0


def cells(deepest: float) -> int:
    """Cells of the coarse map, 1 mm each, between the shallowest and the deepest place [m] of a press."""
    depth = peers.press(CELLS_SIZE, deepest).depth
    return int(np.ptp(np.floor(depth / COARSE.spacing))) + 1


def map_contestant(size: int, deepest: float) -> Contestant:
    """The map over a press, from nothing."""
    estimator, samples = ContactMap(), ContactSamples(*peers.press(size, deepest))
    return Contestant(lambda: estimator.run(samples), size, estimator.reset)


def measure_map(scope: Scope) -> list[Row]:
    """Nanoseconds a sample, and how they grow with the cells."""
    times = interleave({"recording": map_contestant(MAP_SIZE, 10e-3)}, MAP_ROUNDS)
    visited = {str(cells(deepest)): map_contestant(CELLS_SIZE, deepest) for deepest in DEEPEST}
    times |= interleave(visited, MAP_ROUNDS)
    few, *_, many = visited
    what = "contact map over a recording of 10^5 samples, all in contact"
    return [
        Row.of(f"contact map, {many} cells over {few} cells", ratio(times, many, few), "x"),
        Row.of(what, spread(times["recording"], 1e9), "ns/sample", MAP_REACH_NS),
        *(
            Row.of(f"contact map over {CELLS_SIZE} samples in {name} cells", spread(times[name], 1e9), "ns/sample")
            for name in visited
        ),
    ]


SIDES = (10, 32, 100, 316)
"""Squares along each side of the sheet; each is two triangles."""

WIDTH, HEIGHT, DEPTH, SPEED, PERIOD = 0.1, 2e-3, 1e-3, 0.05, 1e-3
"""Width of the sheet and height of its waves [m], depth [m] and speed [m/s] of the probe, time of a tick [s]."""

TICKS, MESH_ROUNDS = 2_000, 11


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


def mesh_contestant(side: int) -> Contestant:
    """Ticks on such a sheet."""
    surface, positions = sheet(side), slide()

    def run() -> Any:
        follow: Callable[..., object] = surface.follow
        memory = surface.initial_memory()
        for x, y, z in positions:
            follow(memory, x, y, z)
        return memory

    return Contestant(run, TICKS)


def measure_mesh(scope: Scope) -> list[Row]:
    """Microseconds a tick, and how they grow with the triangles."""
    times = interleave({f"{2 * side**2:,}": mesh_contestant(side) for side in SIDES}, MESH_ROUNDS)
    few, *_, many = times
    return [
        Row.of(f"proxy on {many} triangles over that on {few}", ratio(times, many, few), "x"),
        *(Row.of(f"proxy on a mesh of {count} triangles, a tick", spread(times[count], 1e6), "us") for count in times),
    ]

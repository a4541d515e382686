"""The paper's estimator over one recording, beside peers that are given its regressors ready-made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.peers import PEERS, RIVER_WITHOUT_FORGETTING, measure_latencies, peer
from foretouch.bench.press import OPTIONS, Press, Problem, press, recursion_over
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread
from foretouch.identification import FPRLS

SIZE, PEER_SIZE, ROUNDS = 1_000_000, 3_000, 15
"""Samples of ours and of the peers, whose cost a sample does not depend on how many there are."""

REACH_NS = 40.0

REACHES = {"padasip": 200.0, "filterpy": 400.0, "river": 400.0, RIVER_WITHOUT_FORGETTING: None}
"""How many times as fast as each."""


def theta_of(pressed: Press) -> NDArray[np.float64]:
    """(ln k, s, b1, b2) after a recording, features included."""
    return FPRLS(OPTIONS).run(pressed.depth, pressed.velocity, pressed.force).theta


def measure(scope: Scope) -> list[Row]:
    """Nanoseconds a sample, and how many times as fast as each peer and as a bare compiled loop."""
    pressed, small = press(SIZE), Problem.of(press(PEER_SIZE))
    problem = Problem.of(pressed)
    bounds: list[float] = []

    def look_at_the_bound() -> None:
        bounds.append(measure_latencies(1).fused_bound)

    contestants = {
        "ours": Contestant(lambda: theta_of(pressed), SIZE, look_at_the_bound),
        "bare": Contestant(lambda: recursion_over(problem), SIZE),
    }
    for name in PEERS:
        run = peer(name, small, scope.say)
        if run is not None:
            contestants[name] = Contestant(run, PEER_SIZE)
    times = interleave(contestants, ROUNDS)
    there = [name for name in PEERS if name in times]
    what = "FPRLS over 10^6 samples"
    rows = [
        Row.of(f"{what}, times as fast as {name}", ratio(times, name, "ours"), "x", REACHES[name], at_least=True)
        for name in there
    ]
    over_bound = 1e9 * times["ours"] / bounds[1:]  # the first was that of the warm-up
    rows.append(Row.of(f"{what}, over the bound by its dependency chain", spread(over_bound), "x", 2.5))
    rows.append(Row.of(f"{what}, over a bare compiled recursion", ratio(times, "ours", "bare"), "x"))
    rows.append(Row.of(f"{what}, features included", spread(times["ours"], 1e9), "ns/sample", REACH_NS))
    rows.append(Row.of("the bound by the dependency chain of FPRLS", spread(bounds[1:]), "ns/sample"))
    rows += [Row.of(f"{name}, {PEER_SIZE} samples", spread(times[name], 1e6), "us/sample") for name in there]
    return rows

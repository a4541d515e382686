"""The paper's estimator over one recording, beside peers that are given its regressors ready-made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.peers import PEERS, RIVER_WITHOUT_FORGETTING, peer
from foretouch.bench.press import OPTIONS, Press, Problem, press, samples
from foretouch.bench.reference import recursion_over
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread
from foretouch.identification import FPRLS

__all__ = ["measure", "theta_of"]

SIZE, PEER_SIZE, ROUNDS = 1_000_000, 3_000, 7
"""Samples of ours and of the peers, whose cost a sample does not depend on how many there are."""

REACH_NS = 40.0

REACHES = {"padasip": 200.0, "filterpy": 400.0, "river": 400.0, RIVER_WITHOUT_FORGETTING: None}
"""How many times as fast as each."""


def theta_of(pressed: Press) -> NDArray[np.float64]:
    """(ln k, s, b1, b2) after a recording, features included, by the fastest way that there is."""
    estimator = FPRLS(OPTIONS)
    for sample in samples(pressed):
        estimator.update(sample)
    return np.array(estimator.linear_parameters)


def measure(scope: Scope) -> list[Row]:
    """Nanoseconds a sample, and how many times as fast as each peer and as a bare compiled loop."""
    pressed, small = press(SIZE), Problem.of(press(PEER_SIZE))
    problem = Problem.of(pressed)
    contestants = {
        "ours": Contestant(lambda: theta_of(pressed), SIZE),
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
    rows.append(Row.of("FPRLS over a bare compiled recursion", ratio(times, "ours", "bare"), "x"))
    rows.append(Row.of(f"{what}, features included", spread(times["ours"], 1e9), "ns/sample", REACH_NS))
    rows += [Row.of(f"{name}, {PEER_SIZE} samples", spread(times[name], 1e6), "us/sample") for name in there]
    return rows

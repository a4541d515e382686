"""One call a sample from Python, as in a control loop, and what many of them leave in memory."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable

import numpy as np

from foretouch.bench.press import OPTIONS, press, samples
from foretouch.bench.reference import bare_call
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread
from foretouch.identification import FPRLS, ContactMapBank, ContactSample, Estimator, ExactRecursive

__all__ = ["CALLED", "bare", "measure", "memory_growth", "update_all"]

SIZE, ROUNDS = 10_000, 11
CALLS = 100_000
"""After which nothing may have grown."""

CALLED: dict[str, tuple[Callable[[], Estimator], float]] = {
    "FPRLS": (lambda: FPRLS(OPTIONS), 1.0),
    "exact": (ExactRecursive, 3.0),
    "contact map": (ContactMapBank, 5.0),
}
"""By name: what makes the estimator, and what a call is to cost at most [us]."""


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
            bare_call(state, time, depth, velocity, force)

    return run


def memory_growth(estimator: Estimator, pressed: list[ContactSample]) -> int:
    """Bytes that a second half of calls leaves more than the first did.

    Args:
        estimator: Fresh.
        pressed: Samples; the first half is there to fill what is filled once.
    """
    half = len(pressed) // 2
    update_all(estimator, pressed[:half])()
    run = update_all(estimator, pressed[half:])
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        run()
        gc.collect()
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()


def measure(scope: Scope) -> list[Row]:
    """Microseconds a call, times a bare compiled call, and bytes that are left."""
    pressed = samples(press(SIZE))
    contestants = {"bare": Contestant(bare(pressed), SIZE)}
    for name, (make, _) in CALLED.items():
        estimator = make()
        contestants[name] = Contestant(update_all(estimator, pressed), SIZE, estimator.reset)
    times = interleave(contestants, ROUNDS)
    rows = [Row.of(f"{name} update over a bare compiled call", ratio(times, name, "bare"), "x") for name in CALLED]
    for name, (_, reach) in CALLED.items():
        rows.append(Row.of(f"{name} update, one call a sample", spread(times[name], 1e6), "us", reach))
    rows.append(Row.of("a bare compiled call from Python", spread(times["bare"], 1e6), "us"))
    many = samples(press(2 * CALLS))
    rows += [
        Row(f"{name} update, memory that 10^5 calls leave", float(memory_growth(make(), many)), "B", 1024.0)
        for name, (make, _) in CALLED.items()
    ]
    return rows

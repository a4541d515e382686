"""One call a sample from Python, as in a control loop, and what many of them leave in memory."""

from __future__ import annotations

import gc
from collections.abc import Callable

import numpy as np

from foretouch.bench.press import OPTIONS, bare_call, press, samples
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, resident_bytes, spread
from foretouch.identification import FPRLS, ContactMapBank, ContactSample, Estimator, ExactRecursive

SIZE, ROUNDS = 10_000, 11
CALLS = 100_000
"""After which nothing may have grown."""

TURNS = 3
"""Of these calls; what leaks does so in each of them, what else the process comes to hold, in some."""

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
    """Bytes that this process holds more after the second half of the calls than before, the least of some turns.

    It is counted in whole pages, and whoever asked for them: what Python keeps, and what compiled code does.

    Args:
        estimator: Fresh.
        pressed: Samples; the first half is there to fill what is filled once.
    """
    half = len(pressed) // 2
    update_all(estimator, pressed[:half])()
    run = update_all(estimator, pressed[half:])
    held = []
    for turn in range(TURNS + 1):
        if turn:
            run()
        gc.collect()
        held.append(resident_bytes())
    return int(np.diff(held).min())


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
    if not resident_bytes():
        scope.say("this system does not say how much memory a process holds: those rows are left out")
        return rows
    many = samples(press(2 * CALLS))
    rows += [
        Row(f"{name} update, memory that 10^5 calls leave", float(memory_growth(make(), many)), "B", 1024.0)
        for name, (make, _) in CALLED.items()
    ]
    return rows

"""Ticks of the safety layer: random ones, and what Python makes of them; the same as `safety_ticks.c`.

As a program it reads rows of `COLUMNS` and writes the results and the state, so that it can run with nothing compiled.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.session.safety import kernel
from foretouch.session.safety.safety import Safety, SafetyLimits

COLUMNS = (
    *("stopped", "desired", "position", "force", "in_contact", "surface"),
    *("silence", "faulty", "guarded", "free", "uncertain"),
)
FLAGS = (0, 4, 7, 8, 10)


def random_ticks(count: int, seed: int) -> NDArray[np.float64]:
    """Rows of `COLUMNS`: a robot that wanders and presses, commands that jump, faults, silence, and missing numbers."""
    random = np.random.default_rng(seed)
    desired = np.cumsum(random.normal(0.0, 2e-5, count)) % 0.04 - 0.02
    desired[random.random(count) < 0.0005] += 0.01
    position = desired + random.normal(0.0, 2e-4, count)
    force = np.maximum(position, 0.0) * random.choice([300.0, 3e4], count) + random.normal(0.0, 0.05, count)
    apart = [
        _spells(random, count, share) for share in (0.002, 0.01, 0.01, 0.02)
    ]  # stopped, faulty, guarded, uncertain
    silence = np.where(_spells(random, count, 0.05), random.uniform(0.0, 1.0, count), 1e-3)
    surface = np.where(_spells(random, count, 0.3), np.nan, random.normal(0.0, 1e-4, count))
    free = np.where(_spells(random, count, 0.2), random.normal(-1e-3, 1e-3, count), -np.inf)
    for numbers in (desired, position, force):
        numbers[random.random(count) < 0.002] = np.nan
    stopped, faulty, guarded, uncertain = apart
    touching = force > 0.3
    return np.column_stack(
        [stopped, desired, position, force, touching, surface, silence, faulty, guarded, free, uncertain]
    ).astype(np.float64)


def _spells(random: np.random.Generator, count: int, share: float) -> NDArray[np.bool_]:
    """Whether something lasts, in spells of 50 ticks that take this share of all."""
    return np.repeat(random.random(-(-count // 50)) < share, 50)[:count]


def run(rows: NDArray[np.float64]) -> bytes:
    """Aim, status and position of each tick, as 64-bit floats, and the state after the last."""
    memories = Safety(SafetyLimits(), 1e-3).memories
    results = np.empty((len(rows), 3))
    keep, limit = kernel.keep_safe.entry, kernel.limit.entry
    for index, row in enumerate(rows.tolist()):
        given: list[Any] = [bool(value) if column in FLAGS else value for column, value in enumerate(row)]
        aim, status = keep(memories, *given)
        results[index] = aim, status, limit(memories)
    return results.tobytes() + memories.tobytes()


if __name__ == "__main__":
    read = np.frombuffer(sys.stdin.buffer.read()).reshape(-1, len(COLUMNS))
    sys.stdout.buffer.write(run(read))

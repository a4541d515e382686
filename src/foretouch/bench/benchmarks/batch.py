"""The paper's estimator over thousands of recordings at once, on one core, beside vectorised NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.press import FORGETTING_FACTOR, OPTIONS, Press, Problem, press, recursion_over_many
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, ratio, spread
from foretouch.identification import FPRLS

STREAMS, SAMPLES, ROUNDS = 4096, 250, 11
"""Recordings, and samples of each."""

Array = NDArray[np.float64]


class Streams(NamedTuple):
    """The same press, begun elsewhere by each stream.

    Attributes:
        pressed: Columns, each of shape (m, n).
        regressors: (1, ln x, v, v / x), shape (m, 4, n).
        known: The last three of these, as ours takes them, each of shape (m, n).
        targets: ln F, shape (m, n).
        forgetting_factor: mu, shape (m, n): 1 at the first sample, which has not moved, then the paper's.
    """

    pressed: Press
    regressors: Array
    known: tuple[Array, Array, Array]
    targets: Array
    forgetting_factor: Array

    @classmethod
    def of(cls, streams: int, samples: int = SAMPLES) -> Streams:
        """Some streams of some samples."""
        whole = press(streams + samples)
        take = np.arange(samples)[:, None] + np.arange(streams)
        problem = Problem.of(whole)
        factors = np.full((samples, streams), FORGETTING_FACTOR)
        factors[0] = 1.0
        regressors = np.ascontiguousarray(np.moveaxis(problem.regressors[take], 2, 1))
        return cls(
            Press(*(np.ascontiguousarray(column[take]) for column in whole)),
            regressors,
            (regressors[:, 1].copy(), regressors[:, 2].copy(), regressors[:, 3].copy()),
            np.ascontiguousarray(problem.targets[take]),
            factors,
        )

    def with_features(self) -> Array:
        """Theta of all streams, shape (n, 4), from depths, velocities and forces."""
        return FPRLS(OPTIONS).run_many(self.pressed.depth, self.pressed.velocity, self.pressed.force).theta

    def without_features(self) -> Array:
        """The same from regressors that are known."""
        return FPRLS(OPTIONS).run_regressors(*self.known, self.targets, self.forgetting_factor).theta

    def in_numpy(self) -> Array:
        """The same by NumPy."""
        return recursion_over_many(self.regressors, self.targets, self.forgetting_factor)


def contestants(streams: int) -> dict[str, Contestant]:
    """Ours with and without features, and NumPy.

    Args:
        streams: How many.
    """
    given = Streams.of(streams)
    count = streams * SAMPLES
    return {
        "without features": Contestant(given.without_features, count),
        "with features": Contestant(given.with_features, count),
        "NumPy": Contestant(given.in_numpy, count),
    }


def measure(scope: Scope) -> list[Row]:
    """Nanoseconds a sample on one core, and how many times as fast as NumPy."""
    times = interleave(contestants(STREAMS), ROUNDS)
    what = f"FPRLS over {STREAMS} recordings at once"
    return [
        Row.of(f"{what}, times as fast as NumPy", ratio(times, "NumPy", "without features"), "x", 10.0, at_least=True),
        Row.of(f"{what}, without features", spread(times["without features"], 1e9), "ns/sample", 8.0),
        Row.of(f"{what}, with features", spread(times["with features"], 1e9), "ns/sample", 16.0),
        Row.of("the same in NumPy, without features", spread(times["NumPy"], 1e9), "ns/sample"),
    ]

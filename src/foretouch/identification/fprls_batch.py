"""Equation (20) over many independent recordings at once, compiled: block by block of `fprls_lanes`.

Serial and parallel are two functions each: what Numba compiles for all cores is slower on one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point
from foretouch.identification.fprls_lanes import (
    BUFFER,
    LANES,
    RESULT_SIZE,
    begin,
    features_equal,
    features_weighted,
    load,
    load_regressors,
    step,
)
from foretouch.identification.fprls_layout import WEIGHT

__all__ = ["regressors_parallel", "regressors_serial", "run_parallel", "run_serial"]

Array = NDArray[np.float64]

_compiled = compiled(error_model="numpy")


def _block(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    first: int,
    result: Array,
    every: Array,
) -> None:
    """All samples of the recordings from `first` on, `LANES` at most."""
    buffer = np.empty(BUFFER)
    begin(buffer, options)
    width = min(LANES, depth.shape[1] - first)
    for row in range(depth.shape[0]):
        load(buffer, depth, velocity, force, in_contact, row, first)
        if options[WEIGHT] == 0.0:
            features_equal(buffer, options)
        else:
            features_weighted(buffer, options)
        step(buffer, options)
        if row < every.shape[0]:
            for i in range(4):
                every[row, i, first : first + width] = buffer[i * LANES : i * LANES + width]
    for i in range(RESULT_SIZE):
        result[i, first : first + width] = buffer[i * LANES : i * LANES + width]


def _block_of_regressors(
    log_depth: Array,
    velocity: Array,
    rate: Array,
    log_force: Array,
    memory: Array,
    options: Array,
    first: int,
    result: Array,
) -> None:
    buffer = np.empty(BUFFER)
    begin(buffer, options)
    width = min(LANES, memory.shape[1] - first)
    for row in range(memory.shape[0]):
        load_regressors(buffer, log_depth, velocity, rate, log_force, memory, row, first)
        step(buffer, options)
    for i in range(RESULT_SIZE):
        result[i, first : first + width] = buffer[i * LANES : i * LANES + width]


block: Any = _compiled(_block)
block_of_regressors: Any = _compiled(_block_of_regressors)


def _run_serial(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    result: Array,
    every: Array,
) -> None:
    """All samples of n recordings, each from the beginning.

    Args:
        depth: [m], shape (m, n).
        velocity: [m/s], shape (m, n).
        force: [N], shape (m, n).
        in_contact: Shape (m, n).
        options: Of all, shape (OPTIONS_SIZE,).
        result: Filled, shape (RESULT_SIZE, n); see `COUNTS`.
        every: Theta after each sample, filled, shape (m, 4, n); or left alone, shape (0, 4, n).
    """
    for first in range(0, depth.shape[1], LANES):
        block(depth, velocity, force, in_contact, options, first, result, every)


def _run_parallel(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    result: Array,
    every: Array,
) -> None:
    """The same on all cores."""
    for number in prange((depth.shape[1] + LANES - 1) // LANES):
        block(depth, velocity, force, in_contact, options, number * LANES, result, every)


Runner = Callable[[Array, Array, Array, NDArray[np.bool_], Array, Array, Array], None]

run_serial: Runner = entry_point(_run_serial)
run_parallel: Runner = entry_point(_run_parallel, parallel=True)


def _regressors_serial(
    log_depth: Array, velocity: Array, rate: Array, log_force: Array, memory: Array, options: Array, result: Array
) -> None:
    """As `run_serial`, of regressors that are known.

    Args:
        log_depth: ln x, in the unit of the regressors as all of these, shape (m, n).
        velocity: v, shape (m, n).
        rate: v / x, shape (m, n).
        log_force: ln F, shape (m, n).
        memory: Forgetting factors mu, shape (m, n).
        options: Of all, shape (OPTIONS_SIZE,).
        result: Filled, shape (RESULT_SIZE, n).
    """
    for first in range(0, memory.shape[1], LANES):
        block_of_regressors(log_depth, velocity, rate, log_force, memory, options, first, result)


def _regressors_parallel(
    log_depth: Array, velocity: Array, rate: Array, log_force: Array, memory: Array, options: Array, result: Array
) -> None:
    """The same on all cores."""
    for number in prange((memory.shape[1] + LANES - 1) // LANES):
        block_of_regressors(log_depth, velocity, rate, log_force, memory, options, number * LANES, result)


RegressorRunner = Callable[[Array, Array, Array, Array, Array, Array, Array], None]

regressors_serial: RegressorRunner = entry_point(_regressors_serial)
regressors_parallel: RegressorRunner = entry_point(_regressors_parallel, parallel=True)

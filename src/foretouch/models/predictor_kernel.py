"""Motion and prediction, compiled: what `foretouch.models.Predictor` does at every sample."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.models import law_kernel
from foretouch.models.contact_map.kernel import Memory, memory_of, moved, numbers_of, rate_of, write
from foretouch.models.contact_map.layout import MEMORY, Map
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED
from foretouch.models.law_kernel import NO_NUMBERS, Law
from foretouch.models.predictor import HISTORY, SLICE, STATE_TOLERANCE, VELOCITY_CUTOFF

Numbers = NDArray[Any]
FourNumbers = tuple[float, float, float, float]


class Motion(Record):
    """State of a `foretouch.models.MotionFilter`."""

    velocity_rate: float = 2.0 * math.pi * VELOCITY_CUTOFF  # 2 pi f_c [1/s]
    time: float = math.nan  # of the newest sample [s], NaN before the first
    position: float = math.nan  # [m]
    velocity: float  # [m/s]


@compiled(error_model="numpy")
def move(motion: Motion, time: float, position: float) -> float:
    """See `MotionFilter.update`."""
    period = time - motion.time
    if not period > 0.0 or not math.isfinite(position):
        if math.isnan(motion.time) and math.isfinite(position) and math.isfinite(time):
            motion.time, motion.position = time, position
        return float(motion.velocity)
    before = motion.velocity
    slope = (position - motion.position) / period
    velocity = before + (1.0 - math.exp(-motion.velocity_rate * period)) * (slope - before)
    motion.velocity, motion.time, motion.position = velocity, time, position
    return float(velocity)


class Arrived(Record):
    """A contact map that waits until the motion since its state has been run through its memory."""

    waits: int  # whether there is one
    maps: Annotated[NDArray[Any], Map, 1]
    state: Annotated[Numbers, float, MEMORY]
    tick: int  # number of the sample after which the state is this
    surface: float
    message: int
    serial: int


class Waiting(Record):
    """Contact maps that wait."""

    arrivals: Annotated[NDArray[Any], Arrived, 2]  # the one that waits, and the newest that came meanwhile
    sliced: int = -1  # the newest sample after which a slice was run


class Past(Record):
    """The newest samples of a motion, by the remainder of their number."""

    memories: Annotated[Numbers, float, (HISTORY, MEMORY)] = math.nan  # type: ignore[assignment]  # after each
    positions: Annotated[Numbers, float, HISTORY]  # [m]
    periods: Annotated[Numbers, float, HISTORY]  # [s]


class Prediction(Record):
    """State of a `foretouch.models.Predictor`; its attributes are described there. Each number has 64 bits."""

    law: Law  # of the model, where it is compiled
    memory: Annotated[Numbers, float, MEMORY] = math.nan  # type: ignore[assignment]  # of its material
    surface: float
    former_law: Law  # the same of the model that predicted before
    former_memory: Annotated[Numbers, float, MEMORY] = math.nan  # type: ignore[assignment]
    former_surface: float
    changed: int  # whether a model came since the last sample
    motion: Motion
    time: float = math.nan  # of the newest sample [s]
    ticks: int
    position: float
    depth: float
    velocity: float
    force: float
    standard_deviation: float = math.nan
    jump: float
    past: Past
    message: int
    serial: int  # counts the models that were adopted: of the one that predicts
    waiting: Waiting


@compiled
def bounded(depth: float) -> float:
    """A depth within the bounds of `foretouch.models.advance` [m]."""
    return min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)


@compiled(error_model="numpy")
def observe(p: Prediction, time: float, position: float, velocity: float) -> float:
    """Take a sample of the motion [m], with a velocity [m/s], NaN for that of the positions; returns its period [s]."""
    period = time - p.time
    p.time = time
    p.ticks += 1
    if math.isfinite(position):
        p.position = position
    index = p.ticks % HISTORY
    p.past.positions[index], p.past.periods[index] = p.position, period if period > 0.0 else 0.0  # the first has none
    p.velocity = move(p.motion, time, p.position) if math.isnan(velocity) else velocity
    p.jump = 0.0
    p.depth = bounded(p.position - p.surface)
    if not period > 0.0:
        p.force, p.standard_deviation = 0.0, math.nan
    return period


@compiled(error_model="numpy")
def predict(p: Prediction, time: float, position: float, velocity: float) -> float:
    """See `foretouch.models.Predictor.update`, for laws that are compiled."""
    period = observe(p, time, position, velocity)
    memory = numbers_of(p.memory)
    if period > 0.0:
        before = memory
        memory, p.force, p.standard_deviation = law_kernel.advance(p.law, before, p.depth, p.velocity, period)
        write(memory, p.memory)
        if p.changed:
            p.changed = 0
            depth = p.position - p.former_surface
            p.jump = (
                p.force - law_kernel.advance(p.former_law, numbers_of(p.former_memory), depth, p.velocity, period)[1]
            )
    write(memory, p.past.memories[p.ticks % HISTORY])
    return float(p.force)


@compiled
def shift(p: Prediction, distance: float) -> None:
    """See `foretouch.models.Predictor.shift`."""
    p.motion.position += distance
    p.former_surface += distance


@compiled
def asked_at(p: Prediction) -> tuple[float, float]:
    """Depth [m] and velocity [m/s] at which local slopes are asked: outside the surface, those at the surface."""
    depth = 0.0 if p.depth < 0.0 and not abs(p.force) > 0.0 else p.depth
    return depth, min(max(p.velocity, -LARGEST_SPEED), LARGEST_SPEED)


@compiled
def local_slopes(p: Prediction, reach: float) -> tuple[float, float]:
    """See `foretouch.models.Predictor.local_slopes`."""
    depth, velocity = asked_at(p)
    return law_kernel.slopes(p.law, numbers_of(p.memory), depth, velocity, reach)


@compiled
def leaving_work(p: Prediction, offset: float, largest: float) -> tuple[float, float]:
    """See `foretouch.models.Predictor.leaving_work`."""
    return law_kernel.leaving_work(p.law, numbers_of(p.memory), p.depth, offset, largest)


ONE_LAW = Prediction.layout.fields["former_law"][1] // 8  # type: ignore[index]
"""Numbers of a law, its material and its surface, at the beginning of the record, in which each has 64 bits."""

ONE_ARRIVED = Arrived.layout.itemsize // 8  # Numbers of a model that waits

AT_MAP = Law.layout.fields["map"][1] // 8  # type: ignore[index]  # of them before the map


@compiled
def copy(numbers: NDArray[np.float64], into: NDArray[np.float64]) -> None:
    """Copy numbers to where there is room for them: an assignment of arrays would make another one meanwhile."""
    for index in range(numbers.size):
        into[index] = numbers[index]


@compiled
def keep_former(predictions: NDArray[np.void]) -> bool:
    """Keep the law as the former one, by which `jump` is reckoned, unless there is one since the last sample."""
    p, flat = predictions[0], predictions.view(np.float64)
    first = p.changed == 0
    if first:
        copy(flat[:ONE_LAW], flat[ONE_LAW:])
    p.changed = 1
    return bool(first)


@compiled
def _begin(
    predictions: NDArray[np.void],
    kind: int,
    numbers: FourNumbers,
    maps: NDArray[np.void],
    memory: Memory,
    surface: float,
    message: int,
    serial: int,
) -> None:
    """Predict from a law, with this memory of its material, and a surface [m].

    The law before the first since the last sample is the former one.
    """
    p, flat = predictions[0], predictions.view(np.float64)
    keep_former(predictions)
    p.law.kind = kind
    if kind == law_kernel.MAP:
        copy(maps.view(np.float64), flat[AT_MAP:])
    for index in range(4):
        p.law.numbers[index] = numbers[index]
    write(memory, p.memory)
    p.surface, p.depth = surface, bounded(p.position - surface)
    p.message, p.serial = message, serial


@compiled
def _agrees(p: Prediction, state: Memory, tick: int) -> bool:
    """Whether an arrived state is that of the contact map here after the sample of this number, within a tolerance."""
    own = numbers_of(p.past.memories[tick % HISTORY])
    alike = p.law.kind == law_kernel.MAP and tick > p.ticks - HISTORY
    for index in range(MEMORY):
        alike = alike and abs(own[index] - state[index]) <= STATE_TOLERANCE
    return bool(alike)


@compiled(error_model="numpy")
def _run_again(p: Prediction, arrived: Arrived, last: int) -> None:
    """Bring the memory of a contact map that waits on to the sample `last`."""
    now, period, learnt = numbers_of(arrived.state), -1.0, arrived.maps[0]
    rates = rate_of(period)
    for sample in range(arrived.tick + 1, last + 1):
        index = sample % HISTORY
        if p.past.periods[index] != period:
            period = p.past.periods[index]
            rates = rate_of(period)
        now = moved(learnt, now, p.past.positions[index] - arrived.surface - learnt.origin, rates)
    write(now, arrived.state)
    arrived.tick = last


@compiled
def _run_slice(predictions: NDArray[np.void]) -> None:
    """Run a slice of past motion for the model that waits; begin with it at the end."""
    p = predictions[0]
    arrived = p.waiting.arrivals[0]
    arrived.tick = max(arrived.tick, p.ticks - HISTORY)  # older samples are forgotten
    _run_again(p, arrived, min(p.ticks, arrived.tick + SLICE))
    if arrived.tick < p.ticks:
        return
    memory, surface, message, serial = numbers_of(arrived.state), arrived.surface, arrived.message, arrived.serial
    _begin(predictions, law_kernel.MAP, NO_NUMBERS, arrived.maps, memory, surface, message, serial)
    flat = p.waiting.arrivals.view(np.float64)
    copy(flat[ONE_ARRIVED:], flat)
    p.waiting.arrivals[1].waits = 0


@compiled
def none_waits(p: Prediction) -> None:
    """Let no model wait any more."""
    p.waiting.arrivals[0].waits = p.waiting.arrivals[1].waits = 0


@kernel("b1(Prediction[::1], i8, UniTuple(f8, 4), Map[::1], UniTuple(f8, 6), f8, i8, i8, i8)", Map)
def adopt(
    predictions: NDArray[np.void],
    kind: int,
    numbers: FourNumbers,
    maps: NDArray[np.void],
    state: Memory,
    surface: float,
    tick: int,
    message: int,
    serial: int,
) -> bool:
    """See `foretouch.models.Predictor.adopt`; a tick below zero says that the state is of now, whatever the motion was.

    Returns:
        Whether a model waits from now on.
    """
    p, memory = predictions[0], memory_of(state)
    if kind != law_kernel.MAP or tick < 0:
        none_waits(p)
        _begin(predictions, kind, numbers, maps, memory, surface, message, serial)
        return False
    tick = min(tick, p.ticks)
    if _agrees(p, state, tick):
        none_waits(p)
        _begin(predictions, kind, numbers, maps, numbers_of(p.memory), surface, message, serial)
        return False
    arrived = p.waiting.arrivals[p.waiting.arrivals[0].waits]
    arrived.waits, arrived.tick, arrived.surface, arrived.message, arrived.serial = 1, tick, surface, message, serial
    copy(maps.view(np.float64), arrived.maps.view(np.float64))
    write(memory, arrived.state)
    if p.waiting.arrivals[1].waits == 0:
        _run_slice(predictions)
    return bool(p.waiting.arrivals[0].waits != 0)


@kernel("b1(Prediction[::1])")
def catch_up(predictions: NDArray[np.void]) -> bool:
    """See `foretouch.models.Predictor.catch_up`; whether a model still waits."""
    p = predictions[0]
    if p.waiting.arrivals[0].waits != 0 and p.waiting.sliced != p.ticks:
        p.waiting.sliced = p.ticks
        _run_slice(predictions)
    return bool(p.waiting.arrivals[0].waits != 0)


@kernel("f8(Prediction[::1], f8, f8, f8)")
def update(predictions: NDArray[np.void], time: float, position: float, velocity: float) -> float:
    """`predict` with one of an array."""
    return predict(predictions[0], time, position, velocity)


@compiled
def disown(p: Prediction) -> None:
    """See `foretouch.models.Predictor.disown`."""
    none_waits(p)
    p.message = 0


none_waits_entry = Kernel(none_waits, "(Prediction,)")
disown_entry = Kernel(disown, "(Prediction,)")
keep_entry = Kernel(keep_former, "(Prediction[::1],)")
move_entry = Kernel(move, "(Motion, f8, f8)")
observe_entry = Kernel(observe, "(Prediction, f8, f8, f8)")
shift_entry = Kernel(shift, "(Prediction, f8)")
asked_at_entry = Kernel(asked_at, "(Prediction,)")
slopes_entry = Kernel(local_slopes, "(Prediction, f8)")
work_entry = Kernel(leaving_work, "(Prediction, f8, f8)")

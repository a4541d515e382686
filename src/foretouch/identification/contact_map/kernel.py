"""One sample for the whole bank of experts, and whole recordings of raw samples, compiled.

Method and reasons: `foretouch.identification.ContactMap`. A recording is one compiled loop, in which each sample is
conditioned, compared with the model before it (the residual is that of `identify`) and learnt from; `learn_raw` is the
same for one sample, without the comparison.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import Kernel, compiled, inlined
from foretouch.core.records import Record
from foretouch.identification.conditioning.conditioner import Lag, clear, take_lagged
from foretouch.identification.conditioning.kernel import Conditioning, Memory, condition, is_full, lose_surface
from foretouch.identification.contact_map.learning import (
    CHANGED,
    FAILED,
    LONGEST_PERIOD,
    PERIOD,
    learn,
    restart,
)
from foretouch.identification.contact_map.remembered import attend, drop
from foretouch.identification.contact_map.scores import LONGEST_HORIZON
from foretouch.identification.contact_map.state import HELD, NOT_GIVEN, Bank
from foretouch.identification.exact.belief import FEWEST_UPDATES, law_numbers
from foretouch.identification.exact.belief import clear as clear_law
from foretouch.identification.exact.kernel import move_surface as move_law
from foretouch.identification.exact.kernel import take as take_law
from foretouch.identification.scale_field_kernel import ScaleState, shared
from foretouch.models.contact_map.kernel import advanced, memory_of, numbers_of, remember
from foretouch.models.contact_map.layout import COARSE, LARGEST_FORCE, SIZE, Map
from foretouch.models.contact_map.wire import narrow
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED

Array = NDArray[np.float64]
Banks = NDArray[np.void]


LARGEST_SHIFT = (COARSE.below - 1) * COARSE.spacing
"""Largest shift of the surface from where the map began [m], after which it begins anew, for it has no more knots; in
its first `LONGEST_HORIZON` in contact one of a knot is enough: the first contact was false, and little is lost."""

FREE_AIR, UNUSABLE, WAITING, LEARNT, LEARNT_IN_AIR, OTHER, GONE, RESTARTED = range(8)
"""Result of a sample: all from LEARNT on have changed the model. OTHER is a material that has changed, and GONE one
that is no longer there."""


@compiled(error_model="numpy")
def begin(bank: Bank) -> None:
    """Begin a map where the surface is now."""
    learnt, notes = bank.map[0], bank.notes[0]
    restart(bank)
    learnt.origin = learnt.zero = learnt.felt = 0.0
    notes.learnt_at = -math.inf
    bank.memory[:] = math.nan
    notes.begun = notes.updates
    bank.remembered.count = 0


@compiled(error_model="numpy")
def reset(banks: Banks) -> None:
    """Forget all samples; what was set stays, and how many changes there were."""
    bank = banks[0]
    bank.map.view(np.float64)[:] = 0.0
    bank.notes.view(np.float64)[:] = 0.0
    clear_law(bank.law[0].belief)
    bank.notes[0].time = math.nan
    if bank.remembered.state != NOT_GIVEN:
        bank.remembered.state = HELD
    begin(bank)


@compiled(error_model="numpy")
def move_surface(banks: Banks, change: float) -> None:
    """Depths count from a surface that is deeper by a change [m] from now on; the map stays where it is."""
    if not math.isfinite(change):
        return
    bank, learnt = banks[0], banks[0].map[0]
    move_law(bank.law[:], change)
    learnt.origin -= change
    learnt.law_surface += change
    if abs(learnt.origin) > (COARSE.spacing if bank.notes[0].contact < LONGEST_HORIZON else LARGEST_SHIFT):
        begin(bank)


@compiled(error_model="numpy")
def move_offset(banks: Banks, change: float) -> None:
    """Forces count from an offset that is larger by a change [N] from now on; the map keeps the raw forces."""
    if math.isfinite(change):
        banks[0].map[0].zero += change


@compiled(error_model="numpy")
def take(banks: Banks, time: float, depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """Process one sample, in place; returns its result."""
    bank, learnt, notes = banks[0], banks[0].map[0], banks[0].notes[0]
    if notes.entered == (1 if in_contact else 0):
        notes.entered += 1
    if in_contact:
        take_law(bank.law[:], time, depth, velocity, force)
    if not (abs(depth) <= LARGEST_DEPTH and abs(velocity) <= LARGEST_SPEED and abs(force) <= LARGEST_FORCE):
        return FREE_AIR if math.isnan(depth) else UNUSABLE
    if in_contact:
        notes.touched = 1
    if notes.touched == 0:  # the map counts from the first contact
        return FREE_AIR
    before = notes.time
    if not time > before and not math.isnan(before):
        return UNUSABLE
    notes.time = time
    position = depth - learnt.origin
    remember(learnt, bank.memory, position, 0.0 if math.isnan(before) else time - before)
    if time - notes.learnt_at < PERIOD - 1e-7:
        return WAITING
    belief = bank.law[0].belief[0]
    if law_numbers(belief, learnt.law):
        learnt.law_surface = belief.theta[4] * belief.reference
    period = time - notes.learnt_at
    code = learn(bank, time, position, velocity, force, in_contact)
    if bank.remembered.state == HELD:
        if code == CHANGED:
            drop(bank)
        else:
            attend(bank, time, (position, velocity, force), in_contact, min(period, LONGEST_PERIOD))
    if code == FAILED:
        reset(banks)
        return RESTARTED
    notes.updates += 1
    if code != CHANGED:
        return LEARNT if in_contact else LEARNT_IN_AIR
    if in_contact:
        return OTHER
    # The material is gone, and nobody knows how far: all waits for the next touch.
    clear_law(bank.law[0].belief)
    learnt.law[:] = 0.0
    learnt.law_surface = 0.0
    begin(bank)
    notes.touched = 0
    return GONE


@compiled(error_model="numpy")
def run(
    banks: Banks,
    time: Array,
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    codes: NDArray[np.int8],
) -> None:
    """`take` for one sample after the other; the codes are written."""
    for i in range(time.size):
        codes[i] = take(banks, time[i], depth[i], velocity[i], force[i], in_contact[i])


RawColumns = tuple[NDArray[np.bool_], Array, Array]


class Newest(Record):
    """The newest sample: the fields of `ContactSample`, in their order."""

    time: float = math.nan  # [s], NaN before the first
    depth: float = math.nan  # [m]
    velocity: float  # [m/s]
    force: float  # less the offset [N]
    in_contact: bool


class Learning(Record):
    """What a learner remembers beside its conditioner and its estimator."""

    newest: Annotated[NDArray[Any], Newest, 1]
    lag: Annotated[NDArray[Any], Lag, 1]


class Run(Record):
    """What a run over raw samples remembers beside the learner, from one block to the next."""

    model: Annotated[NDArray[Any], Map, 1]  # the map as it crosses the network: rounded to 32 bits, less the law
    deviation: float = math.nan  # standard deviation of the force at the last sample that has a residual [N]
    stale: bool = True  # whether the model is to be made anew before it is used
    known: bool  # whether there is a model
    needed: Annotated[NDArray[Any], np.int8, SIZE]  # scratch: the numbers of the model that a force is computed from


@compiled(error_model="numpy")
def expect(run: Run, bank: Bank, depth: float, velocity: float, period: float) -> float:
    """Force of the model at a sample, `foretouch.models.advance` from the state before it [N]; NaN without a model."""
    if run.stale:
        notes = bank.notes[0]
        maps = bank.remembered.shown if bank.coarse.traced > 0 else bank.map
        run.known = notes.updates - notes.begun >= FEWEST_UPDATES and narrow(maps, run.model[:], run.needed[:])
        for k in range(4):
            run.model[0].law[k] = maps[0].law[k]
        run.stale = False
    if not run.known:
        return math.nan
    memory = memory_of(numbers_of(bank.memory))
    depth = -LARGEST_DEPTH if math.isnan(depth) else min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)
    velocity = 0.0 if math.isnan(velocity) else min(max(velocity, -LARGEST_SPEED), LARGEST_SPEED)
    _, force, run.deviation = advanced(run.model[0], memory, depth, velocity, period)
    return float(force)


@compiled(error_model="numpy")
def left_for_map(field: ScaleState, bank: Bank, depth: float, velocity: float, force: float, period: float) -> float:
    """What the map is to learn of a force at a place of the field, which learns its scale [N]."""
    notes, expected, deviation = bank.notes[0], math.nan, 0.0
    if notes.updates - notes.begun >= FEWEST_UPDATES:
        learnt = bank.remembered.shown[0] if bank.coarse.traced > 0 else bank.map[0]
        _, expected, deviation = advanced(learnt, numbers_of(bank.memory), depth, velocity, period)
    return shared(field, force, expected, deviation, period)


@inlined
def learn_conditioned(
    banks: Banks,
    fields: NDArray[np.void] | None,
    conditioner: Memory,
    learnings: NDArray[np.void],
    known: tuple[float, float],
    raw: float,
    sample: tuple[float, float, float, float, bool],
) -> tuple[int, bool]:
    """Learn from a sample after `condition`: what was done, and whether surface or offset have moved.

    Args:
        banks: The contact map's.
        fields: An array of one `ScaleState` where the map is of a surface; None along a line.
        conditioner: Of the sample.
        learnings: The learner's; written.
        known: Surface [m] and force offset [N] before the sample.
        raw: Its force with the offset [N].
        sample: As `ContactSample` has it.
    """
    newest, lag, conditioned = learnings[0].newest[0], learnings[0].lag, conditioner[0][0]
    time, depth, velocity, force, touching = sample
    before, moved = newest.time, conditioned.surface - known[0]
    newest.time, newest.depth, newest.velocity, newest.force, newest.in_contact = time, depth, velocity, force, touching
    told = abs(moved) > 0.0  # not where one of them is unknown
    if told:
        move_surface(banks, moved)
    if conditioned.offset != known[1]:
        move_offset(banks, conditioned.offset - known[1])
        told = True
    if fields is not None:  # noqa: SIM102  # by itself, so that it is known as it is compiled
        # A weak place is felt late, and what is felt before would teach a weaker law.
        if (touching or banks[0].notes[0].touched > 0) and not math.isnan(fields[0].point[0]):
            force = left_for_map(fields[0], banks[0], depth, velocity, force, time - before)
    code = take(banks, time, depth, velocity, force, touching)
    if code in (OTHER, GONE):
        if not touching:
            lose_surface(conditioner)
            told = True
        clear(lag)
    if touching:
        take_lagged(lag, depth + conditioned.surface, velocity, raw, time - before)
    return code, told


@compiled(error_model="numpy")
def learn_raw(
    banks: Banks,
    fields: NDArray[np.void] | None,
    conditioner: Memory,
    learnings: NDArray[np.void],
    raw: tuple[float, float, float],
    velocity: float,
    measured: bool,
) -> tuple[int, bool]:
    """Learn from one raw sample: time [s], position [m] and force [N]. See `condition` for the velocity.

    Returns:
        What was done; and whether there is news of the conditioner's estimates or contact, or its rings are full.
    """
    time, position, force = raw
    state = conditioner[0][0]
    known, touched = (state.surface, state.offset), state.in_contact
    conditioned = condition(conditioner, time, position, force, velocity, measured)
    depth, velocity, felt, touching = conditioned
    code, told = learn_conditioned(
        banks, fields, conditioner, learnings, known, force, (time, depth, velocity, felt, touching)
    )
    return code, bool(told or state.in_contact != touched or is_full(conditioner))


RAW = "Tuple((Conditioning[::1], f8[:, ::1])), Learning[::1], UniTuple(f8, 3), f8, b1"
learn_on_line = Kernel(learn_raw, f"(Bank[::1], none, {RAW})", Conditioning)
learn_in_place = Kernel(learn_raw, f"(Bank[::1], ScaleState[::1], {RAW})", Conditioning)


@compiled(error_model="numpy")
def run_raw(
    banks: Banks,
    conditioner: Memory,
    learnings: NDArray[np.void],
    runs: NDArray[np.void],
    rows: Array,
    measured: bool,
    columns: RawColumns,
) -> tuple[int, int]:
    """Condition and learn from a block of raw samples.

    Args:
        banks: The contact map's.
        conditioner: Of the samples.
        learnings: The learner's; written.
        runs: An array of one `Run`, new before the first block; written.
        rows: Time [s], position [m], force [N] and velocity [m/s], shape (4, m).
        measured: Whether velocities were measured; else they are estimated from the positions.
        columns: Contact, force less the offset [N] and residual [N], shape (m,) each, which are written.

    Returns:
        Number of samples taken, fewer than m where the conditioner needs room before the next; and what the last did.
    """
    code, state, conditioned, newest = 0, runs[0], conditioner[0][0], learnings[0].newest[0]
    in_contact, forces, residual = columns
    for i in range(rows.shape[1]):
        time, position, raw = rows[0, i], rows[1, i], rows[2, i]
        surface, offset = conditioned.surface, conditioned.offset
        depth, velocity, force, touching = condition(conditioner, time, position, raw, rows[3, i], measured)
        in_contact[i], forces[i], residual[i] = touching, force, math.nan
        if touching:
            residual[i] = force - expect(state, banks[0], position - surface, velocity, time - newest.time)
        code, told = learn_conditioned(
            banks, None, conditioner, learnings, (surface, offset), raw, (time, depth, velocity, force, touching)
        )
        if told or code >= LEARNT:
            state.stale = True
        if is_full(conditioner):
            return i + 1, code
    return rows.shape[1], code

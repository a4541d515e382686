"""A learner over a whole recording: compiled where its estimator can, else sample by sample; the same numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.identification.conditioning import ContactSample
from foretouch.identification.contact_map import ContactMapBank
from foretouch.models import advance
from foretouch.quantities import ByValue

if TYPE_CHECKING:
    from foretouch.identification.learner import Learner

__all__ = ["LearnerRun", "RawSamples", "run_by_sample", "run_compiled"]

Array = NDArray[np.float64]

BLOCK = 1 << 15
"""Samples that are taken at once: what is copied of them stays small, and an interruption is heeded."""


@dataclass(frozen=True, eq=False)
class LearnerRun(ByValue):
    """What a learner made of the samples of a recording.

    Attributes:
        in_contact: The conditioner's judgement, shape (n,).
        residual: Force less that of the model learnt before the sample [N]; NaN outside contact and before there was a
            model, shape (n,).
        contact_force_rms: RMS of the force, less the offset as it was known then, over the samples that have a residual
            [N]; NaN where none has.
        standard_deviation: Of the force at the last sample that has a residual [N], NaN where the model carries no
            doubt.
    """

    in_contact: NDArray[np.bool_]
    residual: Array
    contact_force_rms: float
    standard_deviation: float


class RawSamples:
    """Columns of raw samples.

    Args:
        time: [s], shape (n,).
        position: [m], shape (n,).
        force: As the sensor gives it [N], shape (n,).
        velocity: [m/s], shape (n,), or None to find it from the positions.

    Raises:
        InputError: Columns of unlike shape.
    """

    def __init__(self, time: Array, position: Array, force: Array, velocity: Array | None) -> None:
        given = (time, position, force) if velocity is None else (time, position, force, velocity)
        self._columns = [np.asarray(column, np.float64) for column in given]
        shapes = [column.shape for column in self._columns]
        if len(set(shapes)) > 1 or len(shapes[0]) != 1:
            raise InputError(
                f"time, position, force, velocity have the shapes {', '.join(map(str, shapes))}: "
                "they must be columns of one length"
            )
        self.measured = velocity is not None
        self.size = self._columns[0].size

    def blocks(self) -> Iterator[tuple[int, Array]]:
        """Where each block begins, and its rows of shape (4, m); no longer valid once the next is asked for."""
        room = np.zeros((4, min(BLOCK, self.size)))
        for begin in range(0, self.size, BLOCK):
            count = min(BLOCK, self.size - begin)
            rows = room if count == room.shape[1] else np.zeros((4, count))
            for row, column in zip(rows, self._columns, strict=False):
                row[:] = column[begin : begin + count]
            yield begin, rows


class _Columns:
    """What a run tells; of the forces only as much as a block, for an hour of them is as long as the recording."""

    def __init__(self, size: int) -> None:
        self.in_contact, self.residual = np.zeros(size, np.bool_), np.full(size, math.nan)
        self.forces = np.empty(min(BLOCK, size))
        self._squares, self._count = 0.0, 0

    def close(self, begin: int, count: int) -> None:
        """A block is complete."""
        compared = self.forces[:count][np.isfinite(self.residual[begin : begin + count])]
        with np.errstate(over="ignore"):
            self._squares += float(np.square(compared).sum())
        self._count += compared.size

    def run(self, deviation: float) -> LearnerRun:
        """All blocks are complete."""
        rms = math.sqrt(self._squares / self._count) if self._count else math.nan
        return LearnerRun(self.in_contact, self.residual, rms, deviation)


def run_compiled(learner: Learner, bank: ContactMapBank, samples: RawSamples) -> LearnerRun:
    """See `Learner.run`.

    Args:
        learner: Goes on in place.
        bank: Its estimator.
        samples: Raw.
    """
    from foretouch.identification.raw_kernel import BEFORE, DEVIATION, STALE, make_notes

    conditioner, notes, columns = learner.conditioner, make_notes(learner.sample.time), _Columns(samples.size)
    for begin, rows in samples.blocks():
        taken, count = 0, rows.shape[1]
        while taken < count:
            part = slice(begin + taken, begin + count)
            told = columns.in_contact[part], columns.forces[taken:count], columns.residual[part]
            rest = np.ascontiguousarray(rows[:, taken:])
            more, learner.status = bank.run_raw(
                conditioner.memory, learner.lag.memory, notes, rest, samples.measured, told
            )
            taken += more
            conditioner.make_room()
        columns.close(begin, count)
    conditioner.recall()
    time, depth, velocity, force, touching = notes[BEFORE:STALE].tolist()
    learner.sample = ContactSample(time, depth, velocity, force, touching > 0.0)
    return columns.run(float(notes[DEVIATION]))


def run_by_sample(learner: Learner, samples: RawSamples, note: Callable[[int], None] | None = None) -> LearnerRun:
    """See `Learner.run`.

    Args:
        learner: Goes on in place.
        samples: Raw.
        note: Called after each sample from which on there is a model, with its index.
    """
    columns = _Columns(samples.size)
    estimator, conditioner = learner.estimator, learner.conditioner
    model, state, deviation = estimator.model, estimator.state, math.nan
    surface, before = conditioner.surface - estimator.surface_correction, learner.sample.time
    known: tuple[object, ...] = ()  # what the model was made of
    for begin, rows in samples.blocks():
        for index, (time, position, raw, speed) in enumerate(zip(*rows.tolist(), strict=True), begin):
            sample = learner.update(time, position, raw, speed if samples.measured else None)
            columns.in_contact[index], columns.forces[index - begin] = sample.in_contact, sample.force
            if sample.in_contact and model is not None:
                _, expected, deviation = advance(model, state, position - surface, sample.velocity, time - before)
                columns.residual[index] = sample.force - expected
            before, state = time, estimator.state
            now = (estimator.updates, estimator.changes, conditioner.surface, conditioner.force_offset)
            if now != known:
                known, model = now, estimator.model
                surface = conditioner.surface - estimator.surface_correction
            if note is not None and model is not None:
                note(index)
        columns.close(begin, rows.shape[1])
    return columns.run(deviation)

"""The recordings that designs are compared on, conditioned once, and the score that all of them get."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from foretouch.comparison import Truth, simulated_case, unforeseeable
from foretouch.comparison.cases import Case, file_case, load
from foretouch.comparison.combination import score_outside
from foretouch.identification import Conditioner
from foretouch.models import MotionFilter
from foretouch.quantities import Recording
from foretouch.recordings import DATASETS, excerpt, list_datasets
from foretouch.report import Forces, delayed_force, lowest_mean

Array = NDArray[np.float64]


def measured(kind: str) -> tuple[str, ...]:
    """All measured recordings of a kind."""
    return tuple(dataset.name for dataset in list_datasets(kind))


COLUMNS: dict[str, tuple[str, ...]] = {
    "foam": measured("foam"),
    "springs": measured("spring"),
    "rigid": measured("rigid"),
    "skin": measured("skin"),
    "laws": ("kelvin-voigt", "hunt-crossley", "continuous-switching"),
    "gradual": ("gradual-change",),
    "sudden": ("sudden-change",),
    "tapping": ("tapping",),
    "materials": ("sponge", "foam", "hand"),
}
"""Recordings by what is touched."""

NAMES = tuple(name for names in COLUMNS.values() for name in names)


@dataclass(frozen=True, eq=False)
class Press:
    """One recording, conditioned causally, and how it is scored; columns of shape (n,).

    Attributes:
        recording: As it is.
        truth: Of a simulated one.
        delay: Of the forces [s].
        zero: Force without contact that the scoring finds in the whole file [N].
        zero_given: Whether the learner is told it: a spring file is in contact throughout, and only its last samples
            show the zero.
        period: Of the samples [s].
        velocity: [m/s].
        acceleration: [m/s^2].
        surface: As known at each sample [m], NaN before.
        offset: Force without contact as known at each sample [N].
        in_contact: The conditioner's judgement.
        begin: First sample with a surface.
    """

    recording: Recording
    truth: Truth | None
    delay: float
    zero: float
    zero_given: bool
    period: float
    velocity: Array
    acceleration: Array
    surface: Array
    offset: Array
    in_contact: NDArray[np.bool_]
    begin: int

    @property
    def force(self) -> Array:
        """Less the offset as known at each sample [N]."""
        return self.recording.force - self.offset

    @property
    def late(self) -> NDArray[np.int64]:
        """For each sample the newest one whose force is known there; -1 for none."""
        return np.searchsorted(self.recording.time, self.recording.time - self.delay + 1e-7, "right") - 1

    def error(self, predicted: Array) -> float:
        """As `foretouch predict` and `foretouch compare --simulated` score [% of the RMS of the force in contact]."""
        recording, skin = self.recording, self.delay < 0.1
        known = delayed_force(recording.time, recording.force - self.zero, self.delay)
        forces = Forces(recording.time, recording.position, recording.force, predicted, known, recording.contact_floor)
        hidden, begin = None, 1.5
        if self.truth is not None:
            hidden, begin = unforeseeable(recording.time, self.truth.depth, self.delay, self.truth.changes), 3.0
        window = {"score_from": 0.5, "score_to": 1.6} if skin else {"score_from": begin}
        found = score_outside(forces, hidden, **window).prediction_error_percent
        return float("nan") if found is None else found


@lru_cache(maxsize=2)
def press(name: str) -> Press:
    """A measured or a simulated recording, read and conditioned."""
    case: Case = file_case(excerpt(name)) if name in DATASETS else simulated_case(name)
    recording, truth, _ = load(case)
    return conditioned(recording, truth, 0.02 if name in COLUMNS["skin"] else 0.3, name in COLUMNS["springs"])


def conditioned(recording: Recording, truth: Truth | None, delay: float, given: bool) -> Press:
    """A recording, conditioned sample by sample; the zero of its force is given or found."""
    zero = lowest_mean(recording.time, recording.force)
    conditioner = Conditioner(force_offset=zero if given else None, contact_floor=recording.contact_floor)
    motion, change, count = MotionFilter(), MotionFilter(velocity_cutoff=40.0), len(recording)
    columns, touching = np.empty((4, count)), np.zeros(count, np.bool_)
    samples = zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True)
    for index, (time, position, force) in enumerate(samples):
        acceleration = change.update(time, motion.update(time, position))
        touching[index] = conditioner.update(time, position, force, motion.velocity).in_contact
        columns[:, index] = motion.velocity, acceleration, conditioner.surface, conditioner.force_offset
    return Press(
        recording,
        truth,
        delay,
        zero,
        given,
        float(np.median(np.diff(recording.time))),
        *columns,
        touching,
        int(np.flatnonzero(~np.isnan(columns[2]))[0]),
    )

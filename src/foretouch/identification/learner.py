"""Conditioning and estimation together: the follower's whole learning, one call a sample or one a recording.

The contact map's bank takes a recording in one compiled loop, other estimators sample by sample: the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import NUMBER, require_type
from foretouch.identification.conditioning.conditioner import Conditioner, ContactSample, SensorLag, require_columns
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.identification.contact_map.bank import ContactMap
from foretouch.identification.contact_map.kernel import Learning, Run, learn_in_place, learn_on_line, run_raw
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.scale_field import ScaleFieldLearner
from foretouch.models import ContactModel, ContactState, advance
from foretouch.quantities import ByValue, Recording, brief_number, brief_text

Array = NDArray[np.float64]

GONE = "the material has changed: it is no longer there, and no force is given until it is touched again"


@dataclass(frozen=True, slots=True)
class LearntModel:
    """Model learnt so far; this is what crosses the network.

    Attributes:
        model: The law, or None while no force may be rendered.
        surface: Position of the surface [m]; 0 while unknown.
        state: Present state of the material.
        reason: One sentence: why there is no model; beside a model, the status of the newest sample, which does not
            invalidate the model: it stays good without contact.
    """

    model: ContactModel | None
    surface: float
    state: ContactState
    reason: str


class Learner:
    """Raw samples in, contact model out; the same code runs on recordings, simulations and robots.

    Args:
        estimator: Estimator of the law; None for a fresh `ContactMap`.
        surface: Position of the surface [m], None to estimate it.
        force_offset: Force in free air [N], None to estimate it.
        offset_error: Standard deviation of a given one [N]; 0 where it is exact and stays.
        contact_floor: Least force that counts as contact [N], by the noise of its origin.
        sensor_lag: Lag of forces behind positions [s]: learning then pairs simultaneous ones, and the predicted force
            is that at the contact, not at the sensor.
        places: Learns how the material varies over a surface, beside the law of all of it; None where all samples are
            felt at one place.

    Attributes:
        learning: State beside the conditioner's and the estimator's, one record.
        status: Result of the estimator's last update.
        lag: Estimates the lag of the forces, as far as `sensor_lag` has not compensated it.

    Raises:
        ArgumentTypeError: The argument is not an estimator.
        SettingError: A number is out of range.
    """

    def __init__(
        self,
        estimator: Estimator | None = None,
        *,
        surface: float | None = None,
        force_offset: float | None = None,
        offset_error: float = 0.0,
        contact_floor: float = CONTACT_FLOOR,
        sensor_lag: float = 0.0,
        places: ScaleFieldLearner | None = None,
    ) -> None:
        estimator = ContactMap() if estimator is None else estimator
        require_type("estimator", estimator, Estimator, "an Estimator, such as ContactMap()")
        require_type("surface", surface, (*NUMBER, type(None)), "a number of metres, or None to find it")
        require_type("force_offset", force_offset, (*NUMBER, type(None)), "a number of newtons, or None to find it")
        self.estimator = estimator
        self.estimator.trust_surface(surface is not None)
        self.conditioner = Conditioner(
            surface=surface,
            force_offset=force_offset,
            offset_error=offset_error,
            contact_floor=contact_floor,
            sensor_lag=sensor_lag,
        )
        self.learning, self.places = Learning.new(), places
        self._learn_raw = (learn_on_line if places is None else learn_in_place).entry
        self._newest = self.learning["newest"][0]
        self.lag = SensorLag(self.learning["lag"][0])
        self.status = Status.FREE_AIR

    @property
    def sample(self) -> ContactSample:
        """The newest conditioned sample."""
        return ContactSample(*self._newest.item())

    @sample.setter
    def sample(self, sample: ContactSample) -> None:
        self._newest[0] = sample

    def __repr__(self) -> str:
        """Estimator, and its estimates."""
        values = {name: brief_number(getattr(self.conditioner, name)) for name in ("surface", "force_offset")}
        return brief_text("Learner", {"estimator": self.estimator, **values, "status": self.status.value}.items())

    def update(self, time: float, position: float, force: float, velocity: float | None = None) -> ContactSample:
        """Learn from one raw sample (`Conditioner.update`) and return it conditioned."""
        conditioner, estimator = self.conditioner, self.estimator
        if type(estimator) is ContactMap:
            raw, known = (time, position, force), velocity is not None
            speed = 0.0 if velocity is None else velocity
            where, memory = None if self.places is None else self.places.states, conditioner.memory
            done = self._learn_raw(estimator.states, where, memory, self.learning, raw, speed, known)
            self.taken(estimator, *done)
            return self.sample
        last, before, offset = self._newest["time"].item(), conditioner.surface, conditioner.offset
        sample = self.sample = conditioner.update(time, position, force, velocity)
        moved = conditioner.surface - before
        if abs(moved) > 0.0:  # not where one of them is unknown
            estimator.move_surface(moved)
        if conditioner.offset != offset:  # what has drifted is none of the material
            estimator.move_offset(conditioner.offset - offset)
        status = self.status = estimator.update(sample if self.places is None else self._left(sample, last))
        if status is Status.CHANGED:
            if not sample.in_contact:
                conditioner.lose_surface()
            self.lag.reset()
        if sample.in_contact:
            point = sample.depth + conditioner.surface
            self.lag.update(point, sample.velocity, force, time - last)
        return sample

    def _left(self, sample: ContactSample, last: float) -> ContactSample:
        """What the law is to learn of a sample, after one at this time [s], where it was felt at a place."""
        estimator, (time, depth, velocity, force, in_contact) = self.estimator, sample
        model = estimator.model if estimator.has_model else None
        if self.places is None or not (in_contact or model is not None):
            return sample
        expected = deviation = math.nan
        if model is not None:
            _, expected, deviation = advance(model, estimator.state, depth, velocity, time - last)
        return sample._replace(force=self.places.share(force, expected, deviation, time - last))

    def taken(self, estimator: ContactMap, code: int, news: bool) -> None:
        """Take over what `learn_raw` did to this learner's estimator."""
        self.status = estimator.taken(code, news)
        if news:
            self.conditioner.make_room()

    def feel(self, time: float, position: float, force: float) -> ContactSample:
        """Condition one raw sample without learning: the force has to be known even where learning is off."""
        self.sample = self.conditioner.update(time, position, force)
        return self.sample

    def run(self, time: Array, position: Array, force: Array, velocity: Array | None = None) -> LearnerRun:
        """`update` with every sample of a recording, and the residuals of the model before each sample.

        Args:
            time: Sample times [s], shape (n,).
            position: Positions [m], shape (n,).
            force: Forces of the sensor [N], shape (n,).
            velocity: Measured velocities [m/s], shape (n,), or None to estimate them from the positions.

        Raises:
            InputError: The columns differ in shape.
        """
        samples = RawSamples(time, position, force, velocity)
        if not isinstance(self.estimator, ContactMap) or self.places is not None:
            return run_by_sample(self, samples)
        bank, conditioner, runs = self.estimator, self.conditioner, Run.new()
        for begin, rows in samples.blocks():
            taken, count = 0, rows.shape[1]
            while taken < count:
                part = slice(begin + taken, begin + count)
                reported = samples.in_contact[part], samples.forces[taken:count], samples.residual[part]
                rest = np.ascontiguousarray(rows[:, taken:])
                more, code = run_raw(
                    bank.states, conditioner.memory, self.learning, runs, rest, samples.measured, reported
                )
                self.status = bank.taken(code, True)
                taken += more
                conditioner.make_room()
        return samples.run(float(runs[0].deviation))

    def learnt(self) -> LearntModel:
        """The model as learnt so far."""
        surface = self.conditioner.surface
        if math.isnan(surface):
            gone = self.estimator.changes > 0
            return LearntModel(None, 0.0, (), GONE if gone else "nothing has been touched yet")
        model = self.estimator.model
        if model is None:
            return LearntModel(None, surface, (), "too few samples in contact, or too alike")
        surface -= self.estimator.surface_correction
        return LearntModel(model, surface, self.estimator.state, self.status.value)


def learner_of(recording: Recording, learner: Learner | Estimator | None) -> Learner:
    """The learner itself, or one of this estimator with the recording's contact floor; None for `ContactMap`.

    Raises:
        ArgumentTypeError: An argument is not a recording, or does not learn.
    """
    require_type("recording", recording, Recording, "a Recording: read_recording gives one")
    if isinstance(learner, Learner):
        return learner
    kinds = (Estimator, type(None))
    require_type("learner", learner, kinds, "a Learner or an Estimator, such as ContactMap(), or None")
    return Learner(learner, contact_floor=recording.contact_floor)


BLOCK = 1 << 15  # Number of samples taken at once: their copies stay small, and an interruption is heeded


@dataclass(frozen=True, eq=False)
class LearnerRun(ByValue):
    """Results of a learner over the samples of a recording, as of `foretouch.identification.Identification`.

    Forces are less the offset known at that time; `contact_force_rms` is NaN where no sample has a residual.
    """

    in_contact: NDArray[np.bool_]
    residual: Array
    contact_force_rms: float
    standard_deviation: float


class RawSamples:
    """Columns of raw samples, and what a learner finds at each.

    Of the forces only those of one block are kept, for those of an hour are as long as the recording.

    Raises:
        InputError: The columns differ in shape.
    """

    def __init__(self, time: Array, position: Array, force: Array, velocity: Array | None) -> None:
        given = (time, position, force) if velocity is None else (time, position, force, velocity)
        self._columns = [np.asarray(column, np.float64) for column in given]
        require_columns("time, position, force, velocity", *self._columns)
        self.measured, size = velocity is not None, self._columns[0].size
        self.in_contact, self.residual = np.zeros(size, np.bool_), np.full(size, math.nan)
        self.forces = np.empty(min(BLOCK, size))
        self._squares, self._count = 0.0, 0

    def blocks(self) -> Iterator[tuple[int, Array]]:
        """Index and rows of each block, of shape (4, m); before the next, what was found in it is added up."""
        for begin in range(0, self.residual.size, BLOCK):
            residual = self.residual[begin : begin + BLOCK]
            rows = np.zeros((4, residual.size))
            for row, column in zip(rows, self._columns, strict=False):
                row[:] = column[begin : begin + BLOCK]
            yield begin, rows
            compared = self.forces[: residual.size][np.isfinite(residual)]
            with np.errstate(over="ignore"):
                self._squares += float(np.square(compared).sum())
            self._count += compared.size

    def run(self, deviation: float) -> LearnerRun:
        """Results after all blocks."""
        rms = math.sqrt(self._squares / self._count) if self._count else math.nan
        return LearnerRun(self.in_contact, self.residual, rms, deviation)


def run_by_sample(learner: Learner, samples: RawSamples, note: Callable[[int], None] | None = None) -> LearnerRun:
    """See `Learner.run`; `note` is called after each sample from which on there is a model, with its index."""
    estimator, conditioner = learner.estimator, learner.conditioner
    model, state, deviation = estimator.model, estimator.state, math.nan
    surface, before = conditioner.surface - estimator.surface_correction, learner.sample.time
    known: tuple[object, ...] = ()  # what the model was made from
    for begin, rows in samples.blocks():
        for index, (time, position, raw, speed) in enumerate(zip(*rows.tolist(), strict=True), begin):
            sample = learner.update(time, position, raw, speed if samples.measured else None)
            samples.in_contact[index], samples.forces[index - begin] = sample.in_contact, sample.force
            if sample.in_contact and model is not None:
                _, expected, deviation = advance(model, state, position - surface, sample.velocity, time - before)
                samples.residual[index] = sample.force - expected
            before, state = time, estimator.state
            now = (estimator.updates, estimator.changes, conditioner.surface, conditioner.force_offset)
            if now != known:
                known, model = now, estimator.model
                surface = conditioner.surface - estimator.surface_correction
            if note is not None and model is not None:
                note(index)
    return samples.run(deviation)

"""Conditioning and estimation together: the follower's whole learning, one call a sample."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.errors.checks import NUMBER, require_type
from foretouch.identification.conditioning import CONTACT_FLOOR, Conditioner, ContactSample
from foretouch.identification.contact_map import ContactMapBank
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.learner_run import LearnerRun, RawSamples, run_by_sample, run_compiled
from foretouch.identification.sensor_lag import SensorLag
from foretouch.models import ContactModel, ContactState
from foretouch.quantities import Recording, brief_number, brief_text

__all__ = ["Learner", "LearntModel", "require_learning"]

Array = NDArray[np.float64]

GONE = "the material has changed: it is no longer there, and no force is given until it is touched again"


@dataclass(frozen=True, slots=True)
class LearntModel:
    """What has been learnt at one moment; this is what crosses the network.

    Attributes:
        model: The law, or None while no force may be rendered.
        surface: Position of the surface [m]; 0 while unknown.
        state: What the material remembers now.
        reason: One sentence: why there is no model; beside a model, what was done with the newest sample, which says
            nothing against the model: it stays good while nothing is touched.
    """

    model: ContactModel | None
    surface: float
    state: ContactState
    reason: str


class Learner:
    """Raw samples in, contact model out; the same code runs on recordings, simulations and robots.

    Args:
        estimator: Identifies the law.
        surface: Position of the surface [m], None to find it.
        force_offset: Force in free air [N], None to find it.
        contact_floor: Least force that counts as contact [N], by the noise of the origin.
        sensor_lag: How late forces are against positions [s]: learning then pairs what belongs together, and what is
            predicted is the force at the contact, not at the sensor.

    Attributes:
        sample: The newest conditioned sample.
        status: What the estimator did with it.
        lag: Estimates how late forces are, as far as `sensor_lag` has not mended it.

    Raises:
        ArgumentTypeError: An estimator that is none.
        SettingError: A number out of range.
    """

    def __init__(
        self,
        estimator: Estimator,
        *,
        surface: float | None = None,
        force_offset: float | None = None,
        contact_floor: float = CONTACT_FLOOR,
        sensor_lag: float = 0.0,
    ) -> None:
        require_type("estimator", estimator, Estimator, "an Estimator: make_estimator gives one")
        require_type("surface", surface, (*NUMBER, type(None)), "a number of metres, or None to find it")
        require_type("force_offset", force_offset, (*NUMBER, type(None)), "a number of newtons, or None to find it")
        self.estimator = estimator
        self.estimator.trust_surface(surface is not None)
        self.conditioner = Conditioner(
            surface=surface, force_offset=force_offset, contact_floor=contact_floor, sensor_lag=sensor_lag
        )
        self.lag = SensorLag()
        self.sample = ContactSample(math.nan, math.nan, 0.0, 0.0, False)
        self.status = Status.FREE_AIR

    def __repr__(self) -> str:
        """What learns, and what it has found."""
        found = {name: brief_number(getattr(self.conditioner, name)) for name in ("surface", "force_offset")}
        return brief_text("Learner", {"estimator": self.estimator, **found, "status": self.status.value}.items())

    def require_fresh(self) -> None:
        """Refuse to go on where samples of something else have been learnt from.

        Raises:
            InputError: They have.
        """
        if not math.isnan(self.sample.time):
            raise InputError("the learner has learnt from samples before: make a fresh one for each recording")

    def update(self, time: float, position: float, force: float, velocity: float | None = None) -> ContactSample:
        """Learn from one raw sample (`Conditioner.update`) and return it conditioned."""
        last, conditioner, estimator = self.sample.time, self.conditioner, self.estimator
        before, offset = conditioner.surface, conditioner.force_offset
        sample = self.sample = conditioner.update(time, position, force, velocity)
        moved = conditioner.surface - before
        if abs(moved) > 0.0:  # not where one of them is unknown
            estimator.move_surface(moved)
        if conditioner.force_offset != offset:
            estimator.move_offset(conditioner.force_offset - offset)
        status = self.status = estimator.update(sample)
        if status is Status.CHANGED:
            if not sample.in_contact:
                conditioner.lose_surface()
            self.lag.reset()
        if sample.in_contact:
            place = sample.depth + conditioner.surface
            self.lag.update(place, sample.velocity, force, time - last)
        return sample

    def feel(self, time: float, position: float, force: float) -> ContactSample:
        """Condition one raw sample and learn nothing from it: what is felt has to be known where nobody learns."""
        self.sample = self.conditioner.update(time, position, force)
        return self.sample

    def run(self, time: Array, position: Array, force: Array, velocity: Array | None = None) -> LearnerRun:
        """`update` with every sample of a recording, and what the model before each sample says of its force.

        The contact map's bank takes them in one compiled loop: the same numbers, bit for bit. Other estimators take
        them one by one.

        Args:
            time: [s], shape (n,).
            position: [m], shape (n,).
            force: As the sensor gives it [N], shape (n,).
            velocity: Measured [m/s], shape (n,), or None to find it from the positions.

        Raises:
            InputError: Columns of unlike shape.
        """
        samples = RawSamples(time, position, force, velocity)
        if isinstance(self.estimator, ContactMapBank):
            return run_compiled(self, self.estimator, samples)
        return run_by_sample(self, samples)

    def learnt(self) -> LearntModel:
        """What is known now."""
        surface = self.conditioner.surface
        if math.isnan(surface):
            gone = self.estimator.changes > 0
            return LearntModel(None, 0.0, (), GONE if gone else "nothing has been touched yet")
        model = self.estimator.model
        if model is None:
            return LearntModel(None, surface, (), "too few samples in contact")
        surface -= self.estimator.surface_correction
        return LearntModel(model, surface, self.estimator.state, self.status.value)


def require_learning(recording: Recording, learner: Learner) -> None:
    """Refuse what is no recording, or no learner, before one learns from the other.

    Raises:
        ArgumentTypeError: One of them is something else.
    """
    require_type("recording", recording, Recording, "a Recording: read_recording gives one")
    require_type("learner", learner, Learner, "a Learner: Learner(make_estimator(model, estimator)) makes one")

"""What every estimator keeps to."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.identification import Conditioner, ContactSample, Estimator, Identification, Learner, identify
from foretouch.models import LAWS, ContactModel, HuntCrossley, KelvinVoigt, advance, make_model
from foretouch.quantities import Recording
from foretouch.session.conformance.finding import Checks, Finding, Result, ignore, name_result, percentile_time
from foretouch.session.settings import SAMPLE_PERIOD

OWN_LAWS: dict[str, ContactModel] = {"kelvin-voigt": KelvinVoigt(600.0, 2.0)}
"""Laws all of whose presses an estimator of that law learns."""
SOFT = HuntCrossley(3000.0, 300.0, 1.4)
"""Estimators of all other laws learn presses of this one, which every law of the paper can be near to."""
SURFACE, OFFSET, DEEPEST = 0.01, 0.3, 0.01
"""Start of the presses [m], the sensor's force in free air [N], and depth of the presses [m]."""
LEAST_FORCE = 1e-3  # Less than this [N] is none: a map may have rounding beyond its surface
LARGEST_ERROR = 0.1  # Residual of the learnt law over the force in contact, both as RMS
LONGEST_UPDATE = 1e-4  # Half of all updates take at most this [s]
NONSENSE = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, 1e-300)


@dataclass(frozen=True, eq=False)
class Subject:
    """An estimator, how to make a fresh one, and the name that it is to have; without one, any."""

    estimator: Estimator
    make: Callable[[], Estimator]
    name: str

    @property
    def law(self) -> ContactModel:
        """Law whose presses it is to learn."""
        return OWN_LAWS.get(self.estimator.model_name, SOFT)

    @property
    @functools.lru_cache(maxsize=1)  # noqa: B019  # without a lock, as in `device_checks`
    def learnt(self) -> tuple[Estimator, Identification]:
        """A fresh estimator that has learnt presses of its own law, and what came of it."""
        estimator = self.make()
        result = _learn(estimator, self.law)
        if result.model.law not in LAWS:
            estimator = self.make()
            result = _learn(estimator, result.model)
        return estimator, result

    @property
    def model(self) -> ContactModel:
        """What it has learnt."""
        return self.learnt[1].model


checked = Checks(Estimator, "foretouch.identification.Estimator", Subject)


def check_estimator(
    make: Callable[[], Estimator], *, name: str = "", tell: Callable[[Finding], None] = ignore
) -> list[Finding]:
    """Check an estimator: it learns, predicts, never raises, forgets, is quick, and its uncertainty is finite.

    An estimator of a law that is not foretouch's learns presses of `SOFT`, then presses of what it has learnt: those it
    has to learn whole.

    Args:
        make: Makes a fresh one.
        name: That it is to have; without one, any.
        tell: Called with each finding as soon as it is known.

    Returns:
        One finding a check.

    Raises:
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    return checked.run(make, tell, name=name)


def press(law: ContactModel) -> Recording:
    """A second in free air, then presses of two frequencies, out of contact in between; the sensor has an offset."""
    time = np.arange(0.0, 4.0, SAMPLE_PERIOD)
    t = np.maximum(time - 1.0, 0.0)
    depth = DEEPEST * (np.sin(1.6 * math.pi * t) * (0.7 + 0.3 * np.sin(0.62 * math.pi * t)) - 0.05)
    return Recording(time, SURFACE + depth, _forces(law, depth, np.gradient(depth, time)) + OFFSET, name="simulated")


def _forces(law: ContactModel, depth: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    state, force = law.initial_state(), np.empty(depth.size)
    for index, (here, speed) in enumerate(zip(depth.tolist(), velocity.tolist(), strict=True)):
        state, force[index], _ = advance(law, state, here, speed, SAMPLE_PERIOD)
    return force


def _learn(estimator: Estimator, law: ContactModel) -> Identification:
    return identify(press(law), Learner(estimator, surface=SURFACE, force_offset=OFFSET))


@checked("name")
def _name(it: Subject) -> Result:
    own, law = getattr(it.estimator, "name", None), getattr(it.estimator, "model_name", None)
    kept, result, rule = name_result(own, it.name, ", model_name is that of its law")
    return bool(kept and isinstance(law, str) and law), f"{result}, model_name = {law!r}", rule


@checked("knows nothing at first", "before the first sample: model None, no parameters, updates 0")
def _nothing(it: Subject) -> Result:
    fresh = it.make()
    kept = fresh.model is None and fresh.parameters == {} and fresh.updates == 0
    return kept, f"model = {type(fresh.model).__name__}, updates = {fresh.updates}"


@checked("free air teaches nothing", "samples that are not in contact teach nothing")
def _free_air(it: Subject) -> Result:
    fresh = it.make()
    for index in range(200):
        fresh.update(ContactSample(index * SAMPLE_PERIOD, -0.01, 0.0, 0.0, False))
    return fresh.model is None and fresh.updates == 0, f"{fresh.updates} updates of 200 samples"


@checked(
    "learns its own law",
    f"on clean presses of its own law the residual is at most {100.0 * LARGEST_ERROR:g} % of the force",
)
def _learns(it: Subject) -> Result:
    error = it.learnt[1].residual_rms / it.learnt[1].contact_force_rms
    return error <= LARGEST_ERROR, f"{100.0 * error:.4g} %"


@checked(
    "its model predicts",
    "model is a ContactModel, whose force is finite, grows with depth, and is next to nothing outside",
)
def _predicts(it: Subject) -> Result:
    model: object = it.model
    if not isinstance(model, ContactModel):
        return False, f"a {type(model).__name__}"
    depth = np.arange(0.0, DEEPEST, 1e-5)
    force = _forces(model, depth, np.full(depth.size, 0.01))
    outside = advance(model, model.initial_state(), -0.01, 0.0, SAMPLE_PERIOD)[1]
    kept = bool(np.isfinite(force).all() and outside <= LEAST_FORCE and 0.0 <= force[100] < force[-1])
    return kept, f"{force[100]:.4g} N at 1 mm, {force[-1]:.4g} N at {1e3 * DEEPEST:g} mm, {outside:.4g} N outside"


@checked("its model crosses the network", "a model of a law of foretouch.models.LAWS, made again from its numbers")
def _crosses(it: Subject) -> Result:
    model = it.model
    if model.law not in LAWS:
        return None, f"the law {model.law!r} is not foretouch's: identify and predict take it, a session does not"
    try:
        again = make_model(model.law, model.parameters, getattr(model, "map", b""))
    except InputError as error:
        return False, str(error)
    return again == model, f"law {model.law!r}"


@checked(
    "standard errors",
    "standard_errors is None, or has one for each parameter: None where that is undetermined, else finite and >= 0",
)
def _errors(it: Subject) -> Result:
    errors, parameters = it.learnt[0].standard_errors, it.learnt[0].parameters
    if errors is None:
        return True, "it gives none"
    undetermined = [name for name, value in parameters.items() if value is None]
    bad = [
        name
        for name, value in errors.items()
        if value is not None and (name in undetermined or not 0.0 <= value < math.inf)
    ]
    kept = errors.keys() == parameters.keys() and not bad
    return kept, f"of {', '.join(errors)}" + (f"; not {', '.join(bad)}" if bad else "")


@checked("covariance", "unscaled_covariance or covariance, where it has one, is finite and symmetric")
def _covariance(it: Subject) -> Result:
    for name in ("unscaled_covariance", "covariance"):
        given = getattr(it.learnt[0], name, None)
        if given is None or callable(given):
            continue
        matrix = np.asarray(given, dtype=float)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
            return False, f"{name} has the shape {matrix.shape}"
        if not np.isfinite(matrix).all():
            return False, f"{name} is not finite"
        skew = float(np.abs(matrix - matrix.T).max() / max(np.abs(matrix).max(), 1e-300))
        return skew <= 1e-12, f"{name} is symmetric to {skew:.1g}"
    return True, "it gives none"


@checked(
    "nonsense does no harm",
    "samples with NaN, infinities, negative, huge or tiny numbers never raise and leave finite parameters",
)
def _nonsense(it: Subject) -> Result:
    fresh = it.make()
    for depth, velocity, force in itertools.product(NONSENSE, repeat=3):
        fresh.update(ContactSample(0.0, depth, velocity, force, True))
    if fresh.model is None:
        return True, "no model"
    values = fresh.model.parameters
    return all(map(math.isfinite, values)), ", ".join(f"{value:.4g}" for value in values)


@checked("reset forgets", "after reset it knows nothing, and the same samples teach the same again")
def _reset(it: Subject) -> Result:
    estimator = it.make()
    first = _learn(estimator, it.law).parameters
    estimator.reset()
    empty = estimator.model is None and estimator.updates == 0
    same = _learn(estimator, it.law).parameters == first
    return empty and same, f"{'nothing' if empty else 'something'} known; the same taught again: {same}"


@checked("update time", f"half of all updates take at most {1e3 * LONGEST_UPDATE:g} ms")
def _timing(it: Subject) -> Result:
    estimator, recording = it.make(), press(it.law)
    conditioner = Conditioner(surface=SURFACE, force_offset=OFFSET)
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist())
    samples = [conditioner.update(*row) for row in zip(*columns, strict=True)]
    count = len(samples) // 2
    for sample in samples[:count]:
        estimator.update(sample)
    taken = percentile_time(lambda index: estimator.update(samples[count + index]), count // 3, 50.0)
    return taken <= LONGEST_UPDATE, f"{1e3 * taken:.4g} ms"

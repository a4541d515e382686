"""What every estimator keeps to."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import ForetouchError, InputError
from foretouch.identification import Conditioner, ContactSample, Estimator, Identification, Learner, identify
from foretouch.models import (
    LAWS,
    ContactModel,
    HuntCrossley,
    KelvinVoigt,
    QuadraticContact,
    advance,
    make_model,
)
from foretouch.quantities import Recording
from foretouch.session.conformance.finding import Finding, guarded, percentile_time
from foretouch.session.settings import SAMPLE_PERIOD

OWN_LAWS: dict[str, ContactModel] = {
    "kelvin-voigt": KelvinVoigt(600.0, 2.0),
    "quadratic": QuadraticContact(300.0, 4e4, 300.0),
}
"""Laws all of whose presses an estimator of that law learns."""
SOFT = HuntCrossley(3000.0, 300.0, 1.4)
"""Estimators of all other laws learn presses of this one, which every law of the paper can be near to."""
SURFACE, OFFSET, DEEPEST = 0.01, 0.3, 0.01
"""Start of the presses [m], the sensor's force in free air [N], and depth of the presses [m]."""
LEAST_FORCE = 1e-3
"""Less than this [N] is none: a map may have rounding beyond its surface."""
LARGEST_ERROR = 0.1
"""Residual of the learnt law over the force in contact, both as RMS."""
LONGEST_UPDATE = 1e-4
"""Half of all updates take at most this [s]."""
NONSENSE = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e300, 1e-300)


def check_estimator(make: Callable[[], Estimator], *, name: str = "") -> list[Finding]:
    """Check an estimator: it learns, predicts, never raises, forgets, is quick, and its uncertainty is finite.

    An estimator of a law that is not foretouch's learns presses of `SOFT`, then presses of what it has learnt: those it
    has to learn whole.

    Args:
        make: Makes a fresh one.
        name: That it is to have; without one, any.

    Returns:
        One finding a check.

    Raises:
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    try:
        estimator: object = make()
    except ForetouchError:
        raise
    except Exception as error:
        return [Finding("made", False, f"raises {type(error).__name__}: {error}", "it can be made")]
    if not isinstance(estimator, Estimator):
        return [Finding("made", False, f"a {type(estimator).__name__}", "it is a foretouch.identification.Estimator")]
    learnt = functools.cache(lambda: _learnt(make))
    return guarded(
        [
            ("name", lambda: _name(estimator, name)),
            ("knows nothing at first", lambda: _nothing(make())),
            ("free air teaches nothing", lambda: _free_air(make())),
            ("learns its own law", lambda: _learns(learnt()[1])),
            ("its model predicts", lambda: _predicts(learnt()[1].model)),
            ("its model crosses the network", lambda: _crosses(learnt()[1].model)),
            ("standard errors", lambda: _errors(learnt()[0])),
            ("covariance", lambda: _covariance(learnt()[0])),
            ("nonsense does no harm", lambda: _nonsense(make())),
            ("reset forgets", lambda: _reset(make())),
            ("update time", lambda: _timing(make())),
        ]
    )


def press(law: ContactModel, duration: float = 4.0) -> Recording:
    """A second in free air, then presses of two frequencies, out of contact in between, with an offset of the sensor.

    Args:
        law: That gives the force.
        duration: [s], above 2.
    """
    time = np.arange(0.0, duration, SAMPLE_PERIOD)
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


def _learnt(make: Callable[[], Estimator]) -> tuple[Estimator, Identification]:
    """A fresh estimator that has learnt presses of its own law, and what came of it."""
    estimator = make()
    law = OWN_LAWS.get(estimator.model_name, SOFT)
    found = _learn(estimator, law)
    if found.model.law not in LAWS:
        estimator = make()
        found = _learn(estimator, found.model)
    return estimator, found


def _name(estimator: Estimator, name: str) -> Finding:
    own, law = getattr(estimator, "name", None), getattr(estimator, "model_name", None)
    kept = all(isinstance(text, str) and text for text in (own, law)) and (not name or own == name)
    rule = (f"name is {name!r}" if name else "name is a text") + ", model_name is that of its law"
    return Finding("name", kept, f"name = {own!r}, model_name = {law!r}", rule)


def _nothing(estimator: Estimator) -> Finding:
    kept = estimator.model is None and estimator.parameters == {} and estimator.updates == 0
    found = f"model = {type(estimator.model).__name__}, updates = {estimator.updates}"
    return Finding(
        "knows nothing at first", kept, found, "before the first sample: model None, no parameters, updates 0"
    )


def _free_air(estimator: Estimator) -> Finding:
    for index in range(200):
        estimator.update(ContactSample(index * SAMPLE_PERIOD, -0.01, 0.0, 0.0, False))
    kept = estimator.model is None and estimator.updates == 0
    rule = "samples that are not in contact teach nothing"
    return Finding("free air teaches nothing", kept, f"{estimator.updates} updates of 200 samples", rule)


def _learns(found: Identification) -> Finding:
    error = found.residual_rms / found.contact_force_rms
    rule = f"on clean presses of its own law the residual is at most {100.0 * LARGEST_ERROR:g} % of the force"
    return Finding("learns its own law", bool(error <= LARGEST_ERROR), f"{100.0 * error:.4g} %", rule)


def _predicts(model: object) -> Finding:
    rule = "model is a ContactModel, whose force is finite, grows with depth, and is next to nothing outside"
    if not isinstance(model, ContactModel):
        return Finding("its model predicts", False, f"a {type(model).__name__}", rule)
    depth = np.arange(0.0, DEEPEST, 1e-5)
    force = _forces(model, depth, np.full(depth.size, 0.01))
    outside = advance(model, model.initial_state(), -0.01, 0.0, SAMPLE_PERIOD)[1]
    kept = bool(np.isfinite(force).all() and outside <= LEAST_FORCE and 0.0 <= force[100] < force[-1])
    found = f"{force[100]:.4g} N at 1 mm, {force[-1]:.4g} N at {1e3 * DEEPEST:g} mm, {outside:.4g} N outside"
    return Finding("its model predicts", kept, found, rule)


def _crosses(model: ContactModel) -> Finding:
    check, rule = (
        "its model crosses the network",
        "a model of a law of foretouch.models.LAWS, made again from its numbers",
    )
    if model.law not in LAWS:
        why = f"the law {model.law!r} is not foretouch's: identify and predict take it, a session does not"
        return Finding(check, None, why, rule)
    try:
        again = make_model(model.law, model.parameters, getattr(model, "map", b""))
    except InputError as error:
        return Finding(check, False, str(error), rule)
    return Finding(check, again == model, f"law {model.law!r}", rule)


def _errors(estimator: Estimator) -> Finding:
    errors, parameters = estimator.standard_errors, estimator.parameters
    rule = (
        "standard_errors is None, or has one for each parameter: None where that is undetermined, else finite and >= 0"
    )
    if errors is None:
        return Finding("standard errors", True, "it gives none", rule)
    undetermined = [name for name, value in parameters.items() if value is None]
    bad = [
        name
        for name, value in errors.items()
        if value is not None and (name in undetermined or not 0.0 <= value < math.inf)
    ]
    kept = errors.keys() == parameters.keys() and not bad
    return Finding(
        "standard errors", kept, f"of {', '.join(errors)}" + (f"; not {', '.join(bad)}" if bad else ""), rule
    )


def _covariance(estimator: Estimator) -> Finding:
    rule = "unscaled_covariance or covariance, where it has one, is finite and symmetric"
    for name in ("unscaled_covariance", "covariance"):
        given = getattr(estimator, name, None)
        if given is None or callable(given):
            continue
        matrix = np.asarray(given, dtype=float)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
            return Finding("covariance", False, f"{name} has the shape {matrix.shape}", rule)
        if not np.isfinite(matrix).all():
            return Finding("covariance", False, f"{name} is not finite", rule)
        skew = float(np.abs(matrix - matrix.T).max() / max(np.abs(matrix).max(), 1e-300))
        return Finding("covariance", skew <= 1e-12, f"{name} is symmetric to {skew:.1g}", rule)
    return Finding("covariance", True, "it gives none", rule)


def _nonsense(estimator: Estimator) -> Finding:
    for depth, velocity, force in itertools.product(NONSENSE, repeat=3):
        estimator.update(ContactSample(0.0, depth, velocity, force, True))
    model = estimator.model
    kept = model is None or all(map(math.isfinite, model.parameters))
    rule = "samples with NaN, infinities, negative, huge or tiny numbers never raise and leave finite parameters"
    found = "no model" if model is None else ", ".join(f"{value:.4g}" for value in model.parameters)
    return Finding("nonsense does no harm", kept, found, rule)


def _reset(estimator: Estimator) -> Finding:
    law = OWN_LAWS.get(estimator.model_name, SOFT)
    first = _learn(estimator, law).parameters
    estimator.reset()
    empty = estimator.model is None and estimator.updates == 0
    again = _learn(estimator, law).parameters
    rule = "after reset it knows nothing, and the same samples teach the same again"
    found = f"{'nothing' if empty else 'something'} known; the same taught again: {again == first}"
    return Finding("reset forgets", empty and again == first, found, rule)


def _timing(estimator: Estimator) -> Finding:
    recording = press(OWN_LAWS.get(estimator.model_name, SOFT), duration=4.0)
    conditioner = Conditioner(surface=SURFACE, force_offset=OFFSET)
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist())
    samples = [conditioner.update(*row) for row in zip(*columns, strict=True)]
    count = len(samples) // 2
    for sample in samples[:count]:
        estimator.update(sample)
    taken = percentile_time(lambda index: estimator.update(samples[count + index]), count // 3, 50.0, rounds=3)
    rule = f"half of all updates take at most {1e3 * LONGEST_UPDATE:g} ms"
    return Finding("update time", taken <= LONGEST_UPDATE, f"{1e3 * taken:.4g} ms", rule)

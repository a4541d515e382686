"""Errors of an estimate where the truth is known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foretouch.identification import LearntModel
from foretouch.models import ContactModel, HuntCrossley, KelvinVoigt, MemorylessLaw, MotionFilter, advance
from foretouch.quantities import Array, ByValue, Flags, Recording
from foretouch.report import delayed_force

LEARNING_TIME: Final = 0.1  # Time granted for learning a changed law, beyond the delay [s]
CONVERGED_SPAN: Final = 0.5  # Time over which a converged estimate predicts the force [s]
CONVERGED_ERROR: Final = 0.10  # Largest error of this prediction, as a ratio to the true force
CONVERGED_STEP: Final = 0.02  # Time between the moments at which convergence is tested [s]
CONVERGED_SAMPLES: Final = 100  # Number of samples of the span that are examined

HOLDS: Final[dict[str, tuple[str, ...]]] = {
    "kelvin-voigt": ("kelvin-voigt", "threshold-switching", "continuous-switching"),
    "hunt-crossley": ("hunt-crossley", "threshold-switching", "continuous-switching"),
    "continuous-switching": ("continuous-switching",),
}
"""Laws that can be the true one, for each true law: only their numbers can be compared with it."""


@dataclass(frozen=True, eq=False)
class Truth(ByValue):
    """The truth behind a simulated recording.

    Attributes:
        depth: Depth of the probe below the surface [m], shape (n,).
        force: On the probe [N], without noise and offset, shape (n,).
        law: The law that holds at the last sample, None where the material is none of the laws.
        changes: Times of sudden changes of the law [s].
    """

    depth: Array
    force: Array
    law: MemorylessLaw | None
    changes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Convergence:
    """The time that an estimate took after a change.

    Attributes:
        event_s: Time of the first sample in contact after the change [s]; the first touch counts as one.
        convergence_s: Time from there until the estimate was right [s]; None if it never was, before the next change.
    """

    event_s: float
    convergence_s: float | None


@dataclass(frozen=True)
class ParameterError:
    """One number of an estimated law beside the true one.

    Attributes:
        estimated: Estimated value; None where it is undetermined.
        true: True value, at the last sample.
        error: Estimated less true, as a ratio to the true one for `stiffness` and `damping` [%], else as it is.
    """

    estimated: float | None
    true: float
    error: float | None


def unforeseeable(time: Array, depth: Array, delay: float, changes: Sequence[float] = ()) -> Flags:
    r"""Samples whose force nothing before t - delay could predict, with any estimator.

    Those are, from the truth,

    - depths that were never reached before:
      :math:`x(t) > \max_{\tau \le t - d} x(\tau)`, inside the material;
    - from a sudden change of the law until the delay and 0.1 s for learning have passed since it could be felt first:
      at the first sample in contact from the change on.

    Time [s], increasing, true depth [m] and flags have the shape (n,). The delay d of the forces [s] is 0 or more, else
    a SettingError; the changes are the times at which the law changed without notice [s].
    """
    reached = np.nan_to_num(delayed_force(time, np.maximum.accumulate(np.maximum(depth, 0.0)), delay), nan=0.0)
    flags: Flags = (depth > 0.0) & (depth > reached)
    for change in changes:
        felt = _felt(time, depth, change)
        flags |= (time >= change) & (time < felt + delay + LEARNING_TIME)
    return flags


def convergence(recording: Recording, truth: Truth, learnt: Sequence[LearntModel]) -> tuple[Convergence, ...]:
    """Time until what was learnt is right, after the first touch and after each change.

    A model has converged if it, and no newer one, gives the true force of the recorded motion over the next half second
    with an RMS error of at most 10 % of that force's RMS, over the samples in contact. Every fiftieth of a second is
    tried, while the half second ends before the next change. There is one model after each sample of the recording,
    and one result for the first touch and for each change that is felt.
    """
    time, position = recording.time, recording.position
    velocity = (
        MotionFilter().run(time.tolist(), position.tolist()) if recording.velocity is None else recording.velocity
    )
    begins = [_felt(time, truth.depth, change) for change in (-math.inf, *truth.changes)]
    events = []
    for begin, end in zip(begins, (*truth.changes, float(time[-1])), strict=True):
        if not begin < end:
            continue  # never felt, or not before the next change
        settled: float | None = None
        for first in np.searchsorted(time, np.arange(begin, end - CONVERGED_SPAN, CONVERGED_STEP)).tolist():
            last = int(np.searchsorted(time, time[first] + CONVERGED_SPAN))
            span = slice(first + 1, last, max(1, (last - first) // CONVERGED_SAMPLES))
            columns = (time[span], position[span], velocity[span], truth.force[span], truth.depth[span] > 0.0)
            if _foretells(learnt[first], float(time[first]), *columns):
                settled = float(time[first]) - begin
                break
        events.append(Convergence(begin, settled))
    return tuple(events)


def _foretells(
    learnt: LearntModel, now: float, time: Array, position: Array, velocity: Array, force: Array, inside: Flags
) -> bool:
    """Whether a model gives the true force along a motion that comes after it."""
    if learnt.model is None or not inside.any():
        return False
    state, errors = learnt.state, []
    samples = zip(time.tolist(), (position - learnt.surface).tolist(), velocity.tolist(), force.tolist(), strict=True)
    for later, depth, speed, true in samples:
        state, given, _ = advance(learnt.model, state, depth, speed, later - now)
        errors.append(given - true)
        now = later
    error = np.square(np.array(errors)[inside]).sum()
    return bool(error <= CONVERGED_ERROR**2 * np.square(force[inside]).sum())


def parameter_errors(
    model_name: str, parameters: Mapping[str, float | None], truth: Truth
) -> dict[str, ParameterError]:
    """Errors of a law's numbers, by name; empty where the law that is estimated cannot be the true one.

    Its name is as on the command line; its parameters are None where undetermined.
    """
    law = truth.law
    if law is None or model_name not in HOLDS[law.law]:
        return {}
    k, damping, n, alpha = law.general_form
    true = {"stiffness": k, "damping": damping, "exponent": n, "switching": alpha, "s": n + alpha, "ln_k": math.log(k)}
    if isinstance(law, HuntCrossley | KelvinVoigt) and model_name == "threshold-switching":
        true = dict(zip(law.parameter_names, law.parameters, strict=True))
    errors = {}
    for name, value in parameters.items():
        if name in true:
            scale = 0.01 * true[name] if name in ("stiffness", "damping") else 1.0
            error = None if value is None or not scale > 0.0 else (value - true[name]) / scale
            errors[name] = ParameterError(value, true[name], error)
    return errors


def local_stiffness(model: ContactModel, depth: float) -> float:
    """Slope of a resting, untouched law's force over depth [N/m] at a positive depth [m].

    Laws of different exponents can be compared by it.
    """
    step = 1e-3 * depth
    forces = [advance(model, model.initial_state(), depth + side * step, 0.0, 1e-3)[1] for side in (-1.0, 1.0)]
    return (forces[1] - forces[0]) / (2.0 * step)


def _felt(time: Array, depth: Array, change: float) -> float:
    """Time of the first sample in contact at or after a change [s], inf if there is none."""
    samples = np.flatnonzero((time >= change) & (depth > 0.0))
    return float(time[samples[0]]) if samples.size else math.inf

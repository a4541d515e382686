"""What the paper says that its estimator finds in Figs. 7 and 8, each as one number and a limit, and as it was found.

Threshold switching is tried on the same presses.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Literal, NamedTuple

import numpy as np

from foretouch.comparison.cases import KELVIN_VOIGT
from foretouch.identification import ThresholdSwitching
from foretouch.identification.linear.estimators import by_distance
from foretouch.identification.linear.recursion import PerturbationForm, Recursion
from foretouch.models import ContactModel, KelvinVoigt
from foretouch.quantities import Array, Flags
from foretouch.reproduction.presses import PERIOD, STEPS, Press, Trace, forces_of, true_parameters

THRESHOLD = 4000.0  # threshold of the paper [N/m]
FEWEST = 20  # smallest number of samples with a law, as in the estimators


def errors_of_threshold(pressed: Press, estimator: ThresholdSwitching) -> tuple[Array, Flags]:
    """A fresh estimator at each sample: error of the force [N], NaN before there is a law; whether it is Kelvin-Voigt.

    The law is the one learnt from that sample too.
    """
    models: list[ContactModel | None] = []
    for sample in pressed.samples:
        estimator.update(sample)
        models.append(estimator.model)
    force = forces_of(tuple(models), pressed.depth, pressed.velocity)
    return np.abs(force - pressed.true_force), np.array([isinstance(model, KelvinVoigt) for model in models])


def errors_of_fprls_threshold(pressed: Press, rate: float, form: PerturbationForm = "add") -> tuple[Array, Flags]:
    r"""The same where both laws are learnt by the paper's own recursion (20), each tested on its own error.

    .. math::
        F = K x + B v, \quad e = F - \hat F \;[\mathrm{N}]; \qquad
        \ln F = \ln k + n \ln x + \tfrac{\lambda}{k} v, \quad e = \ln F - \ln \hat F

    Both forget by the distance moved, with the rate rho [1/m], and enlarge P after the gain of a sample with
    :math:`e^2 \ge 1`: for Kelvin-Voigt that is an error of a newton, for Hunt-Crossley a factor of e. Nothing bounds
    the damping. The form says whether delta I is added to P, as printed, or takes its place.
    """
    forgetting, begin = by_distance(rate), 1e6
    stiff, soft = (Recursion(np.zeros(size), begin, sensitivity=1.0, perturbation=begin, form=form) for size in (2, 3))
    force = np.full(pressed.time.size, np.nan)
    chosen = np.zeros(pressed.time.size, np.bool_)
    last = float(pressed.depth[0])
    for index, (_, depth, velocity, felt, _) in enumerate(pressed.samples):
        factor, last = forgetting.factor(depth - last), depth
        stiff.learn((depth, velocity), felt, factor)
        soft.learn((1.0, math.log(depth), velocity), math.log(felt), factor)
        if index + 1 < FEWEST:
            continue
        stiffness, damping = stiff.theta.tolist()
        log_k, exponent, relative_damping = soft.theta.tolist()
        chosen[index] = stiffness >= THRESHOLD
        force[index] = (
            stiffness * depth + damping * velocity
            if chosen[index]
            else math.exp(log_k) * depth**exponent * (1.0 + relative_damping * velocity)
        )
    return np.abs(force - pressed.true_force), chosen


SETTLED = 0.05  # largest relative error of k, and distance of s from its own true value, at which both count as found
FOUND = 20  # iteration at which the paper has k and s
SMALL_B2 = 0.02  # b2 within this of 0 [s] counts as zero: a quarter of the B / K of <1>
RATIO = KELVIN_VOIGT.damping / KELVIN_VOIGT.stiffness  # B / K of <1> [s]


class Answer(NamedTuple):
    """One question, measured in words with units, and as a value: smaller is nearer to the paper, inf is never."""

    value: float
    text: str


class Question(NamedTuple):
    """A claim of the paper with the number that decides it."""

    claim: str  # the claim in short
    paper: str  # the paper's number or words
    rule: str  # what counts as holding
    limit: float  # greatest value at which it holds
    material: str  # material that it needs
    measure: Callable[[Press, Trace], Answer]  # from its press and what the estimator found

    def holds(self, answer: Answer) -> bool:
        """Whether the answer is the paper's."""
        return answer.value <= self.limit


def settled_at(right: Flags) -> float:
    """Count of the first sample from which on all are right, from 1; inf where the last is wrong."""
    if not right[-1]:
        return float("inf")
    wrong = np.nonzero(~right)[0]
    return float(wrong[-1] + 2) if wrong.size else 1.0


def _found(pressed: Press, trace: Trace) -> tuple[Flags, Array, Array]:
    """Where k and s are found; relative error of k; error of s."""
    k = np.array([law.general_form[0] for law in pressed.laws])
    s = np.array([sum(law.general_form[2:]) for law in pressed.laws])
    with np.errstate(over="ignore"):
        k_error, s_error = trace.k / k - 1.0, trace.s - s
    return (np.abs(k_error) <= SETTLED) & (np.abs(s_error) <= SETTLED), k_error, s_error


def _pure(pressed: Press, trace: Trace) -> Answer:
    right, k_error, s_error = _found(pressed, trace)
    value, at = settled_at(right), FOUND - 1
    return Answer(value, f"{_iteration(value)}; at the 20th k {100.0 * k_error[at]:+.2g} %, s {s_error[at]:+.2g}")


def _b1_of_kelvin_voigt(pressed: Press, trace: Trace) -> Answer:
    b1 = trace.b1[FOUND - 1 :]
    return Answer(float(np.abs(b1).max()), f"{b1.min():.3g} to {b1.max():.3g} s/m")


def _b2_of_kelvin_voigt(pressed: Press, trace: Trace) -> Answer:
    b2 = trace.b2[-50:]
    error = float(np.abs(b2 / RATIO - 1.0).max())
    return Answer(error, f"{b2.min():.4f} to {b2.max():.4f} s (within {100.0 * error:.2g} %)")


def _b2_of_hunt_crossley(pressed: Press, trace: Trace) -> Answer:
    value, b2 = settled_at(np.abs(trace.b2) <= SMALL_B2), trace.b2
    when = _iteration(value).replace("found", "zero")
    return Answer(value, f"{when}; at the 10th {b2[9]:.2g} s, at the 250th {b2[-1]:.1g} s")


def _following(pressed: Press, trace: Trace) -> Answer:
    _, k_error, s_error = _found(pressed, trace)
    worst, s_worst = float(np.abs(k_error[FOUND:]).max()), float(np.abs(s_error[FOUND:]).max())
    middle = float(np.median(np.abs(k_error[FOUND:])))
    text = f"k wrong by {100 * worst:.3g} % at worst, {100 * middle:.3g} % in the median; s by {s_worst:.2g}"
    return Answer(worst, text)


def _arriving(pressed: Press, trace: Trace) -> Answer:
    _, k_error, _ = _found(pressed, trace)
    end = f"k = {trace.k[-1]:.4g}, s = {trace.s[-1]:.3f}, b1 = {trace.b1[-1]:.3g}, b2 = {trace.b2[-1]:.3g} at the end"
    return Answer(float(abs(k_error[-1])), end)


def _segment(number: int) -> slice:
    """Samples of the material after a step, the first number 0."""
    ends = [*(round(step / PERIOD) - 1 for step in STEPS), None]
    return slice(ends[number], ends[number + 1])


def _recovery(number: int, pressed: Press, trace: Trace) -> Answer:
    result, part = _found(pressed, trace), _segment(number)
    right, k_error, s_error = result[0][part], result[1][part], result[2][part]
    value = settled_at(right)
    return Answer(
        value,
        f"{_iteration(value)}, counted from the change; 20th: k {100 * k_error[19]:+.2g} %, s {s_error[19]:+.2g}; "
        f"last: k {100 * k_error[-1]:+.2g} %, s {s_error[-1]:+.2g}",
    )


def _coefficient(name: Literal["b1", "b2"], target: float, pressed: Press, trace: Trace) -> Answer:
    values = getattr(trace, name)[_segment(0)][-20:]
    true = true_parameters(pressed)[2 if name == "b1" else 3][_segment(0)][-1]
    return Answer(
        float(np.abs(values - target).max()),
        f"{values.min():.3g} to {values.max():.3g} over the last 20 before the second change (true law, (17) fitted: "
        f"{true:.3g})",
    )


def _force_after_steps(pressed: Press, trace: Trace) -> Answer:
    error = np.abs(trace.force - pressed.true_force)
    calm = np.ones(error.size, dtype=np.bool_)
    for start in (0, _segment(0).start, _segment(1).start):
        calm[start : start + FOUND] = False
    value = float(error[calm].max())
    text = f"at most {value:.2g} N from the 20th sample of each material on, {error[FOUND:].max():.3g} N at a step"
    return Answer(value, text)


@lru_cache(maxsize=8)
def _usual_threshold(pressed: Press) -> Array:
    return errors_of_threshold(pressed, ThresholdSwitching())[0]


def _better(pressed: Press, trace: Trace) -> Answer:
    error, other = np.abs(trace.force - pressed.true_force), _usual_threshold(pressed)
    there = np.isfinite(other)
    fraction = float(np.mean(error[there] < other[there]))
    own, others = (float(np.sqrt(np.mean(np.square(values[there])))) for values in (error, other))
    return Answer(1.0 - fraction, f"at {100.0 * fraction:.1f} % of the samples; RMS {own:.3g} against {others:.3g} N")


def _iteration(value: float) -> str:
    return f"found from the {ordinal(int(value))} on" if np.isfinite(value) else "never found"


def ordinal(number: int) -> str:
    """1st, 2nd, 3rd, 4th ..."""
    ending = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


_FOUND_RULE = f"k within {100 * SETTLED:g} % and s within {SETTLED:g} of the set values"

QUESTIONS: dict[str, Question] = {
    "kvm k, s": Question(
        "k and s of Kelvin-Voigt <1> are found at the 20th iteration",
        "at the 20th",
        f"from the 20th on {_FOUND_RULE}",
        *(FOUND, "kelvin-voigt", _pure),
    ),
    "hcm k, s": Question(
        "k and s of Hunt-Crossley <2> are found rapidly, at the 20th iteration",
        "rapidly",
        f"from the 20th on {_FOUND_RULE}",
        *(FOUND, "hunt-crossley", _pure),
    ),
    "kvm b1": Question(
        "b1 of Kelvin-Voigt is not zero but within (-1, 1)",
        "within (-1, 1)",
        "|b1| below 1 s/m from the 20th on",
        *(1.0, "kelvin-voigt", _b1_of_kelvin_voigt),
    ),
    "kvm b2": Question(
        "b2 of Kelvin-Voigt goes to B / K",
        "0.083",
        "the last 50 within 5 % of B / K = 0.0833 s",
        *(0.05, "kelvin-voigt", _b2_of_kelvin_voigt),
    ),
    "hcm b2": Question(
        "b2 of Hunt-Crossley is zero at the 10th iteration",
        "0 at the 10th",
        "from the 10th on |b2| below 0.02 s, a quarter of the B / K of <1>",
        *(10.0, "hunt-crossley", _b2_of_hunt_crossley),
    ),
    "follows": Question(
        "Parameters follow the continuous change from Hunt-Crossley to Kelvin-Voigt",
        "estimated parameters follow",
        "k within 10 % from the 21st on",
        *(0.1, "continuous", _following),
    ),
    "arrives": Question(
        "Parameters alter between the two limit values: the continuous change ends at Kelvin-Voigt",
        "k = 6000, s = 1, b1 = 0, b2 = 0.083",
        "the last k within 10 %",
        *(0.1, "continuous", _arriving),
    ),
    "better": Question(
        "Continuous switching has a smaller force error than threshold switching at every time",
        "at every time",
        "at all samples from the 20th on, threshold switching by least squares without forgetting",
        *(0.0, "continuous", _better),
    ),
    "step 1": Question(
        "k and s recover rapidly after the first sudden change",
        "rapidly",
        f"from the 20th after it on {_FOUND_RULE}",
        *(FOUND, "steps", partial(_recovery, 0)),
    ),
    "step 2": Question(
        "k and s recover rapidly after the second sudden change",
        "rapidly",
        f"from the 20th after it on {_FOUND_RULE}",
        *(FOUND, "steps", partial(_recovery, 1)),
    ),
    "step b1": Question(
        "b1 is near 0.5 after the first sudden change",
        "0.5 (its own Table 1 gives a1 lambda / k = 3.44 * 1000 / 4500 = 0.76)",
        "within 0.25 of 0.5 s/m over the last 20 before the second change",
        *(0.25, "steps", partial(_coefficient, "b1", 0.5)),
    ),
    "step b2": Question(
        "b2 is near 0 after the first sudden change",
        "0 (its own Table 1 gives a2 lambda / k = 0.067 * 1000 / 4500 = 0.015)",
        "|b2| below 0.02 s over the last 20 before the second change",
        *(SMALL_B2, "steps", partial(_coefficient, "b2", 0.0)),
    ),
    "step force": Question(
        "The force error with sudden changes is small enough to be ignored",
        "small enough to be ignored",
        "below 0.1 N from the 20th sample of each material on",
        *(0.1, "steps", _force_after_steps),
    ),
}
"""The questions by a short name."""

"""What the paper leaves open about its estimator, every combination of it, and which one each claim needs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

from foretouch.identification import FPRLS, FPRLSOptions
from foretouch.identification.linear.options import DepthUnit
from foretouch.identification.linear.recursion import ErrorUnit, PerturbationForm, PerturbationMoment
from foretouch.reproduction.presses import Press, follow, press
from foretouch.reproduction.questions.tried import QUESTIONS, Answer, Runs
from foretouch.reproduction.section import Claim, Verdict

SMALL_STIFFNESS = 100.0
"""theta_0 of a small k [N/m^s], with s = 1."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One combination; the defaults are (20) as printed in SI units, on ideal data.

    Attributes:
        unit: Of depth in the regressors.
        error: What the self-perturbing test sees.
        moment: Whether P is enlarged before or after the gain of the sample that trips the test.
        form: Whether delta I is added to P or takes its place.
        rho: Of the forgetting factor [1/m].
        initial: k of theta_0 [N/m^s]: 1 is theta_0 = 0, more comes with s = 1.
        covariance: P_0 is this times I.
        noise: Of the force [N], standard deviation.
        velocity: Whether it is exact or the difference of two depths.
    """

    unit: DepthUnit = "m"
    error: ErrorUnit = "log"
    moment: PerturbationMoment = "after"
    form: PerturbationForm = "add"
    rho: float = 1000.0
    initial: float = 1.0
    covariance: float = 1e6
    noise: float = 0.0
    velocity: str = "exact"

    @property
    def options(self) -> FPRLSOptions:
        """For the estimator."""
        return FPRLSOptions(
            depth_unit=self.unit,
            perturbation_error=self.error,
            perturbation_moment=self.moment,
            perturbation_form=self.form,
            forgetting_rate=self.rho,
            initial_parameters=(math.log(self.initial), 0.0 if self.initial == 1.0 else 1.0, 0.0, 0.0),
            initial_covariance=self.covariance,
        )

    @property
    def departures(self) -> dict[str, Any]:
        """What differs from the printed one."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value != getattr(PRINTED, name)}

    def __str__(self) -> str:
        return "; ".join(WORDS[name].format(value) for name, value in self.departures.items()) or "as printed"


PRINTED = Choice()
"""All choices as printed."""

PRINTED_WORDS = (
    "FPRLS (20) as printed at 10 Hz: metres, test on the error of ln F, delta I added to P after the gain, "
    "P0 = delta = 10^6, rho = 1000 / m, theta_0 = 0, no noise, exact velocity"
)

WORDS = {
    "unit": "depth in {}",
    "error": "test on the error in {}s",
    "moment": "P enlarged {} the gain",
    "form": "P {} to delta I",
    "rho": "rho = {:g} / m",
    "initial": "theta_0 with k = {:g}, s = 1",
    "covariance": "P0 = {:g} I",
    "noise": "force noise {:g} N",
    "velocity": "{} velocity",
}

VALUES: dict[str, tuple[Any, ...]] = {
    "unit": ("m", "mm"),
    "error": ("log", "newton"),
    "moment": ("after", "before"),
    "form": ("add", "reset"),
    "rho": (0.0, 100.0, 1000.0, 10000.0),
    "initial": (1.0, SMALL_STIFFNESS),
    "covariance": (1e2, 1e4, 1e6, 1e8),
    "noise": (0.0, 0.02),
    "velocity": ("exact", "differenced"),
}
"""What is tried of each; noise and differenced velocity not together."""

BEST: dict[str, Choice] = {
    "kvm k, s": Choice(covariance=1e8),
    "hcm k, s": Choice(covariance=1e8),
    "hcm b2": Choice(initial=SMALL_STIFFNESS, covariance=1e8),
    "step 1": Choice(moment="before"),
    "step 2": Choice(moment="before"),
    "step b1": Choice(moment="before"),
    "step b2": Choice(unit="mm", moment="before", rho=1e4),
    "step force": Choice(moment="before"),
}
"""Of the claims that do not hold as printed, the combination with the fewest departures that makes each hold, and of
these the one that is nearest to the paper's number; the search of the section `choices` finds them."""

NEAREST: dict[str, Choice] = {
    "follows": Choice("m", "newton", "before", "reset", 1e4, SMALL_STIFFNESS, 1e2, 0.0, "differenced"),
    "arrives": Choice("m", "newton", "after", "reset", 0.0, SMALL_STIFFNESS, 1e6, 0.0, "differenced"),
    "better": Choice(error="newton", rho=1e4, covariance=1e2),
}
"""Of the claims that no combination makes hold, the one that comes nearest."""


def combinations() -> Iterator[Choice]:
    """All of them."""
    for values in itertools.product(*VALUES.values()):
        choice = Choice(*values)
        if choice.noise == 0.0 or choice.velocity == "exact":
            yield choice


@lru_cache(maxsize=32)
def _press(material: str, noise: float, velocity: str) -> Press:
    return press(material, noise=noise, differenced=velocity == "differenced")


def runs_of(choice: Choice, materials: Iterable[str]) -> Runs:
    """Press materials and estimate each from scratch."""
    estimator = FPRLS(choice.options)
    runs = {}
    for material in materials:
        pressed = _press(material, choice.noise, choice.velocity)
        estimator.reset()
        runs[material] = (pressed, follow(estimator, pressed))
    return runs


def answer(name: str, choice: Choice) -> Answer:
    """One question under one choice."""
    question = QUESTIONS[name]
    return question.measure(runs_of(choice, question.materials))


def claims_of(names: Iterable[str]) -> tuple[Claim, ...]:
    """Questions as claims: as printed, and where that does not give it, under the choice that comes nearest."""
    return tuple(map(_claim, names))


def _claim(name: str) -> Claim:
    question, printed = QUESTIONS[name], answer(name, PRINTED)
    setting = f"{PRINTED_WORDS}. Holds if {question.rule}"
    if question.holds(printed):
        return Claim(question.claim, question.paper, printed.text, "holds", setting)
    choice = BEST.get(name, NEAREST.get(name, PRINTED))
    best = answer(name, choice)
    verdict: Verdict = "holds under stated choice" if question.holds(best) else "does not hold"
    if verdict == "does not hold":
        setting += f"; none of {sum(1 for _ in combinations())} combinations of the open choices gives it"
        return Claim(
            question.claim, question.paper, f"{printed.text}; nearest, with {choice}: {best.text}", verdict, setting
        )
    return Claim(
        question.claim, question.paper, f"{best.text}; as printed: {printed.text}", verdict, f"{choice}. {setting}"
    )

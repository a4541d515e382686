"""Fig. 7c: a material that changes suddenly, twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import FPRLS
from foretouch.report import COLOURS
from foretouch.reproduction.choices import BEST, PRINTED, PRINTED_WORDS, Choice, claims_of, runs_of
from foretouch.reproduction.estimates import Curve, parameter_figure, parameter_table
from foretouch.reproduction.presses import PERIOD, STEPS, Trace, press, true_parameters
from foretouch.reproduction.section import Claim, Section

NAMES = ("step 1", "step 2", "step b1", "step b2", "step force")

Array = NDArray[np.float64]


def make() -> Section:
    """As printed and with P enlarged before the gain, beside the truth."""
    choice = BEST["step 1"]
    pressed, printed = runs_of(PRINTED, ("steps",))["steps"]
    _, best = runs_of(choice, ("steps",))["steps"]
    truth = true_parameters(pressed)
    errors = log_errors(pressed.force, best)
    jumps = [pressed.force[step - 1] - best.ahead[step - 1] for step in (FIRST, SECOND)]
    text = (
        f"To an estimate that is right, the error of ln F is {errors[FIRST - 1]:.2f} at the first change and "
        f"{errors[SECOND - 1]:.2f} at the second ({jumps[0]:+.0f} N and {jumps[1]:+.0f} N), with a threshold of 1: the "
        "self-perturbing test just trips; a change by less than a factor of e would go unnoticed. What decides is when "
        "P is enlarged. After the gain of the sample, as (20) prints it, that sample has been taken in with the old, "
        "small P: the parameters go far along the directions that the old material had left undetermined, b1 and "
        "b2, and one slow stroke does not bring them back. Enlarged before the gain, the same algorithm recovers at "
        f"once. b1 is then near 0.5 because nothing moves it: it was {best.b1[FIRST - 2]:.2f} before the change, and "
        f"the material's own is {truth[2][FIRST]:.2f}."
    )
    curves = [
        Curve("true, linearised", truth, "black", "--", 1.2),
        Curve.of("as printed", printed, COLOURS[0]),
        Curve.of(f"{choice}", best, COLOURS[1]),
    ]
    figure = parameter_figure(curves, ((0.0, 9000.0), (0.6, 2.2), (-3.0, 3.0), (-0.3, 0.3)))
    data = {"printed": parameter_table(printed, truth), "best": parameter_table(best, truth)}
    claims = (*claims_of(NAMES), _covariance_claim())
    return Section("fig7c", "Fig. 7c: sudden changes of the material", text, figure, data, claims)


FIRST, SECOND = (round(step / PERIOD) for step in STEPS)
"""Iterations of the changes."""


def log_errors(force: Array, trace: Trace) -> Array:
    """What the self-perturbing test sees: ln F less the estimate from before the sample; NaN at the first."""
    return np.asarray(np.log(force) - np.log(trace.ahead))


def covariance_at_steps(choice: Choice) -> list[float]:
    """How far P is from delta I after each change: the largest entry of P - delta I, in delta."""
    estimator, apart = FPRLS(choice.options), []
    for iteration, sample in enumerate(press("steps").samples, 1):
        estimator.update(sample)
        if iteration in (FIRST, SECOND):
            delta = choice.options.perturbation
            apart.append(float(np.abs(estimator.unscaled_covariance / delta - np.eye(4)).max()))
    return apart


def _covariance_claim() -> Claim:
    """P back to 10^6 I."""
    printed, reset = covariance_at_steps(PRINTED), covariance_at_steps(replace(PRINTED, form="reset"))
    before = covariance_at_steps(replace(PRINTED, form="reset", moment="before"))

    def words(values: list[float]) -> str:
        return " and ".join(f"{100.0 * value:.2g} %" for value in values)

    within = 1e-3
    return Claim(
        "P is back to 10^6 I after a sudden change",
        "returns to 10^6 I as set at the beginning",
        f"largest entry of P - 10^6 I, of 10^6, after the two changes: reset {words(reset)}; as printed (10^6 I is "
        f"added) {words(printed)}; reset before the gain, which takes one sample away at once, {words(before)}",
        "holds" if max(printed) <= within else "holds under stated choice" if max(reset) <= within else "does not hold",
        f"P reset to delta I after the gain. {PRINTED_WORDS}. Holds if within 0.1 %",
    )

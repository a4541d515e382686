"""Threshold switching on one of the presses of Figs. 7 and 8."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import SwitchingOptions, ThresholdSwitching
from foretouch.identification.linear.estimators import by_distance
from foretouch.identification.linear.recursion import PerturbationForm, Recursion
from foretouch.models import ContactModel, KelvinVoigt
from foretouch.reproduction.presses import Press, forces_of

__all__ = ["THRESHOLD", "errors_of_fprls_threshold", "errors_of_threshold"]

Array = NDArray[np.float64]

THRESHOLD = 4000.0
"""Of the paper [N/m]."""

FEWEST = 20
"""There is no law from fewer samples, as in the estimators."""


def errors_of_threshold(pressed: Press, options: SwitchingOptions | None = None) -> tuple[Array, NDArray[np.bool_]]:
    """Of threshold switching at each sample: error of the force [N], NaN before there is a law; whether Kelvin-Voigt.

    The law is the one learnt from that sample too.
    """
    estimator = ThresholdSwitching(options)
    models: list[ContactModel | None] = []
    for sample in pressed.samples:
        estimator.update(sample)
        models.append(estimator.model)
    force = forces_of(tuple(models), pressed.depth, pressed.velocity)
    return np.abs(force - pressed.true_force), np.array([isinstance(model, KelvinVoigt) for model in models])


def errors_of_fprls_threshold(
    pressed: Press, rate: float, form: PerturbationForm = "add"
) -> tuple[Array, NDArray[np.bool_]]:
    r"""The same where both laws are learnt by the paper's own recursion (20), each tested on its own error.

    .. math::
        F = K x + B v, \quad e = F - \hat F \;[\mathrm{N}]; \qquad
        \ln F = \ln k + n \ln x + \tfrac{\lambda}{k} v, \quad e = \ln F - \ln \hat F

    Both forget by the distance moved, and enlarge P after the gain of a sample with :math:`e^2 \ge 1`: for
    Kelvin-Voigt that is an error of a newton, for Hunt-Crossley a factor of e. Nothing bounds the damping.

    Args:
        pressed: The press.
        rate: rho of the forgetting factor [1/m].
        form: Whether delta I is added to P, as printed, or takes its place.
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

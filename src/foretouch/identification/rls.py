"""Recursive least squares on the linearised law (18): plain, forgetting, and self-perturbing."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.identification.linearised import Forgetting, FPRLSOptions, LinearisedEstimator

__all__ = ["RLS", "ForgettingRLS", "SelfPerturbingRLS"]

FORGETTING_FACTOR = 0.999
"""Of `ForgettingRLS` at each sample: a memory of 1,000 samples, which is 1 s at 1 kHz."""


class RLS(LinearisedEstimator):
    """Equation (20) with mu = 1 and delta = 0: every sample counts the same for ever.

    After any number of samples it is the least squares solution of all of them and of theta_0, so its standard errors
    mean something as far as the law does: they are those of independent errors, which the misfit of a law is not.

    Args:
        options: As of `FPRLS`; forgetting and perturbation are switched off.
    """

    name: ClassVar[str] = "rls"
    errors_mean_something: ClassVar[bool] = True

    def __init__(self, options: FPRLSOptions | None = None) -> None:
        super().__init__(replace(options or FPRLSOptions(), forgetting_rate=0.0, perturbation=0.0))


class ForgettingRLS(LinearisedEstimator):
    """Equation (20) with a constant mu and delta = 0: what is forgotten is forgotten by samples, so by time.

    Standard errors are those of a memory of 1 / (1 - mu) samples, an upper bound for independent errors.

    Args:
        options: As of `FPRLS`; forgetting by distance and perturbation are switched off.
        forgetting_factor: mu at each sample, above 0 and at most 1.

    Raises:
        SettingError: forgetting_factor out of range.
    """

    name: ClassVar[str] = "rls-forgetting"
    errors_mean_something: ClassVar[bool] = True

    def __init__(self, options: FPRLSOptions | None = None, *, forgetting_factor: float = FORGETTING_FACTOR) -> None:
        require("forgetting_factor", forgetting_factor, above=0.0, at_most=1.0)
        options = replace(options or FPRLSOptions(), forgetting_rate=0.0, perturbation=0.0)
        super().__init__(options, Forgetting(floor=forgetting_factor))


class SelfPerturbingRLS(LinearisedEstimator):
    """Equation (20) with mu = 1: nothing is forgotten until the self-perturbing test trips.

    Args:
        options: As of `FPRLS`; forgetting is switched off.
    """

    name: ClassVar[str] = "rls-self-perturbing"

    def __init__(self, options: FPRLSOptions | None = None) -> None:
        super().__init__(replace(options or FPRLSOptions(), forgetting_rate=0.0))

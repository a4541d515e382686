"""Recursive least squares on the linearised law (18): plain, forgetting, self-perturbing, and the paper's estimator.

The paper's has forgetting and self-perturbation (FPRLS), equation (20); the robust one also has all that mends it on
measured contact.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.identification.linear.linearised import LinearisedEstimator
from foretouch.identification.linear.options import Forgetting, FPRLSOptions, RobustOptions

FORGETTING_FACTOR = 0.999  # Of `ForgettingRLS` at each sample: a memory of 1,000 samples, which is 1 s at 1 kHz


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


def by_distance(rate: float) -> Forgetting:
    """The paper's way to forget, `mu = 0.95 + 0.05 exp(-rho |dx|)`, of a rate rho [1/m]."""
    return Forgetting(0.95, 0.05, rate)


class FPRLS(LinearisedEstimator):
    r"""Identifies (ln k, s, b1, b2) of the linearised law (18) by equation (20), as printed.

    .. math::
        K_{k+1} &= P_k \Phi_{k+1} (\mu + \Phi_{k+1}^T P_k \Phi_{k+1})^{-1} \\
        \hat\theta_{k+1} &= \hat\theta_k + K_{k+1} \hat e_k, \quad
            \hat e_k = \ln F_{k+1} - \Phi_{k+1}^T \hat\theta_k \\
        P_{k+1} &= \tfrac{1}{\mu} (I - K_{k+1} \Phi_{k+1}^T) P_k + \delta\, [\kappa \hat e_k^2 \ge 1]\, I \\
        \Phi &= (1, \ln x, \dot x, \dot x / x), \quad
            \mu = 0.95 + 0.05\, e^{-\rho |x_{k+1} - x_k|}

    What is forgotten is forgotten by distance moved, not by time. At the paper's 10 Hz a step of millimetres takes mu
    near its floor of 0.95, a memory of 20 samples, which is 2 s. At 1 kHz steps are so small that mu is
    `1 - 0.05 rho |dx|`: the memory is then a path of `20 / rho`, 20 mm with the default rho, whatever the rate: one
    press in and out of 10 mm. A position that is held forgets nothing by itself, but an encoder's noise counts as
    path: 5 um RMS at 1 kHz is 5.6 mm a second, and with nothing to learn from, P grows as fast as that is forgotten.

    `standard_errors` is None: P is not scaled by a noise variance, and forgetting and perturbation take its meaning.

    Args:
        options: The choices that the paper leaves open.
    """

    name: ClassVar[str] = "fprls"

    def __init__(self, options: FPRLSOptions | None = None) -> None:
        options = FPRLSOptions() if options is None else options
        super().__init__(options, by_distance(options.forgetting_rate))


ROBUST = RobustOptions(
    gate_force=0.02, gate_depth=3e-4, largest_rate=100.0, weight_force=1.0, scaled=True, covariance_limit=0.1
)
"""All robust options on."""


class RobustFPRLS(LinearisedEstimator):
    """Equation (20) with all of `RobustOptions` on.

    Args:
        options: As of `FPRLS`; its default has `ROBUST`.
    """

    name: ClassVar[str] = "robust-fprls"

    def __init__(self, options: FPRLSOptions | None = None) -> None:
        options = FPRLSOptions(robust=ROBUST) if options is None else options
        super().__init__(options, by_distance(options.forgetting_rate))

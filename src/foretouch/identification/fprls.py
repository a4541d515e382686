"""The paper's estimator: recursive least squares with forgetting and self-perturbation (FPRLS), equation (20)."""

from __future__ import annotations

from typing import ClassVar

from numpy.typing import ArrayLike

from foretouch.identification.linear_runs import LinearRuns
from foretouch.identification.linearised import Forgetting, FPRLSOptions, LinearisedEstimator

__all__ = ["FPRLS", "FPRLSOptions", "by_distance", "forgetting_by_distance", "fprls_many"]


def by_distance(rate: float) -> Forgetting:
    """The paper's way to forget, `mu = 0.95 + 0.05 exp(-rho |dx|)`, of a rate rho [1/m]."""
    return Forgetting(0.95, 0.05, rate)


def forgetting_by_distance(rate: float, depth_change: float) -> float:
    """The paper's mu, `0.95 + 0.05 exp(-rho |dx|)`, of a rate rho [1/m] and a change of depth [m]."""
    return by_distance(rate).factor(depth_change)


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


def fprls_many(
    depth: ArrayLike,
    velocity: ArrayLike,
    force: ArrayLike,
    in_contact: ArrayLike | None = None,
    *,
    options: FPRLSOptions | None = None,
    every: bool = False,
    parallel: bool = False,
) -> LinearRuns:
    r"""Equation (20) over many independent recordings at once, each from theta_0 and P_0.

    `FPRLS(options).run_many`: what `FPRLS(options).run` makes of each column, to the last bit.

    Args:
        depth: Below the surface [m], shape (m, n): m samples of n recordings. Shorter recordings are filled up with
            NaN, which is left out.
        velocity: [m/s], positive while deepening, shape (m, n).
        force: On the probe [N], shape (m, n).
        in_contact: Whether the probe touches, shape (m, n); by default everywhere.
        options: Of all recordings; `FPRLSOptions(robust=ROBUST)` is `RobustFPRLS`.
        every: Whether theta after each sample is wanted too.
        parallel: Whether all cores are used.

    Returns:
        Estimates, covariances and counts by recording.

    Raises:
        SettingError: Arrays that do not fit together.
    """
    return FPRLS(options).run_many(depth, velocity, force, in_contact, every=every, parallel=parallel)

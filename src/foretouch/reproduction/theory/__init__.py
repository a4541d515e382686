"""What the paper derives of its laws: energy that is lost, impacts, linearisation, low damping.

What an impact costs is `energy_loss` and its neighbours in closed form, `integrate_impact` by integration, and
`low_damping_error` between the two; what linearising leaves out is `linearisation_error`.
"""

from foretouch.reproduction.theory.energy_loss import (
    beta_of,
    damping_ratio,
    energy_loss,
    energy_loss_by_quadrature,
    h_of,
    h_of_gamma_functions,
    loss_exponent,
    loss_scale,
    maximum_depth,
    speed_at_depth,
)
from foretouch.reproduction.theory.impact import (
    Impact,
    LowDampingError,
    integrate_impact,
    low_damping_error,
    low_damping_limit,
    low_damping_table,
)
from foretouch.reproduction.theory.linearisation import (
    TABLE_1,
    LinearisationError,
    PolynomialFit,
    fit_polynomial,
    linearisation_error,
    linearise,
    linearised_log_force,
    log_force,
    taylor_error_depth,
    taylor_log_force,
)

__all__ = [
    "TABLE_1",
    "Impact",
    "LinearisationError",
    "LowDampingError",
    "PolynomialFit",
    "beta_of",
    "damping_ratio",
    "energy_loss",
    "energy_loss_by_quadrature",
    "fit_polynomial",
    "h_of",
    "h_of_gamma_functions",
    "integrate_impact",
    "linearisation_error",
    "linearise",
    "linearised_log_force",
    "log_force",
    "loss_exponent",
    "loss_scale",
    "low_damping_error",
    "low_damping_limit",
    "low_damping_table",
    "maximum_depth",
    "speed_at_depth",
    "taylor_error_depth",
    "taylor_log_force",
]

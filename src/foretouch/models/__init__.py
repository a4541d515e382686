"""Contact laws: one set of equations for simulation, identification and rendering, so they cannot disagree.

Beside the laws, the paper's theory of them: what an impact costs (`energy_loss` and its neighbours in closed form,
`integrate_impact` by integration, `low_damping_error` between the two), and what linearising leaves out
(`linearisation_error`).
"""

from foretouch.models.contact_map import ContactMap
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.models.continuous_switching import ContinuousSwitching
from foretouch.models.energy_loss import (
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
from foretouch.models.hunt_crossley import HuntCrossley
from foretouch.models.impact import Impact, integrate_impact
from foretouch.models.kelvin_voigt import KelvinVoigt
from foretouch.models.laws import LAWS, make_model
from foretouch.models.linearisation import (
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
from foretouch.models.linearised import LinearisedContinuousSwitching
from foretouch.models.low_damping import LowDampingError, low_damping_error, low_damping_limit, low_damping_table
from foretouch.models.map_summary import MapSummary, summarise_map
from foretouch.models.material_field import FIELD_DEPTH, MOST_NODES, NODE_SPACING, MaterialField
from foretouch.models.memoryless_law import MemorylessLaw
from foretouch.models.motion import MotionFilter
from foretouch.models.predictor import Predictor
from foretouch.models.quadratic_contact import QuadraticContact
from foretouch.models.threshold_switching import ThresholdSwitching

__all__ = [
    "FIELD_DEPTH",
    "LAWS",
    "MOST_NODES",
    "NODE_SPACING",
    "NO_STATE",
    "TABLE_1",
    "ContactMap",
    "ContactModel",
    "ContactState",
    "ContinuousSwitching",
    "HuntCrossley",
    "Impact",
    "KelvinVoigt",
    "LinearisationError",
    "LinearisedContinuousSwitching",
    "LowDampingError",
    "MapSummary",
    "MaterialField",
    "MemorylessLaw",
    "MotionFilter",
    "PolynomialFit",
    "Predictor",
    "QuadraticContact",
    "ThresholdSwitching",
    "advance",
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
    "make_model",
    "maximum_depth",
    "speed_at_depth",
    "summarise_map",
    "taylor_error_depth",
    "taylor_log_force",
]

"""Which laws can be identified, and by which estimators."""

from __future__ import annotations

from foretouch.errors import UnknownNameError
from foretouch.identification.contact_map import ContactMapBank
from foretouch.identification.estimator import Estimator
from foretouch.identification.exact_recursive import ExactHuntCrossley, ExactKelvinVoigt, ExactRecursive
from foretouch.identification.fprls import FPRLS
from foretouch.identification.hunt_crossley_log import HuntCrossleyLogRLS
from foretouch.identification.hunt_crossley_two_stage import HuntCrossleyTwoStage
from foretouch.identification.kelvin_voigt_rls import KelvinVoigtRLS
from foretouch.identification.material_field import MaterialFieldLearner
from foretouch.identification.offline import OfflineContinuousSwitching, OfflineHuntCrossley, OfflineKelvinVoigt
from foretouch.identification.offline_contact_map import OfflineContactMap
from foretouch.identification.rls import RLS, ForgettingRLS, SelfPerturbingRLS
from foretouch.identification.robust_fprls import RobustFPRLS
from foretouch.identification.steepest_descent import (
    SteepestDescent,
    SteepestDescentHuntCrossley,
    SteepestDescentKelvinVoigt,
)
from foretouch.identification.threshold_switching import ThresholdSwitching

__all__ = ["DEFAULT_ESTIMATORS", "ESTIMATORS", "make_estimator"]

ESTIMATORS: dict[str, dict[str, type[Estimator]]] = {}
"""Estimators by name of the law, then by their own name."""

_KINDS: tuple[type[Estimator], ...] = (
    RLS,
    ForgettingRLS,
    SelfPerturbingRLS,
    FPRLS,
    RobustFPRLS,
    KelvinVoigtRLS,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    ThresholdSwitching,
    SteepestDescent,
    SteepestDescentKelvinVoigt,
    SteepestDescentHuntCrossley,
    OfflineContinuousSwitching,
    OfflineKelvinVoigt,
    OfflineHuntCrossley,
    ExactRecursive,
    ExactKelvinVoigt,
    ExactHuntCrossley,
    ContactMapBank,
    OfflineContactMap,
    MaterialFieldLearner,
)

for _kind in _KINDS:
    ESTIMATORS.setdefault(_kind.model_name, {})[_kind.name] = _kind


DEFAULT_ESTIMATORS: dict[str, str] = {
    "continuous-switching": "fprls",
    "kelvin-voigt": "rls",
    "hunt-crossley": "log-rls",
    "threshold-switching": "switching",
    "contact-map": "bank",
    "quadratic": "material-field",
}
"""The estimator that is taken for a law where none is named: the paper's, or the one it compares with."""


def make_estimator(model: str, estimator: str) -> Estimator:
    """A fresh estimator with its default options.

    Raises:
        UnknownNameError: No such law, or no such estimator for it.
    """
    if model not in ESTIMATORS:
        raise UnknownNameError("model", model, ESTIMATORS)
    if estimator not in ESTIMATORS[model]:
        raise UnknownNameError(f"estimator for {model}", estimator, ESTIMATORS[model])
    return ESTIMATORS[model][estimator]()

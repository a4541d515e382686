"""Identification: conditioning of raw samples, estimators of the contact laws, and prediction under a delay.

Nothing here sees a robot or a file: the same code runs on recordings, simulations and hardware.
"""

from foretouch.identification.calibration import (
    SensorFrame,
    ToolLoadFit,
    check_orientations,
    fit_sensor_frame,
    fit_tool_load,
    outlying_poses,
)
from foretouch.identification.classic.least_squares import (
    HuntCrossleyLogOptions,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    KelvinVoigtOptions,
    KelvinVoigtRLS,
    TwoStageOptions,
)
from foretouch.identification.classic.steepest_descent import (
    SteepestDescent,
    SteepestDescentHuntCrossley,
    SteepestDescentKelvinVoigt,
    SteepestDescentOptions,
)
from foretouch.identification.classic.threshold_switching import ThresholdSwitching
from foretouch.identification.conditioning.conditioner import Conditioner, ContactSample, ContactSamples, SensorLag
from foretouch.identification.conditioning.fault_kernels import SensorState
from foretouch.identification.conditioning.watch import SENSOR_SENTENCES, SensorWatch
from foretouch.identification.contact_map.bank import EXPERT_NAMES, ContactMap
from foretouch.identification.contact_map.remembered import from_the_surface
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.exact.recursive import (
    ExactContinuousSwitching,
    ExactHuntCrossley,
    ExactKelvinVoigt,
    ExactOptions,
)
from foretouch.identification.force_calibration import ToolWeight, fit_tool_weight
from foretouch.identification.friction import FrictionEstimator
from foretouch.identification.identify import (
    TIME_TOLERANCE,
    Identification,
    Motion,
    PredictedForce,
    identify,
    predict,
    predict_motion,
)
from foretouch.identification.learner import Learner, LearntModel
from foretouch.identification.linear.estimators import FPRLS, RLS, ROBUST, ForgettingRLS, RobustFPRLS, SelfPerturbingRLS
from foretouch.identification.linear.options import FPRLSOptions, RobustOptions
from foretouch.identification.offline import (
    OfflineContinuousSwitching,
    OfflineFit,
    OfflineHuntCrossley,
    OfflineKelvinVoigt,
    fit_offline,
)
from foretouch.identification.offline_contact_map import OfflineContactMap
from foretouch.identification.registry import (
    BUILT_IN_ESTIMATORS,
    DEFAULT_ESTIMATORS,
    ESTIMATORS,
    all_estimators,
    default_estimator,
    load_estimator,
    make_estimator,
)
from foretouch.identification.scale_field import ScaleFieldLearner
from foretouch.identification.series_compliance import (
    SeriesCompliance,
    correct_recording,
    find_sensor_lag,
    fit_series_compliance,
)

__all__ = [
    "BUILT_IN_ESTIMATORS",
    "DEFAULT_ESTIMATORS",
    "ESTIMATORS",
    "EXPERT_NAMES",
    "FPRLS",
    "RLS",
    "ROBUST",
    "SENSOR_SENTENCES",
    "TIME_TOLERANCE",
    "Conditioner",
    "ContactMap",
    "ContactSample",
    "ContactSamples",
    "Estimator",
    "ExactContinuousSwitching",
    "ExactHuntCrossley",
    "ExactKelvinVoigt",
    "ExactOptions",
    "FPRLSOptions",
    "ForgettingRLS",
    "FrictionEstimator",
    "HuntCrossleyLogOptions",
    "HuntCrossleyLogRLS",
    "HuntCrossleyTwoStage",
    "Identification",
    "KelvinVoigtOptions",
    "KelvinVoigtRLS",
    "Learner",
    "LearntModel",
    "Motion",
    "OfflineContactMap",
    "OfflineContinuousSwitching",
    "OfflineFit",
    "OfflineHuntCrossley",
    "OfflineKelvinVoigt",
    "PredictedForce",
    "RobustFPRLS",
    "RobustOptions",
    "ScaleFieldLearner",
    "SelfPerturbingRLS",
    "SensorFrame",
    "SensorLag",
    "SensorState",
    "SensorWatch",
    "SeriesCompliance",
    "Status",
    "SteepestDescent",
    "SteepestDescentHuntCrossley",
    "SteepestDescentKelvinVoigt",
    "SteepestDescentOptions",
    "ThresholdSwitching",
    "ToolLoadFit",
    "ToolWeight",
    "TwoStageOptions",
    "all_estimators",
    "check_orientations",
    "correct_recording",
    "default_estimator",
    "find_sensor_lag",
    "fit_offline",
    "fit_sensor_frame",
    "fit_series_compliance",
    "fit_tool_load",
    "fit_tool_weight",
    "from_the_surface",
    "identify",
    "load_estimator",
    "make_estimator",
    "outlying_poses",
    "predict",
    "predict_motion",
]

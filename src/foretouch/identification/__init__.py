"""Identification: conditioning of raw samples, estimators of the contact laws, and prediction under a delay.

Nothing here sees a robot or a file: the same code runs on recordings, simulations and hardware.
"""

from foretouch.identification.conditioning import Conditioner, ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.fprls import FPRLS, FPRLSOptions
from foretouch.identification.identify import Identification, identify
from foretouch.identification.learner import Learner, LearntModel
from foretouch.identification.prediction import TIME_TOLERANCE, Motion, predict, predict_motion
from foretouch.identification.registry import ESTIMATORS, make_estimator

__all__ = [
    "ESTIMATORS",
    "FPRLS",
    "TIME_TOLERANCE",
    "Conditioner",
    "ContactSample",
    "Estimator",
    "FPRLSOptions",
    "Identification",
    "Learner",
    "LearntModel",
    "Motion",
    "Status",
    "identify",
    "make_estimator",
    "predict",
    "predict_motion",
]

"""Contact laws: one set of equations for simulation, identification and rendering, so they cannot disagree."""

from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.models.hunt_crossley import HuntCrossley
from foretouch.models.kelvin_voigt import KelvinVoigt
from foretouch.models.laws import LAWS, make_model
from foretouch.models.linearised import LinearisedContinuousSwitching
from foretouch.models.motion import MotionFilter
from foretouch.models.predictor import Predictor

__all__ = [
    "LAWS",
    "NO_STATE",
    "ContactModel",
    "ContactState",
    "HuntCrossley",
    "KelvinVoigt",
    "LinearisedContinuousSwitching",
    "MotionFilter",
    "Predictor",
    "advance",
    "make_model",
]

"""Contact laws: one set of equations for simulation, identification and rendering, so they cannot disagree."""

from foretouch.models.classic import ContinuousSwitching, HuntCrossley, KelvinVoigt, ThresholdSwitching
from foretouch.models.contact_map.model import ContactMapModel, MapSummary, summarise_map
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.models.friction import FRICTIONS, BristleFriction
from foretouch.models.laws import LAWS, make_model
from foretouch.models.memoryless_law import LinearisedContinuousSwitching, MemorylessLaw
from foretouch.models.predictor import MotionFilter, Predictor
from foretouch.models.scale_field import FIELD_DEPTH, ScaleField, force_at_rest, stiffness_at_rest
from foretouch.models.shape_field import ShapeField

__all__ = [
    "FIELD_DEPTH",
    "FRICTIONS",
    "LAWS",
    "NO_STATE",
    "BristleFriction",
    "ContactMapModel",
    "ContactModel",
    "ContactState",
    "ContinuousSwitching",
    "HuntCrossley",
    "KelvinVoigt",
    "LinearisedContinuousSwitching",
    "MapSummary",
    "MemorylessLaw",
    "MotionFilter",
    "Predictor",
    "ScaleField",
    "ShapeField",
    "ThresholdSwitching",
    "advance",
    "force_at_rest",
    "make_model",
    "stiffness_at_rest",
    "summarise_map",
]

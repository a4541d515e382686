"""Contact laws: one set of equations for simulation, identification and rendering, so they cannot disagree."""

from foretouch.models.classic import ContinuousSwitching, HuntCrossley, KelvinVoigt, ThresholdSwitching
from foretouch.models.contact_map.model import ContactMapModel, MapSummary, summarise_map
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.models.laws import LAWS, make_model
from foretouch.models.material_field import FIELD_DEPTH, MOST_NODES, NODE_SPACING, MaterialField
from foretouch.models.memoryless_law import LinearisedContinuousSwitching, MemorylessLaw, QuadraticContact
from foretouch.models.predictor import MotionFilter, Predictor

__all__ = [
    "FIELD_DEPTH",
    "LAWS",
    "MOST_NODES",
    "NODE_SPACING",
    "NO_STATE",
    "ContactMapModel",
    "ContactModel",
    "ContactState",
    "ContinuousSwitching",
    "HuntCrossley",
    "KelvinVoigt",
    "LinearisedContinuousSwitching",
    "MapSummary",
    "MaterialField",
    "MemorylessLaw",
    "MotionFilter",
    "Predictor",
    "QuadraticContact",
    "ThresholdSwitching",
    "advance",
    "make_model",
    "summarise_map",
]

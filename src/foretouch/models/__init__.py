"""Contact laws: one set of equations for simulation, identification and rendering, so they cannot disagree."""

from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState, advance
from foretouch.models.laws import LAWS, make_model
from foretouch.models.motion import MotionFilter

__all__ = ["LAWS", "NO_STATE", "ContactModel", "ContactState", "MotionFilter", "advance", "make_model"]

"""The registry of contact laws: a name on the wire to the class that runs it."""

from __future__ import annotations

from collections.abc import Sequence

from foretouch.errors import SettingError, UnknownNameError
from foretouch.models.contact_model import ContactModel
from foretouch.models.continuous_switching import ContinuousSwitching
from foretouch.models.hunt_crossley import HuntCrossley
from foretouch.models.kelvin_voigt import KelvinVoigt
from foretouch.models.linearised import LinearisedContinuousSwitching
from foretouch.models.threshold_switching import ThresholdSwitching

__all__ = ["LAWS", "make_model"]

LAWS: dict[str, type[ContactModel]] = {
    law.law: law
    for law in (KelvinVoigt, HuntCrossley, ThresholdSwitching, ContinuousSwitching, LinearisedContinuousSwitching)
}
"""Every law that a model message may name."""


def make_model(law: str, parameters: Sequence[float]) -> ContactModel:
    """Contact model from its wire form.

    Raises:
        UnknownNameError: No such law.
        SettingError: The wrong number of parameters, or one out of range.
    """
    if law not in LAWS:
        raise UnknownNameError("contact law", law, LAWS)
    kind = LAWS[law]
    if len(parameters) != len(kind.parameter_names):
        raise SettingError("parameters", tuple(parameters), f"{law} takes {', '.join(kind.parameter_names)}")
    return kind(*parameters)

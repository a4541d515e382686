"""The registry of contact laws: a name on the wire to the class that runs it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from foretouch.errors import ArgumentTypeError, SettingError, UnknownNameError
from foretouch.errors.checks import NUMBER, require_type
from foretouch.models.classic import ContinuousSwitching, HuntCrossley, KelvinVoigt, ThresholdSwitching
from foretouch.models.contact_map.model import ContactMapModel
from foretouch.models.contact_model import ContactModel
from foretouch.models.memoryless_law import LinearisedContinuousSwitching

LARGEST_PARAMETER = 1e15  # Larger parameters are refused: no material has them, and forces could overflow

LAWS: dict[str, type[ContactModel]] = {
    law.law: law
    for law in (
        KelvinVoigt,
        HuntCrossley,
        ThresholdSwitching,
        ContinuousSwitching,
        LinearisedContinuousSwitching,
        ContactMapModel,
    )
}
"""Every law that a model message may name."""


def make_model(law: str, parameters: Sequence[float], map: bytes = b"") -> ContactModel:
    """Contact model from its wire form.

    Args:
        law: One of `LAWS`.
        parameters: In the order that the law declares.
        map: What a contact map has beside them, empty for the others.

    Raises:
        UnknownNameError: No such law.
        SettingError: The wrong number of parameters, one out of range or beyond 1e15, or a map that is none.
        ArgumentTypeError: Parameters that are no numbers.
    """
    require_type("law", law, str, "the name of a contact law, such as 'hunt-crossley'")
    if law not in LAWS:
        raise UnknownNameError("contact law", law, LAWS)
    kind = LAWS[law]
    if not isinstance(parameters, Collection) or not all(isinstance(value, NUMBER) for value in parameters):
        raise ArgumentTypeError("parameters", parameters, f"a sequence of numbers: {', '.join(kind.parameter_names)}")
    if len(parameters) != len(kind.parameter_names):
        raise SettingError("parameters", f"{len(parameters)} numbers", f"{law} takes {', '.join(kind.parameter_names)}")
    for name, value in zip(kind.parameter_names, parameters, strict=True):
        if abs(value) > LARGEST_PARAMETER:
            raise SettingError(name, value, f"must be at most {LARGEST_PARAMETER:g}")
    if kind is ContactMapModel:
        stiffness, damping, exponent, switching = parameters
        return ContactMapModel(stiffness, damping, exponent, switching, map)
    if map:
        raise SettingError("map", f"{len(map)} bytes", f"{law} has none")
    return kind(*parameters)

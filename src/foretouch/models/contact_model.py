"""What a contact model is: frozen numbers, a state, and one step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, TypeAlias

__all__ = ["NO_STATE", "ContactModel", "ContactState", "advance"]

ContactState: TypeAlias = tuple[float, ...]
"""What the material remembers (hysteresis, relaxation), as plain numbers; empty for the paper's laws."""

NO_STATE: ContactState = ()


class ContactModel(ABC):
    """A contact law with its numbers. Leaves are frozen dataclasses whose fields are the parameters.

    Attributes:
        law: Name of the law, unique.
        parameter_names: Names of the parameters, in the order of `parameters`.
    """

    __slots__ = ()
    law: ClassVar[str]
    parameter_names: ClassVar[tuple[str, ...]]

    @property
    def parameters(self) -> tuple[float, ...]:
        """The law's numbers in the order of `parameter_names`, units as the leaf's docstring says."""
        return tuple(getattr(self, name) for name in self.parameter_names)

    def initial_state(self) -> ContactState:
        """State of a material that has not been touched."""
        return NO_STATE

    @abstractmethod
    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `advance`."""


def advance(
    model: ContactModel, state: ContactState, depth: float, velocity: float, sample_period: float
) -> tuple[ContactState, float, float]:
    """Advance a contact model by one sample; follower and leader both call this and nothing else.

    Args:
        model: The law with its numbers.
        state: What the material remembers before this sample.
        depth: Penetration depth x [m], positive inside the surface.
        velocity: Penetration velocity [m/s], positive while deepening.
        sample_period: Time since the sample before [s], positive.

    Returns:
        The state after this sample; the force on the probe along the outward normal [N], finite, never negative,
        zero outside; and its standard deviation [N], NaN where the model carries no doubt.
    """
    return model.advance(state, depth, velocity, sample_period)

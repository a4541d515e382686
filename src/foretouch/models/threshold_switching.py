"""The threshold switching law, equation (3) of the paper."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.models.hunt_crossley import HuntCrossley
from foretouch.models.kelvin_voigt import KelvinVoigt
from foretouch.models.memoryless_law import MemorylessLaw

__all__ = ["ThresholdSwitching"]


@dataclass(frozen=True, slots=True)
class ThresholdSwitching(MemorylessLaw):
    r"""Kelvin-Voigt for what is stiff, Hunt-Crossley for what is not, by a threshold of the Kelvin-Voigt stiffness.

    .. math:: S(k_{kv}) = \begin{cases} kv & k_{kv} \ge k_{th} \\ hc & \text{else} \end{cases}

    Both laws are estimated side by side; the one in use is chosen from their numbers, so the force jumps when an
    estimate crosses the threshold, while within one set of numbers the law is smooth.

    Args:
        kelvin_voigt_stiffness: k_kv = K of the Kelvin-Voigt law [N/m], positive; the one that is compared.
        kelvin_voigt_damping: B [N s/m], not negative.
        hunt_crossley_stiffness: k of the Hunt-Crossley law [N/m^n], positive.
        hunt_crossley_damping: lambda [N s/m^(n+1)], not negative.
        hunt_crossley_exponent: n [-], positive.
        threshold: k_th [N/m], positive; the paper's simulation has 4000.

    Attributes:
        chosen: The law in use.

    Raises:
        SettingError: A parameter out of range.

    References:
        The paper, equation (3), after Achhammer, Weber, Peer and Buss (2010), Improvement of model-mediated
        teleoperation using a new hybrid environment estimation technique, IEEE ICRA.
    """

    law: ClassVar[str] = "threshold-switching"
    parameter_names: ClassVar[tuple[str, ...]] = (
        "kelvin_voigt_stiffness",
        "kelvin_voigt_damping",
        "hunt_crossley_stiffness",
        "hunt_crossley_damping",
        "hunt_crossley_exponent",
        "threshold",
    )
    kelvin_voigt_stiffness: float
    kelvin_voigt_damping: float
    hunt_crossley_stiffness: float
    hunt_crossley_damping: float
    hunt_crossley_exponent: float
    threshold: float
    chosen: KelvinVoigt | HuntCrossley = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in self.parameter_names:
            if name.endswith("damping"):
                require(name, getattr(self, name), at_least=0.0)
            else:
                require(name, getattr(self, name), above=0.0)
        kelvin_voigt = KelvinVoigt(self.kelvin_voigt_stiffness, self.kelvin_voigt_damping)
        hunt_crossley = HuntCrossley(
            self.hunt_crossley_stiffness, self.hunt_crossley_damping, self.hunt_crossley_exponent
        )
        stiff = self.kelvin_voigt_stiffness >= self.threshold
        object.__setattr__(self, "chosen", kelvin_voigt if stiff else hunt_crossley)

    @property
    def general_form(self) -> tuple[float, float, float, float]:
        """The law in use as numbers of (4)."""
        return self.chosen.general_form

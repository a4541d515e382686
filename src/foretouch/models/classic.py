"""The paper's laws, equations (1) to (4): Kelvin-Voigt, Hunt-Crossley, threshold and continuous switching."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors import SettingError
from foretouch.models.memoryless_law import General, MemorylessLaw, Numbers


@dataclass(frozen=True, slots=True)
class KelvinVoigt(MemorylessLaw):
    r"""Linear spring and linear damper in parallel: (4) with n = 0 and alpha = 1.

    .. math:: F = \max(0,\; K x + B \dot x), \quad F = 0 \text{ for } x \le 0

    Equation (1) lets the force turn negative at release, where the material would pull the probe; here the force
    is never negative, unless a method is asked for it. The force jumps to B times the speed at first touch.

    Args:
        stiffness: K [N/m], positive.
        damping: B [N s/m], not negative.

    Raises:
        SettingError: A parameter out of range.
    """

    law: ClassVar[str] = "kelvin-voigt"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping")
    positive: ClassVar[tuple[str, ...]] = ("stiffness",)
    stiffness: float
    damping: float

    @staticmethod
    def in_general(numbers: Numbers) -> General:
        """The same law as numbers of (4): K, B, 0, 1."""
        return numbers[0], numbers[1], 0.0, 1.0


@dataclass(frozen=True, slots=True)
class HuntCrossley(MemorylessLaw):
    r"""Power-law spring whose damping grows with depth: (4) with alpha = 0.

    .. math:: F = \max(0,\; k x^n + \lambda x^n \dot x), \quad F = 0 \text{ for } x \le 0

    Args:
        stiffness: k [N/m^n], positive.
        damping: lambda [N s/m^(n+1)], not negative.
        exponent: n [-], positive.

    Raises:
        SettingError: A parameter out of range.

    References:
        Hunt and Crossley (1975), Coefficient of restitution interpreted as damping in vibroimpact,
        Journal of Applied Mechanics 42(2).
    """

    law: ClassVar[str] = "hunt-crossley"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "exponent")
    positive: ClassVar[tuple[str, ...]] = ("stiffness", "exponent")
    stiffness: float
    damping: float
    exponent: float

    @staticmethod
    def in_general(numbers: Numbers) -> General:
        """The same law as numbers of (4): k, lambda, n, 0."""
        return numbers[0], numbers[1], numbers[2], 0.0


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
    positive: ClassVar[tuple[str, ...]] = (
        "kelvin_voigt_stiffness",
        "hunt_crossley_stiffness",
        "hunt_crossley_exponent",
        "threshold",
    )
    kelvin_voigt_stiffness: float
    kelvin_voigt_damping: float
    hunt_crossley_stiffness: float
    hunt_crossley_damping: float
    hunt_crossley_exponent: float
    threshold: float

    @staticmethod
    def in_general(numbers: Numbers) -> General:
        """The law in use as numbers of (4)."""
        if numbers[0] >= numbers[5]:
            return numbers[0], numbers[1], 0.0, 1.0
        return numbers[2], numbers[3], numbers[4], 0.0

    @property
    def chosen(self) -> KelvinVoigt | HuntCrossley:
        """The law in use."""
        k, damping, n, alpha = self.general_form
        return KelvinVoigt(k, damping) if alpha > 0.0 else HuntCrossley(k, damping, n)


@dataclass(frozen=True, slots=True)
class ContinuousSwitching(MemorylessLaw):
    r"""One law from Hunt-Crossley (alpha = 0) to Kelvin-Voigt (n = 0, alpha = 1).

    .. math:: F = \max(0,\; k x^{n + \alpha} + \lambda x^n \dot x), \quad F = 0 \text{ for } x \le 0

    The paper's range (5) is 1 <= n + alpha < 2 and 0 <= alpha <= 1. Numbers outside it make a law as well, as long
    as the force is zero at rest on the surface; `validity` says what they break. Where n > 0 there is no force at
    first touch; where alpha > 0 the equation pulls at release (`tension_depth`), here held at zero.

    Args:
        stiffness: k [N/m^(n + alpha)], positive.
        damping: lambda [N s/m^(n+1)], not negative.
        exponent: n [-], not negative.
        switching: alpha [-], not negative, and not zero together with n.

    Raises:
        SettingError: A parameter out of range.

    References:
        The paper, equations (4) and (5).
    """

    law: ClassVar[str] = "continuous-switching"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "exponent", "switching")
    positive: ClassVar[tuple[str, ...]] = ("stiffness",)
    stiffness: float
    damping: float
    exponent: float
    switching: float

    def __post_init__(self) -> None:
        MemorylessLaw.__post_init__(self)
        if self.exponent + self.switching == 0.0:
            raise SettingError("switching", self.switching, "must be above 0 where exponent is 0: force needs depth")

    @staticmethod
    def in_general(numbers: Numbers) -> General:
        """The parameters themselves: k, lambda, n, alpha."""
        return numbers[0], numbers[1], numbers[2], numbers[3]

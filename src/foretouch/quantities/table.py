"""The table of quantities: one name, one unit, one sign each. The glossary of the docs is made from it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Quantity:
    """One quantity of the project.

    Attributes:
        name: The name that code, messages and columns use.
        symbol: The symbol of the paper, or "".
        unit: SI unit; "1" where there is none.
        meaning: What it is, and which sign is positive.
    """

    name: str
    symbol: str
    unit: str
    meaning: str


QUANTITIES: tuple[Quantity, ...] = (
    Quantity("time", "t", "s", "time since the first sample; from a monotonic clock"),
    Quantity("position", "", "m", "probe or handle position along the approach, growing into the material"),
    Quantity("surface", "", "m", "position at which the undeformed surface is first touched"),
    Quantity("depth", "x", "m", "position less surface; positive inside the material"),
    Quantity("velocity", "ẋ", "m/s", "rate of depth; positive while deepening"),
    Quantity("force", "F", "N", "on the probe along the outward normal; never negative"),
    Quantity("force_offset", "", "N", "what the sensor shows in free air"),
    Quantity("stiffness", "k", "N/m^s", "of the power law; comparable only at equal exponent s = n + alpha"),
    Quantity("damping", "λ", "N s/m^(n+1)", "of the contact law; N s/m for Kelvin-Voigt"),
    Quantity("stiffening", "", "N/m^2", "of the quadratic law: how its stiffness grows with depth"),
    Quantity("threshold", "", "N/m", "stiffness from which on threshold switching takes Kelvin-Voigt"),
    Quantity("exponent", "n", "1", "of depth in the damping term"),
    Quantity("switching", "α", "1", "0 is Hunt-Crossley, 1 with n = 0 is Kelvin-Voigt"),
    Quantity("s", "s", "1", "exponent of depth in the elastic term, n + alpha"),
    Quantity("ln_k", "ln k", "ln(N/m^s)", "logarithm of the stiffness with depth in metres"),
    Quantity("b1", "b₁", "s/m", "coefficient of velocity in the linearised law (18)"),
    Quantity("b2", "b₂", "s", "coefficient of velocity / depth in the linearised law (18)"),
    Quantity("forgetting_factor", "μ", "1", "weight of the past in recursive least squares, in (0, 1]"),
    Quantity("unscaled_covariance", "P", "of the parameters", "covariance divided by the noise variance"),
    Quantity("innovation", "ê", "of the measurement", "measured less predicted, before the update"),
    Quantity("one_way_delay", "", "s", "from sending to arrival, one direction"),
    Quantity("sample_period", "", "s", "between two ticks of a loop"),
)
"""The table."""


def parameter_unit(name: str, names: Iterable[str]) -> str:
    """Unit of one of a law's numbers, "" where it has none or is not known here.

    Args:
        name: Of the number; one of two laws begins with its law's name, as ``kelvin_voigt_stiffness``.
        names: Of all numbers of the law: without an exponent among them its strengths have plain units.
    """
    law, _, short = name.rpartition("voigt_" if "voigt_" in name else "crossley_")
    names = set(names)
    if law.startswith("kelvin") or not names & {"exponent", "s", "hunt_crossley_exponent"}:
        plain = {"stiffness": "N/m", "damping": "N s/m^2" if "stiffening" in names else "N s/m"}
        if short in plain:
            return plain[short]
    unit = next((quantity.unit for quantity in QUANTITIES if quantity.name == short), "")
    if not names & {"switching", "s"}:
        unit = unit.replace("^s", "^n")  # one exponent is all there is
    return "" if unit == "1" else unit

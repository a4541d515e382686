"""Numbers as people read them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from foretouch.quantities import parameter_unit

__all__ = ["figure", "measured", "number", "parameter_text"]


def number(value: float | None, unit: str) -> str:
    """A figure with its unit, a dash for None."""
    return "-" if value is None else f"{figure(value)} {unit}"


def figure(value: float) -> str:
    """Three figures, thousands marked, no exponent until a million."""
    size = abs(value)
    if size >= 1e6:
        return f"{value:.2e}"
    if size >= 100.0:
        return f"{value:,.0f}"
    if size >= 10.0:
        return f"{value:.1f}"
    if size < 1e-4:
        return "0.00"  # and never a zero with a sign
    return f"{value:.2f}" if size >= 0.1 else f"{value:.2g}"


def measured(value: float | None, error: float | None, unit: str = "") -> str:
    """A number with as many digits as its standard error allows, which has two; three where there is no error.

    Args:
        value: None for one that is undetermined.
        error: Its standard error, None where there is none.
        unit: Of both.
    """
    if value is None:
        return "undetermined"
    unit = f" {unit}" if unit else ""
    known = error is not None and 0.0 < error < math.inf
    size, digits = (error, 2) if known and error is not None else (abs(value), 3)
    if not 0.0 < size < math.inf:
        return f"{value:g}{unit}"
    places = digits - 1 - math.floor(math.log10(float(f"{size:.{digits - 1}e}")))

    def shown(one: float) -> str:
        return f"{round(one, places):,.{max(places, 0)}f}"

    return f"{shown(value)} ± {shown(size)}{unit}" if known else f"{shown(value)}{unit}"


def parameter_text(parameters: Mapping[str, float | None], errors: Mapping[str, float | None] | None) -> str:
    """A law's numbers with their units and standard errors.

    Args:
        parameters: By name, None for one that is undetermined.
        errors: By name; None where there are none.
    """
    told = errors or {}
    return ", ".join(
        f"{name} {measured(value, told.get(name), parameter_unit(name, parameters))}"
        for name, value in parameters.items()
    )

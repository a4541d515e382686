"""Numbers as people read them."""

from __future__ import annotations

from collections.abc import Mapping

from foretouch.quantities import measured, parameter_unit


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

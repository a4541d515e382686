"""Numbers as people read them."""

from __future__ import annotations

__all__ = ["figure", "number"]


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

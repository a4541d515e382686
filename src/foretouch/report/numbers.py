"""Numbers and sentences as people read them, and values of a session's settings."""

from __future__ import annotations

import math
import string
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from foretouch.errors import plural
from foretouch.quantities import Array, Flags, measured, parameter_unit
from foretouch.settings import NO_BASELINE

AS_IT_COMES = "delayed"  # The baseline that renders the delayed force itself


class Finding(NamedTuple):
    """One plain sentence about a session, and whether it is good news."""

    text: str
    good: bool = False


def sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def value_of(figures: Mapping[str, Any], name: str) -> Any:
    """A figure of a report; a dot leads into one of its objects, as in ``tracking_error.rms_mm``."""
    value: Any = figures
    for part in name.split("."):
        value = value[part]
    return value


def filled(template: str, figures: Mapping[str, Any]) -> str:
    """A line with the figures of a report that its braces name, as `value_of` takes them.

    A colon is followed by the unit, with which `number` writes the figure: ``{tracking_error.rms_mm:mm}``. Instead of a
    unit there may be ``=`` for `figure`, ``#`` and a word for a count of such things (``{clipped.leader:#tick}``), or
    ``,`` or a precision as `format` takes them (``{messages.sent:,}``, ``{duration_s:.1f}``).
    """
    return _FILLER.vformat(template, (), figures)


class _Filler(string.Formatter):
    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, str]:
        return value_of(kwargs, field_name), field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec.startswith("#"):
            return plural(value, format_spec[1:])
        if format_spec[:1] in ("", ",", "."):
            return format(value, format_spec)
        return figure(value) if format_spec == "=" else number(value, format_spec)


_FILLER = _Filler()


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


def largest(values: Array) -> float | None:
    """The largest finite value, None where there is none."""
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def finite_or_none(value: float) -> float | None:
    """A number, None where it is not finite: JSON has no other."""
    return value if math.isfinite(value) else None


def runs(flags: Flags) -> list[tuple[int, int]]:
    """Begin and end of each run of rows that are flagged, as a slice takes them."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def parameter_text(parameters: Mapping[str, float | None], errors: Mapping[str, float | None] | None) -> str:
    """A law's numbers with their units and standard errors, by name; None for an undetermined one."""
    known = errors or {}
    return ", ".join(
        f"{name} {measured(value, known.get(name), parameter_unit(name, parameters))}"
        for name, value in parameters.items()
    )


def setting(settings: Mapping[str, str], name: str, otherwise: str) -> str:
    """A setting of a session as text; sessions of old do not have all."""
    return settings.get(name) or otherwise


def renders_models(settings: Mapping[str, str]) -> bool:
    """Whether models were rendered, and not a delayed force as by the baselines."""
    return setting(settings, "baseline", NO_BASELINE) == NO_BASELINE


def number_of(settings: Mapping[str, str], name: str, otherwise: float) -> float:
    """A positive number among the settings of a session; any other counts as missing."""
    try:
        value = float(settings.get(name, otherwise))
    except ValueError:
        return otherwise
    return value if 0.0 < value < math.inf else otherwise

"""One check for numbers that are given to constructors."""

from __future__ import annotations

import math

from foretouch.errors import SettingError

__all__ = ["require"]


def require(
    name: str,
    value: float,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> None:
    """Raise `SettingError` unless the value is finite and within the bounds that are given."""
    rules = []
    good = math.isfinite(value)
    if above is not None:
        rules.append(f"above {above:g}")
        good = good and value > above
    if at_least is not None:
        rules.append(f"at least {at_least:g}")
        good = good and value >= at_least
    if at_most is not None:
        rules.append(f"at most {at_most:g}")
        good = good and value <= at_most
    if not good:
        raise SettingError(name, value, " and ".join(["must be finite", *rules]))

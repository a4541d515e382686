"""Checks of what is given to constructors and other entries."""

from __future__ import annotations

import math
import os
from numbers import Real

from foretouch.errors import ArgumentTypeError, SettingError

NUMBER = (float, int, Real)  # Every number, NumPy's among them; what is most likely is asked first


def require(
    name: str, value: float, *, above: float | None = None, at_least: float | None = None, at_most: float | None = None
) -> None:
    """Raise `SettingError` unless the value is finite and within the bounds that are given."""
    rules = []
    try:
        good = math.isfinite(value)
    except TypeError:
        raise ArgumentTypeError(name, value, "a number") from None
    if above is not None:
        rules.append(f"above {above:g}")
        good = good and value > above
    if at_least is not None:
        rules.append(f"at least {at_least:g}")
        good = good and value >= at_least
    if at_most is not None:
        rules.append(f"at most {at_most:g}")
        good = good and value <= at_most
    if good:
        return
    if at_least is not None and at_most is not None:
        raise SettingError(name, value, f"must lie between {at_least:g} and {at_most:g}")
    raise SettingError(name, value, " and ".join(["must be finite", *rules]))


def require_fields(owner: object, *names: str, **bounds: float) -> None:
    """`require` each of these attributes of an object to be within the same bounds."""
    for name in names:
        require(name, getattr(owner, name), **bounds)


def require_type(name: str, value: object, kind: type | tuple[type, ...], wanted: str) -> None:
    """Raise `ArgumentTypeError` unless the value is of this kind.

    Args:
        name: Name of the argument.
        value: Value that was given.
        kind: One type, or several.
        wanted: What is wanted, and how one gets it.
    """
    if not isinstance(value, kind):
        raise ArgumentTypeError(name, value, wanted)


def require_path(name: str, value: object) -> None:
    """Raise `ArgumentTypeError` unless the value is one that names a file.

    Args:
        name: Name of the argument.
        value: Value that was given.
    """
    require_type(name, value, (str, os.PathLike), "a path, as a text or a Path")

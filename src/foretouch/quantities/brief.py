"""Short representations of results, in a few lines however much they hold, and their comparison by value."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Collection, Iterable, Mapping
from typing import Any, ClassVar

import numpy as np

WIDTH, MOST_LINES = 100, 10  # largest number of characters in a line of a representation, and of its lines
LONGEST_PART = 160  # characters of one value in it
FEW = 4  # number of parts of a tuple, a list or a mapping that are shown; of more, only their number is


class Brief:
    """A dataclass whose representation has at most ten lines: without what has its default, of arrays the size."""

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = Brief.__repr__  # type: ignore[method-assign]  # else the dataclass makes one of its own

    def __repr__(self) -> str:
        shown = {}
        for one in dataclasses.fields(self):  # type: ignore[arg-type]  # of dataclasses only
            value = getattr(self, one.name, None)
            default = one.default_factory() if callable(one.default_factory) else one.default
            if one.repr and one.init and not _same(value, default):
                shown[one.name] = value
        return brief_text(type(self).__name__, shown.items())


class ByValue(Brief):
    """A dataclass that equals another of its kind if all values do, arrays among them; NaN equals NaN.

    What says how long the computer took is no part of a result: such fields have ``compare=False``, and such columns of
    its tables are named in `_timing`.
    """

    __slots__ = ()
    _timing: ClassVar[frozenset[str]] = frozenset()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.__eq__ = ByValue.__eq__  # type: ignore[method-assign]
        cls.__hash__ = ByValue.__hash__  # type: ignore[method-assign]

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(self) is not type(other):
            return NotImplemented
        return all(
            _same(getattr(self, one.name), getattr(other, one.name), self._timing)
            for one in dataclasses.fields(self)  # type: ignore[arg-type]
            if one.compare
        )

    def __hash__(self) -> int:
        """Hash of the sizes: equal objects have the same."""
        values = (getattr(self, one.name) for one in dataclasses.fields(self))  # type: ignore[arg-type]
        return hash((type(self).__name__, *(np.shape(value) for value in values if isinstance(value, np.ndarray))))


def brief_text(name: str, values: Iterable[tuple[str, object]]) -> str:
    """Names and values as a constructor is called, in at most ten lines.

    Args:
        name: Name of the class.
        values: Each with its name.
    """
    whole = f"{name}({', '.join(f'{key}={_part(value)}' for key, value in values)})"
    lines = textwrap.wrap(whole, WIDTH, subsequent_indent="    ", break_long_words=True) or [whole]
    if len(lines) > MOST_LINES:
        lines = [*lines[: MOST_LINES - 1], "    ...)"]
    return "\n".join(lines)


def brief_number(value: float | None) -> float | None:
    """A number to four digits, for people; None stays what it is."""
    return None if value is None else float(f"{value:.4g}")


def shortest(value: float) -> str:
    """A number in the fewest digits that give it again, without a point where it is whole."""
    return repr(float(value)).removesuffix(".0")


def measured(value: float | None, error: float | None, unit: str = "") -> str:
    """A number with as many digits as its standard error allows, which has two; three where there is no error.

    Args:
        value: None or NaN for one that is undetermined.
        error: Standard error, None or NaN where there is none.
        unit: Unit of both.
    """
    if value is None or math.isnan(value):
        return "undetermined"
    unit = f" {unit}" if unit else ""
    known = error is not None and 0.0 < error < math.inf
    size, digits = (error, 2) if known and error is not None else (abs(value), 3)
    if not 0.0 < size < math.inf:
        return f"{value:g}{unit}"
    positions = digits - 1 - math.floor(math.log10(float(f"{size:.{digits - 1}e}")))

    def shown(one: float) -> str:
        return f"{round(one, positions):,.{max(positions, 0)}f}"

    return f"{shown(value)} ± {shown(size)}{unit}" if known else f"{shown(value)}{unit}"


def _part(value: object) -> str:
    if isinstance(value, np.ndarray):
        if value.dtype.names:
            return f"<{value.size:,} rows of {len(value.dtype.names)} columns>"
        size = " x ".join(f"{length:,}" for length in value.shape)
        return f"<{size} {value.dtype}>" if value.size > FEW else np.array2string(value, separator=", ", precision=6)
    if isinstance(value, tuple | list | Mapping) and len(value) > FEW and type(value).__repr__ in _PLAIN:
        what = "names" if isinstance(value, Mapping) else type(next(iter(value))).__name__
        return f"<{len(value):,} {what}>"
    if isinstance(value, bytes) and len(value) > LONGEST_PART // 4:
        return f"<{len(value):,} bytes>"
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST_PART else f"{text[:LONGEST_PART]}...>"


_PLAIN = (tuple.__repr__, list.__repr__, dict.__repr__)
"""What has a representation of its own, as a named tuple, shows itself."""


def _same(one: Any, other: Any, but: Collection[str] = ()) -> bool:
    """Whether two values are equal, arrays and NaN among them; of a table, all but these columns."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.shape != other.shape or one.dtype != other.dtype:
            return False
        if one.dtype.names:
            return all(_same(one[name], other[name]) for name in one.dtype.names if name not in but)
        return bool(np.array_equal(one, other, equal_nan=one.dtype.kind in "fc"))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return False
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_same(value, other[name]) for name, value in one.items())
    if isinstance(one, tuple | list) and type(one) is type(other):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other) or bool(one != one and other != other)

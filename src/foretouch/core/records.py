"""State of a kernel as a record of named fields, which compiled and interpreted code read and write alike.

A record is a structure of C: numbers, arrays of fixed shape and other records, in one block, each placed as C does. A
kernel takes an array of records, of one element for a single state, and works on ``states[0]``: to call it with an
array costs a third of a call with a bare record.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:  # NumPy declares it final, and derives np.record from it
    Void = object
else:
    Void = np.void

KINDS = {float: np.float64, int: np.int64, bool: np.bool_}
"""Python's types of numbers, and what a record keeps for them."""


class Record(Void):
    """Base of the records: a class lists its fields, and becomes a NumPy structured dtype.

    A field is a ``float``, an ``int``, a ``bool``, another record, or an array of one of these, written
    ``Annotated[NDArray[Any], kind, shape]``. What stands after its equals sign is its value in a new record; without
    one, it is 0, or a new record.

    Example:
        >>> class Peak(Record):
        ...     force: float = -np.inf
        ...     recent: Annotated[NDArray[Any], float, 3]
        >>> states = Peak.new(recent=1.0)
        >>> states[0].force = 2.0
        >>> print(states)
        [(2., [1., 1., 1.])]

    In the types of a kernel (`foretouch.core.Kernel`) ``Peak[::1]`` is an array of such records, and
    ``Peak`` is one.

    Attributes:
        layout: The structured dtype.
    """

    layout: ClassVar[np.dtype[Any]]
    _first: ClassVar[NDArray[Any]]

    def __init_subclass__(cls) -> None:
        """Make the dtype, and a property of each field."""
        hints = get_type_hints(cls, include_extras=True)
        fields = {name: _kind_and_shape(hints[name]) for name in cls.__annotations__}
        values = {name: cls.__dict__[name] for name in fields if name in cls.__dict__}
        cls.layout = np.dtype((cls, _placed(fields)))
        records = {name: kind._first[0] for name, (kind, _) in fields.items() if issubclass(kind, Record)}
        cls._first = np.zeros(1, cls.layout)
        for name, value in (records | values).items():
            cls._first[name] = value
        for name in fields:
            setattr(cls, name, property(itemgetter(name), _setter(name)))

    @classmethod
    def new(cls, count: int = 1, /, **values: Any) -> NDArray[Any]:
        """Make records, shape (count,).

        Args:
            count: Number of records.
            **values: Values of fields, in place of those that the class gives.
        """
        made = np.repeat(cls._first, count)
        for name, value in values.items():
            made[name] = value
        return made


class Held:
    """Python's hold of one record: its numbers are attributes, which compiled code reads and writes, too.

    Args:
        records: An array of one record, which may be part of another record.
    """

    __slots__ = ("records",)

    records: NDArray[Any]

    def __init__(self, records: NDArray[Any]) -> None:
        object.__setattr__(self, "records", records)

    def __getattr__(self, name: str) -> Any:
        if name != "records" and not name.startswith("_"):  # a copy has no records at first
            try:
                return self.records[name].item()
            except ValueError:  # no field of that name
                pass
        raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        if name != "records" and name in (self.records.dtype.names or ()):
            self.records[name] = value
        else:
            object.__setattr__(self, name, value)


def _kind_and_shape(hint: Any) -> tuple[Any, Any]:
    """What a field is made of, and its shape."""
    kind, shape = get_args(hint)[1:] if get_origin(hint) is Annotated else (hint, ())
    return KINDS.get(kind, kind), shape


WORD = 8
"""Bytes of the largest number: records begin where their address is a multiple of it, as C places them, and a number
where it is one of its own size. NumPy would forget that of a record in a record."""


def _placed(fields: dict[str, tuple[Any, Any]]) -> np.dtype[Any]:
    """The dtype of fields of these kinds and shapes, each where C places it."""
    formats = [(getattr(kind, "layout", kind), shape) for kind, shape in fields.values()]
    offsets, end = [], 0
    for (kind, _), format_ in zip(fields.values(), formats, strict=True):
        end = _whole(end, WORD if issubclass(kind, Record) else np.dtype(kind).itemsize)
        offsets.append(end)
        end += np.dtype(format_).itemsize
    placed: Any = {"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": _whole(end)}
    made: np.dtype[Any] = np.dtype(placed | {"aligned": True})
    return made


def _whole(size: int, word: int = WORD) -> int:
    return -(-size // word) * word


def _setter(name: str) -> Callable[[Any, Any], None]:
    def put(record: Any, value: Any) -> None:
        record[name] = value

    return put

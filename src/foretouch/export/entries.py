"""Which kernels are exported, and what they and their records are called in C: one entry each.

To export a kernel, add an entry, and a `Struct` for each record that it takes. Its documentation is its own docstring.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cache
from typing import Any

from foretouch.core.compiling import Kernel, interpreted
from foretouch.export.structs import Struct, records_in, snake
from foretouch.session.safety import kernel as safety
from foretouch.session.safety.safety import Safety, SafetyLimits


@dataclass(frozen=True, slots=True)
class Entry:
    """A kernel as a function of C.

    Attributes:
        name: In C, without the prefix.
        kernel: What is exported.
        results: Names of its results, each written where a pointer says; a kernel of one result returns it.
        parameters: Names of its parameters in C, those of tuples one by one, where not the kernel's own.
    """

    name: str
    kernel: Kernel[..., Any]
    results: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """What it does."""
        return inspect.getdoc(interpreted(self.kernel.function)) or ""


ENTRIES = (
    Entry("safety_set", safety.set_limits),
    Entry("safety_keep", safety.keep_safe, results=("aim", "status")),
    Entry("safety_limit", safety.limit),
)


@cache
def structs() -> tuple[Struct, ...]:
    """The records of the entries, each after those that it is made of, which are called as their classes are."""
    named = (
        Struct(safety.Limits, "safety_limits", described=SafetyLimits),
        Struct(safety.Memory, "safety", first=Safety(SafetyLimits(), 1e-3).memories),
    )
    known = {struct.kind: struct for struct in named}
    every = dict.fromkeys(kind for struct in named for kind in records_in(struct.kind))
    return tuple(known.get(kind, Struct(kind, snake(kind.__name__))) for kind in every)

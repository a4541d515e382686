"""What every room may stand on, and what knows none of them: records of kernels' state, and the compiler of kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from foretouch.core.records import Held, Record

if TYPE_CHECKING:
    from foretouch.core.compiling import Kernel, compiled, kernel, squared

__all__ = ["Held", "Kernel", "Record", "compiled", "kernel", "squared"]


def __getattr__(name: str) -> Any:
    """What compiles, loaded when it is asked for: Numba is slow to import."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from foretouch.core import compiling

    return getattr(compiling, name)

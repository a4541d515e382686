"""What every room may stand on, and what knows none of them: records of kernels' state, and the compiler of kernels."""

from __future__ import annotations

from foretouch.core.compiling import Kernel, compiled, kernel
from foretouch.core.records import Held, Record

__all__ = ["Held", "Kernel", "Record", "compiled", "kernel"]

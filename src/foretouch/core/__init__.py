"""What every room may stand on, and what knows none of them: the compiler of kernels."""

from __future__ import annotations

from foretouch.core.compiling import compiled

__all__ = ["compiled"]

"""Compiling what Python calls into."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numba import config

from foretouch.core.compiling import compiled

__all__ = ["entry_point"]

Function = TypeVar("Function", bound=Callable[..., object])


def entry_point(function: Function, *, parallel: bool = False) -> Function:
    """A compiled function whose arithmetic is that of IEEE 754: infinities and NaN are numbers, and nothing warns.

    With ``NUMBA_DISABLE_JIT=1`` the function itself, in which NumPy would else warn of both.

    Args:
        function: To be compiled at its first call, or loaded where it was compiled before.
        parallel: Whether its `prange` loops run on all cores.
    """
    if config.DISABLE_JIT:
        quiet: Function = np.errstate(all="ignore")(function)
        return quiet
    return compiled(error_model="numpy", parallel=parallel)(function)

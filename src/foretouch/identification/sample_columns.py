"""The columns of a conditioned recording, as compiled loops take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError

__all__ = ["sample_columns"]

Array = NDArray[np.float64]


def sample_columns(
    time: ArrayLike, depth: ArrayLike, velocity: ArrayLike, force: ArrayLike, in_contact: ArrayLike
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """Contiguous columns of one length.

    Args:
        time: [s], shape (n,).
        depth: Below the surface [m], shape (n,).
        velocity: [m/s], shape (n,).
        force: Less the offset [N], shape (n,).
        in_contact: Whether the probe touches, shape (n,).

    Raises:
        InputError: Columns of unlike shape.
    """
    numbers = [np.ascontiguousarray(column, np.float64) for column in (time, depth, velocity, force)]
    touching = np.ascontiguousarray(in_contact, np.bool_)
    shapes = [column.shape for column in (*numbers, touching)]
    if len(set(shapes)) > 1 or len(shapes[0]) != 1:
        raise InputError(
            f"time, depth, velocity, force, in_contact have the shapes {', '.join(map(str, shapes))}: "
            "they must be columns of one length"
        )
    return numbers[0], numbers[1], numbers[2], numbers[3], touching

"""Columns out of arrays, as HDF5 and MATLAB files hold them: samples along the longest dimension, whichever that is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["column_of", "column_shapes"]

MOST_COLUMNS = 64
"""An array that is wider is no set of signals, but an image or a matrix."""


def column_shapes(name: str, shape: tuple[int, ...]) -> Iterator[tuple[str, int]]:
    """Name and length of each column of an array: itself where it is one line, else ``name[0]`` and so on.

    Arrays of no or one value, of more than two dimensions or of more than 64 columns have none.
    """
    lengths = [length for length in shape if length != 1]
    if 0 in lengths:
        return
    if len(lengths) == 1:
        yield name, lengths[0]
    elif len(lengths) == 2 and min(lengths) <= MOST_COLUMNS:
        yield from ((f"{name}[{place}]", max(lengths)) for place in range(min(lengths)))


def column_of(array: NDArray[np.generic], place: int | None) -> NDArray[np.float64]:
    """One column as float64; `place` is the number in its name, None where it has none."""
    squeezed = np.squeeze(array)
    if place is None:
        return np.asarray(squeezed, dtype=np.float64)
    turned = squeezed if squeezed.shape[0] >= squeezed.shape[1] else squeezed.T
    return np.asarray(turned[:, place], dtype=np.float64)

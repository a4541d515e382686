"""One section of the reproduction: a figure of the paper made again, its data, and the claims that it decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.reproduction.claims import Claim

__all__ = ["Section", "Table"]

Table = Mapping[str, NDArray[np.generic]]
"""Columns by name, units in the names (``depth_m``, ``force_N``), all of one length."""


@dataclass(frozen=True)
class Section:
    """A part of the report.

    Attributes:
        name: Short and unique, for `--only` and file names, for example ``"fig7a"``.
        title: What is shown.
        text: A few sentences: what was done, what is seen, what differs from the paper.
        figure: A Matplotlib figure, None where there is only a table.
        data: Everything that the figure draws, by name of the table.
        claims: The claims of the paper that it decides.
    """

    name: str
    title: str
    text: str
    figure: Any = None
    data: Mapping[str, Table] = field(default_factory=dict)
    claims: tuple[Claim, ...] = ()

"""Local stiffness over a surface as colours: steps of a map that goes from dark to light, and what they mean."""

from __future__ import annotations

import html
import itertools
import math

import numpy as np
from numpy.typing import NDArray

from foretouch.console.window import Array
from foretouch.models import FIELD_DEPTH, MaterialField
from foretouch.quantities.colours import Colour, css

COLOURS: tuple[Colour, ...] = (
    (253, 231, 157), (247, 196, 108), (232, 155, 84), (205, 113, 79), (165, 78, 77), (116, 53, 71), (66, 30, 54)
)  # fmt: skip
"""From soft to stiff: lightness alone tells the steps apart, whichever colours an eye sees."""
UNKNOWN: Colour = (190, 190, 190)
"""Where nothing was learnt."""
LEAST_KNOWN = 0.5
"""Weight of learnt nodes in the law of a point from which its stiffness counts as known."""
STEPS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""A step is one of these times a power of ten."""
SMALLEST, LARGEST = 1.0, 1e7
"""Steps stay within these [N/m]."""
LEAST_SHARE = 0.05
"""Least step as a fraction of the scale's stiff end: less is noise, and one material has few colours."""
CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
WIDE = np.int64(1 << 20)


class StiffnessScale:
    """Round numbers at equal steps. It grows when more is learnt and does not shrink, so that colours keep.

    Attributes:
        edges: Between the steps [N/m], one more than there are colours; empty before anything was learnt.
    """

    def __init__(self) -> None:
        self.edges: Array = np.empty(0)

    def include(self, stiffness: Array) -> bool:
        """Let the scale hold what was learnt [N/m]; whether it has changed."""
        if not len(stiffness):
            return False
        low, high = (float(value) for value in np.percentile(stiffness, (2.0, 98.0)))
        if len(self.edges):
            low, high = min(low, float(self.edges[0])), max(high, float(self.edges[-1]))
        edges = _round_edges(low, high)
        if np.array_equal(edges, self.edges):
            return False
        self.edges = edges
        return True

    def forget(self) -> None:
        """Another material: the scale begins anew."""
        self.edges = np.empty(0)


def levels_of(edges: Array, stiffness: Array, known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The step of each point: 0 where nothing was learnt, then 1 for the softest.

    Args:
        edges: Edges of a `StiffnessScale`.
        stiffness: Local stiffness [N/m], shape (n,).
        known: Whether it was learnt, shape (n,).
    """
    if not len(edges):
        return np.zeros(len(stiffness), np.int64)
    step = np.clip(np.searchsorted(edges, stiffness, side="right"), 1, len(edges) - 1)
    return np.where(known, step, 0).astype(np.int64)


def known_share(field: MaterialField, points: Array) -> Array:
    """Weight of the learnt nodes in the law at each point.

    Args:
        field: Materials.
        points: Points in the fixture's frame [m], shape (n, 3).
    """
    if not len(field):
        return np.zeros(len(points))
    lattice = points / field.spacing
    base = np.floor(lattice).astype(np.int64)
    within = lattice - base
    codes = _codes(field.keys.astype(np.int64))
    share = np.zeros(len(points))
    for corner in CORNERS:
        weight = np.prod(np.where(corner == 1, within, 1.0 - within), axis=1)
        share += weight * np.isin(_codes(base + corner), codes)
    return share


def legend_html(edges: Array) -> str:
    """What the colours of the surface mean.

    Args:
        edges: Of a `StiffnessScale`.
    """
    grey = f'{_swatch(css(UNKNOWN))}<td style="padding-left:6px">nothing learnt yet</td>'
    rows = [f"<tr>{grey}</tr>"]
    for colour, (low, high) in zip(COLOURS, itertools.pairwise(edges.tolist()), strict=False):
        rows.append(f'<tr>{_swatch(css(colour))}<td style="padding-left:6px">{low:,.0f} to {high:,.0f}</td></tr>')
    rows.reverse()
    title = html.escape(f"Local stiffness at {FIELD_DEPTH * 1e3:.0f} mm [N/m]")
    return f'<b>{title}</b><table style="border-spacing:0;line-height:1.25">{"".join(rows)}</table>'


def _swatch(colour: str) -> str:
    return f'<td><div style="width:26px;height:14px;background:{colour};border:1px solid #555"></div></td>'


def _codes(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    return (keys[:, 0] * WIDE + keys[:, 1]) * WIDE + keys[:, 2]


def _round_edges(low: float, high: float) -> Array:
    """Round numbers at equal steps, the smallest that reach from one stiffness to another."""
    count = len(COLOURS)
    least = min(max((high - low) / count, LEAST_SHARE * high, SMALLEST), LARGEST)
    power = 10.0 ** math.floor(math.log10(least))
    for step in (power * factor for factor in (*STEPS, *(10.0 * factor for factor in STEPS))):
        first = step * math.floor(low / step)
        last = first + count * step
        if last >= high and step >= LEAST_SHARE * last:
            break
    return np.asarray(first + step * np.arange(count + 1), dtype=np.float64)

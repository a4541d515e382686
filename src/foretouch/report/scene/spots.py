"""Stiff and soft spots in the map of local stiffness, found from what was learnt alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from foretouch.models.scale_field_kernel import SPACING
from foretouch.quantities import Array, ByValue, Flags
from foretouch.report.scene.map import CELL, StiffnessMap, among_touched

NOTICEABLE = 1.23
"""Smallest ratio of a spot, or its inverse: what differs by less than 23 % a hand takes for alike (Jones and Hunter,
1990)."""

OUTSTANDING = 3.0
"""A spot differs from the median by more scatters than this: of places that are alike, with normal errors, one in 370
does."""

SURE = 3.0
"""Least number of standard deviations of a spot as a whole. Where nothing is, a spot is larger than the smallest one,
and alike all over, so that a palpation holds few chances of one."""

SMALLEST = SPACING
"""Smallest equivalent radius of a spot [m]: a node of the field has its neighbours this far away, and what is narrower
may be one node that was wrong, or that swings beside an edge."""

WIDTH = 2e-3
"""Standard deviation of the Gaussian by which places take from their neighbours [m]. Between two rows of touches one
row of nodes stays nearer to the law than what is on its both sides: this bridges it, and an edge moves by less than a
cell."""

AROUND = 6e-3
"""Width of what surrounds a spot [m]: two nodes, the least that has a node with no part in the spot's edge."""

PLATEAU = 90.0
"""Percentile of the difference within a spot that stands for its middle: the edge is left out, and so is a single
node that overshoots."""

LEAST_DEVIATION = 0.01
"""Relative standard deviation below which no place counts: a field in half precision may say none at all."""

NORMAL = 1.4826  # Standard deviation of normal errors, by their median size


@dataclass(frozen=True, eq=False)
class Spot(ByValue):
    """A part of the surface that is stiffer or softer than what surrounds it."""

    middle: tuple[float, float]  # seen from above, in the fixture's frame [m]
    radius: float  # of the disc of the same area [m]
    ratio: float  # of its local stiffness to that of what surrounds it
    deviations: float  # by how many standard deviations it differs
    places: Flags  # where it is on the map, shape (rows, columns)


class _Rise(NamedTuple):
    height: float  # of its middle above what surrounds it, in the logarithm of the stiffness
    deviations: float
    places: Flags


@dataclass(frozen=True, eq=False)
class _Felt:
    """Logarithms of the local stiffness over the map, 0 at the median; fields of shape (rows, columns)."""

    among: Flags  # what was touched, or is between touched places
    value: Array  # as learnt
    smooth: Array  # means with the neighbours
    precision: Array  # inverse of the variance of one place; 0 where nothing was touched
    scatter: float  # robust standard deviation of `value` over what was touched


def find_spots(stiffness: StiffnessMap) -> list[Spot]:
    r"""Spots of the learnt map, the surest first; its truth is not looked at.

    With the local stiffness K, its deviation u, and medians over the touched places,

    .. math::
        g(p) &= \ln \frac{K(p)}{\operatorname{med} K}, \quad v(p) = \left(\frac{u(p)}{K(p)}\right)^2, \quad
        \sigma = 1.4826 \operatorname{med} |g| \\
        \bar g(p) &= \frac{\sum_q w(p - q)\, g(q) / v(q)}{\sum_q w(p - q) / v(q)}

    with the Gaussian w of 2 mm. Connected places with :math:`\bar g > \max(3 \sigma, \ln 1.23)` belong together. With
    the median :math:`g_0` of g within 6 mm around them, and their own 90th percentile :math:`g_1`, the ratio is
    :math:`e^{g_1 - g_0}`, and the spot S is the part of them where :math:`\bar g` is beyond half of its own difference:
    there is the edge of a disc. The number of deviations is

    .. math::
        z = \frac{1}{\sqrt{\sigma^2 + v_S}}\, \frac{\sum_S (g - g_0) / v}{\sum_S 1 / v}, \quad
        \frac{1}{v_S} = \frac{c^2}{d^2} \sum_S \frac{1}{v}

    for nodes d = 3 mm apart that are known each by itself, and places of the map c = 1 mm apart. What is smaller than a
    disc of 3 mm radius, less than 23 % different, or less than 3 deviations sure, is no spot. Soft spots are the stiff
    ones of 1 / K. Places whose stiffness is not a positive number do not count.

    Where one spot is more than half of what was touched, it is the rest that differs from the median.
    """
    felt = _felt(stiffness)
    if felt is None:
        return []
    soft = replace(felt, value=-felt.value, smooth=-felt.smooth)
    spots = [_spot(stiffness, rise, sign) for sign, one in ((1.0, felt), (-1.0, soft)) for rise in _risen(one)]
    return sorted(spots, key=lambda spot: -spot.deviations)


def spot_figures(spots: Sequence[Spot]) -> list[dict[str, Any]]:
    """Spots in numbers: ``kind`` (``stiff`` or ``soft``), ``centre_mm``, ``radius_mm``, ``ratio``, ``deviations``."""
    return [
        {
            "kind": "stiff" if spot.ratio > 1.0 else "soft",
            "centre_mm": [1e3 * spot.middle[0], 1e3 * spot.middle[1]],
            "radius_mm": 1e3 * spot.radius,
            "ratio": spot.ratio,
            "deviations": spot.deviations,
        }
        for spot in spots
    ]


def _felt(stiffness: StiffnessMap) -> _Felt | None:
    """Logarithms of the map and what is known of them; None where nothing that counts was touched."""
    learnt, deviation = stiffness.learnt, stiffness.uncertainty
    counts = np.isfinite(learnt) & np.isfinite(deviation) & (learnt > 0.0)
    touched = stiffness.touched & counts
    if not touched.any():
        return None
    among = among_touched(stiffness) & counts
    known = np.where(counts, learnt, 1.0)
    value = np.log(known) - math.log(float(np.median(known[touched])))
    relative = np.maximum(np.where(counts, deviation, 1.0) / known, LEAST_DEVIATION)
    precision = np.where(among, relative**-2.0, 0.0)
    scatter = NORMAL * float(np.median(np.abs(value[touched])))
    return _Felt(among, value, _smoothed(value, precision), precision, scatter)


def _smoothed(value: Array, precision: Array) -> Array:
    """Means of each place and its neighbours, by how well each is known; 0 where none is."""
    total = ndimage.gaussian_filter(precision, WIDTH / CELL, mode="constant")
    weighted = ndimage.gaussian_filter(precision * value, WIDTH / CELL, mode="constant")
    return np.divide(weighted, total, out=np.zeros_like(value), where=precision > 0.0)


def _spot(stiffness: StiffnessMap, rise: _Rise, sign: float) -> Spot:
    row, column = np.nonzero(rise.places)
    middle = float(stiffness.x[column].mean()), float(stiffness.y[row].mean())
    return Spot(middle, _radius(rise.places), math.exp(sign * rise.height), rise.deviations, rise.places)


def _risen(felt: _Felt) -> Iterator[_Rise]:
    """Every part of the map that rises above what surrounds it, far, surely and widely enough."""
    threshold = max(OUTSTANDING * felt.scatter, math.log(NOTICEABLE))
    plain = felt.among & (np.abs(felt.smooth) <= threshold)
    labels, count = ndimage.label(felt.among & (felt.smooth > threshold))
    for number in range(1, count + 1):
        rise = _rise(felt, labels == number, plain)
        if rise.height >= math.log(NOTICEABLE) and rise.deviations >= SURE and _radius(rise.places) >= SMALLEST:
            yield rise


def _rise(felt: _Felt, part: Flags, plain: Flags) -> _Rise:
    """A part of the map that belongs together, against the plain places around it."""
    around = ndimage.binary_dilation(part, iterations=round(AROUND / CELL)) & plain
    value, smooth = (values - _median(values, around) for values in (felt.value, felt.smooth))
    places = part & (smooth > 0.5 * np.percentile(smooth[part], PLATEAU))
    precision = felt.precision[places]
    mean = float(np.average(value[places], weights=precision))
    variance = (SPACING / CELL) ** 2 / float(precision.sum())
    height = float(np.percentile(value[part], PLATEAU))
    return _Rise(height, mean / math.sqrt(felt.scatter**2 + variance), places)


def _median(values: Array, around: Flags) -> float:
    """The median of what surrounds a part; that of all that was touched, 0, where nothing does."""
    return float(np.median(values[around])) if around.any() else 0.0


def _radius(places: Flags) -> float:
    """Radius of the disc of the same area [m]."""
    return CELL * math.sqrt(np.count_nonzero(places) / math.pi)

"""Constants of a contact map, and the record of its numbers, which follower and leader hold alike.

The equations are in `foretouch.models.ContactMapModel`.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from numpy.typing import NDArray

from foretouch.core.records import Record
from foretouch.models.contact_model import LARGEST_DEPTH

Field = NDArray[Any]

COARSENESS = 3  # Ratio of the knots' distances of features and elastic part: features vary more slowly over depth
PLAYS = (1e-4, 3e-4)  # Radii of the play operators [m]; places are alike within the smaller one
TIMES = (0.05, 0.3, 1.5)  # Time constants of the averages of depth [s]
SPEED = 0.05  # Unit of speed [m/s]

MEMORY = len(PLAYS) + len(TIMES) + 1
"""Number of values of memory: positions of the plays, the averages [m], and whether it is stuck to the probe, 0 or 1;
all NaN before the first sample."""
STUCK = MEMORY - 1  # Index of the last of them

LARGEST_FEATURES = 1 + len(PLAYS) + len(TIMES)  # Number of features of the coarse map: velocity, plays, averages


class Grid(NamedTuple):
    """Even knots of a map: those of the elastic part, and the fewer ones of each feature.

    Attributes:
        spacing: Distance between two knots of the elastic part [m].
        below: Number of knots outside the origin.
        above: Number of knots inside it.
        features: Number of features.
        knots: Number of knots, and of weights, of the elastic part.
        feature_spacing: Distance between two knots of a feature [m].
        feature_below: Number of its knots outside the origin.
        feature_knots: Number of its knots.
        size: Number of all weights: those of the elastic part, then of each feature.
    """

    spacing: float
    below: int
    above: int
    features: int
    knots: int
    feature_spacing: float
    feature_below: int
    feature_knots: int
    size: int


def _grid(spacing: float, below: int, above: int, features: int) -> Grid:
    knots, feature_below = below + above + 3, -(-below // COARSENESS)
    feature_knots = feature_below - (-above // COARSENESS) + 3
    size = knots + features * feature_knots
    return Grid(spacing, below, above, features, knots, COARSENESS * spacing, feature_below, feature_knots, size)


GRIDS = COARSE, FINE = _grid(1e-3, 10, 40, LARGEST_FEATURES), _grid(3e-5, 20, 40, 1)
"""The coarse map reaches 10 mm out and 40 mm in, and has all features; the fine one has velocity only."""

BEYOND = 1.5
"""How far beyond what was seen is believed: largest ratio of the slope beyond the visited depth to that of the chord
from the surface, which is also its least value; of a speed of the law to the largest so far; and of a force within the
visited depth to the largest that was felt. A larger one that comes unexpectedly is not learnt from."""

CLEAR = 0.1
"""Part of the largest force by which an error, a touch or a pull is clear; less may be the mechanism's friction."""

LARGEST_FORCE = 1e6
"""Largest force of a model [N]."""

FINE_FROM, FINE_TO = -FINE.below * FINE.spacing, FINE.above * FINE.spacing
"""Where the knots of the fine map begin and end, from its place [m]."""


LETTING_GO = 5e-3  # Distance outside the visited range after which a force is zero at the latest [m]

EXPERTS = 3
UNCERTAINTIES = 2


class CoarseMap(Record):
    """The coarse map of splines."""

    ranges: Annotated[Field, float, (COARSE.features, 2)]  # least and largest value of each feature so far
    weights: Annotated[Field, float, COARSE.size]  # of the elastic part [N], then of each feature


class FineMap(Record):
    """The fine map of splines."""

    ranges: Annotated[Field, float, (FINE.features, 2)]
    weights: Annotated[Field, float, FINE.size]


class Map(Record):
    """A contact map. All of it are 64-bit floats, so that it is one flat array, too: `numbers` of an array of one."""

    origin: float  # of the maps, below the published surface [m]
    zero: float  # force that the maps give without contact [N]
    law: Annotated[Field, float, 4]  # k, lambda, n, alpha
    law_surface: float  # height of the law's surface above the published one [m]
    law_speed: float  # largest in contact so far [m/s]
    law_reached: float  # largest position since the beginning or the last change [m], from the origin
    lowest: float  # smallest position that was learnt [m], from the origin
    reached: float  # and the largest
    uncertainty: Annotated[Field, float, UNCERTAINTIES]  # variance: constant [N^2], multiple of force^2
    place: float  # of the fine map's knots, from the origin [m]
    shares: Annotated[Field, float, EXPERTS]  # weights of the law, the coarse map and the fine map
    felt: float  # largest force so far [N]
    touch: float = -LARGEST_DEPTH  # outermost position at which `touch_force` was felt [m], from the origin
    touch_way: float = LARGEST_DEPTH  # on which it grows to four times that [m]
    touch_force: float  # a twentieth to a tenth of the largest force [N]
    pull: float  # largest pull so far [N]: the force is no further below zero
    catch: float  # outermost position at which it pulled a probe that came from outside [m], from the origin
    hold: float  # and one that went outwards
    coarse: CoarseMap
    fine: FineMap


SIZE = Map.layout.itemsize // 8  # Number of all numbers of a map

HEADER = Map.layout.fields["coarse"][1] // 8  # type: ignore[index]
"""Number of those before the coarse map."""

"""Layout of the numbers of a contact map in the one flat array that holds it.

The header comes first, then the coarse and the fine map: ranges of the features, weights of the elastic part, weights
of the features. Follower and leader hold the same array; the equations are in `foretouch.models.ContactMapModel`.
"""

from __future__ import annotations

import numpy as np

LENGTHS = (1e-3, 3e-5)
"""Distance between the knots of the elastic part of the coarse and of the fine map [m]."""

BELOW = (10, 50)
ABOVE = (40, 60)
"""Number of knots above and below the origin, in that length: the coarse map reaches 10 mm out and 40 mm in."""

COARSENESS = 3
"""Ratio of the knots' distances of features and elastic part: features vary more slowly over depth."""

PLAYS = (1e-4, 3e-4)
"""Radii of the play operators [m]."""

TIMES = (0.05, 0.3, 1.5)
"""Time constants of the averages of depth [s]."""

SPEED = 0.05
"""Unit of speed [m/s]."""

MEMORY = len(PLAYS) + len(TIMES)
"""Number of values of memory: positions of the plays, then the averages [m]; all NaN before the first sample."""

FEATURES = (1 + MEMORY, 1)
"""Number of features of the coarse map (velocity, plays, averages) and of the fine one (velocity)."""

LARGEST_FEATURES = max(FEATURES)

REACH = 1.0
"""Factor on the range of the features so far, beyond which they are clamped."""

STEEPEST = 1.5
"""Largest ratio of the slope beyond the visited depth, which is the last one, to that of the chord from the surface,
which is also its least value."""

SPEED_REACH = 1.5
"""Factor on the largest speed so far, beyond which the law clamps speeds."""

LARGEST_FORCE = 1e6
"""Largest force of a model [N]."""

FINE_REACH = ABOVE[1] * LENGTHS[1]
"""Depth at which the knots of the fine map end [m]."""

MOST = 20.0
"""Largest ratio of a force beyond the visited depth to the largest that was felt."""

LETTING_GO = 5e-3
"""Distance outside the visited range after which a force is zero at the latest [m]."""

LEAST_DEPTH = 1e-4
"""Least depth to which a law is used [m], also if it was learnt from less."""

# --- the flat array --------------------------------------------------------------------------------------------------

ORIGIN = 0  # of the maps, below the published surface [m]
ZERO = 1  # what the maps give without contact [N]
LAW = 2  # k, lambda, n, alpha
LAW_SURFACE = 6  # height of the law's surface above the published one [m]
LAW_SPEED = 7  # largest in contact so far [m/s]
LOWEST, REACHED = 8, 9  # smallest and largest place of learning [m], from the origin
UNCERTAINTY = 10  # variance of the force: constant [N^2], share of the force's square, share of the speed's [N^2]
UNCERTAINTIES = 3
SHARES = 13  # of the law, the coarse map and the fine map
EXPERTS = 3
FELT = 16  # largest force so far [N]
HEADER = 17


def _layout(kind: int, start: int) -> tuple[int, ...]:
    """Where a map stands: ranges of its features, first weight, number of knots, the same for features, end."""
    knots = BELOW[kind] + ABOVE[kind] + 3
    coarse = -(-BELOW[kind] // COARSENESS) + -(-ABOVE[kind] // COARSENESS) + 3
    features = FEATURES[kind]
    ranges, weights = start, start + 2 * features
    return ranges, weights, knots, weights + knots, coarse, features, weights + knots + features * coarse


COARSE = _layout(0, HEADER)
FINE = _layout(1, COARSE[-1])
SIZE = FINE[-1]
"""Length of the flat array."""

STARTS = np.array([COARSE[:6], FINE[:6]])
RANGES, WEIGHTS, KNOTS, FEATURE_WEIGHTS, FEATURE_KNOTS, FEATURE_COUNT = range(6)
"""Rows: coarse and fine map; columns: where `_layout` says that its parts begin, and how many there are."""

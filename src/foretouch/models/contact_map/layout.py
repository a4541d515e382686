"""The numbers that a contact map is made of, and their places in the one flat array that holds it.

The header comes first, then the coarse and the fine map: ranges of the features, weights of the elastic part, weights
of the features. Follower and leader hold the same array; the equations are told by `foretouch.models.ContactMap`.
"""

from __future__ import annotations

import numpy as np

LENGTHS = (1e-3, 3e-5)
"""Distance between the knots of the elastic part of the coarse and of the fine map [m]."""

BELOW = (10, 50)
ABOVE = (40, 60)
"""Knots above and below the origin, in that length: the coarse map reaches 10 mm out and 40 mm in."""

COARSENESS = 3
"""Features vary more slowly over depth than the elastic part: their knots are so many times further apart."""

PLAYS = (1e-4, 3e-4)
"""Radii of the play operators [m]."""

TIMES = (0.05, 0.3, 1.5)
"""Time constants of the averages of depth [s]."""

SPEED = 0.05
"""Speed that counts as one [m/s]."""

MEMORY = len(PLAYS) + len(TIMES)
"""Numbers of memory: positions of the plays, then the averages [m]; all NaN before the first sample."""

FEATURES = (1 + MEMORY, 1)
"""Of the coarse map: velocity, plays, averages; of the fine one: velocity."""

LARGEST_FEATURES = max(FEATURES)

REACH = 1.0
"""Features count up to this many times their range so far."""

STEEPEST = 1.5
"""Deeper than ever the force grows along the last slope, which counts as at least that of the chord from the
surface, and at most this many times it."""

SPEED_REACH = 1.5
"""The law counts speeds up to this many times the largest so far."""

LARGEST_FORCE = 1e6
"""No force is larger [N]."""

FINE_REACH = ABOVE[1] * LENGTHS[1]
"""The knots of the fine map end here [m]."""

MOST = 20.0
"""Deeper than ever the force is at most this many times the largest that was felt."""

LETTING_GO = 5e-3
"""Further out than ever a force is gone after this distance [m] at the latest."""

LEAST_DEPTH = 1e-4
"""A law that was seen no deeper than this [m] is believed down to it."""

# --- the flat array --------------------------------------------------------------------------------------------------

ORIGIN = 0  # of the maps, below the published surface [m]
ZERO = 1  # what the maps give without contact [N]
LAW = 2  # k, lambda, n, alpha
LAW_SURFACE = 6  # height of the law's surface above the published one [m]
LAW_SPEED = 7  # largest in contact so far [m/s]
LOWEST, REACHED = 8, 9  # smallest and largest place of learning [m], from the origin
DOUBT = 10  # variance of the force: constant [N^2], share of the force's square, share of the speed's [N^2]
DOUBTS = 3
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

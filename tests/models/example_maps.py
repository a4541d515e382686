"""A contact map with numbers of its own, for tests of models."""

import numpy as np

from foretouch.models import ContactMap
from foretouch.models.contact_map_kernel import (
    COARSE,
    DOUBT,
    FINE,
    HEADER,
    LAW_SPEED,
    LOWEST,
    REACHED,
    SHARES,
    SIZE,
    pack,
)

LAW = (3000.0, 1500.0, 1.4, 0.0)


def example_flat(shares=(0.3, 0.5, 0.2), *, seed=0):
    """A map that was visited from 4 mm above to 8 mm below its origin: 400 N/m, with features of up to 0.1 N."""
    flat = np.zeros(SIZE)
    flat[DOUBT : DOUBT + 2] = 0.01, 0.0025
    flat[SHARES : SHARES + 3] = shares
    flat[LAW_SPEED], flat[LOWEST], flat[REACHED] = 0.2, -4e-3, 8e-3
    random = np.random.default_rng(seed)
    for layout, spacing, below in ((COARSE, 1e-3, 10), (FINE, 3e-5, 50)):
        ranges, weights, knots, feature_weights, _, features, end = layout
        flat[ranges:weights] = np.tile((-1.0, 1.0), features)
        flat[weights : weights + knots] = 400.0 * np.maximum((np.arange(knots) - below - 1) * spacing, 0.0)
        flat[feature_weights:end] = random.uniform(0.0, 0.1, end - feature_weights)
    assert ranges >= HEADER
    return flat


def example_map(shares=(0.3, 0.5, 0.2), *, seed=0):
    """The same as a model."""
    return ContactMap(*LAW, pack(example_flat(shares, seed=seed)))

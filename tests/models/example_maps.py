"""A contact map with numbers of its own, for tests of models."""

import numpy as np

from foretouch.models import ContactMapModel
from foretouch.models.contact_map.layout import (
    ABOVE,
    BELOW,
    COARSE,
    FELT,
    FINE,
    HEADER,
    LAW,
    LAW_SPEED,
    LAW_SURFACE,
    LENGTHS,
    LOWEST,
    ORIGIN,
    REACHED,
    SHARES,
    SIZE,
    UNCERTAINTY,
    ZERO,
)
from foretouch.models.contact_map.wire import pack

PARAMETERS = (3000.0, 1500.0, 1.4, 0.0)


def example_flat(shares=(0.3, 0.5, 0.2), *, seed=0):
    """A map that was visited from 4 mm above to 8 mm below its origin: 400 N/m, with features of up to 0.1 N."""
    flat = np.zeros(SIZE)
    flat[FELT] = 1e30  # no force here is too large to be believed
    flat[LAW : LAW + 4] = PARAMETERS
    flat[UNCERTAINTY : UNCERTAINTY + 2] = 0.01, 0.0025
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
    return ContactMapModel(*PARAMETERS, pack(example_flat(shares, seed=seed)))


def random_flat(seed, *, fine=True):
    """Any map: numbers of every size that learning gives, visited somewhere, origin and zero off the published ones."""
    random = np.random.default_rng(seed)
    flat = np.zeros(SIZE)
    flat[FELT] = 1e30  # no force here is too large to be believed
    flat[ORIGIN], flat[ZERO] = random.uniform(-2e-3, 2e-3), random.uniform(-0.5, 0.5)
    flat[LAW : LAW + 4] = random.uniform(100.0, 9000.0), random.uniform(0.0, 2000.0), *random.uniform(0.0, 1.5, 2)
    flat[LAW_SURFACE], flat[LAW_SPEED] = random.uniform(-1e-3, 1e-3), random.uniform(0.0, 0.3)
    flat[LOWEST], flat[REACHED] = random.uniform(-9e-3, 0.0), random.uniform(1e-4, 30e-3)
    flat[UNCERTAINTY : UNCERTAINTY + 2] = random.uniform(0.0, 0.1, 2)
    shares = random.dirichlet((1.0, 1.0, 1.0)) * (1.0, 1.0, float(fine))
    flat[SHARES : SHARES + 3] = shares / shares.sum()
    for layout in (COARSE, FINE):
        ranges, weights, knots, _, _, features, end = layout
        flat[ranges:weights] = np.sort(random.uniform(-3.0, 3.0, (features, 2)), axis=1).ravel()
        flat[weights : weights + knots] = np.cumsum(random.uniform(-0.2, 0.5, knots))
        flat[weights + knots : end] = random.normal(0.0, 0.3, end - weights - knots)
    return flat


def whole_flat(kind, *, seed=0):
    """A map of one kind (0 coarse, 1 fine) that was visited wherever it has knots, always some newtons."""
    flat = random_flat(seed)
    flat[ORIGIN] = flat[ZERO] = 0.0
    flat[SHARES : SHARES + 3] = 0.0
    flat[SHARES + 1 + kind] = 1.0
    spacing = LENGTHS[kind]
    flat[LOWEST], flat[REACHED] = -BELOW[kind] * spacing, ABOVE[kind] * spacing
    ranges, weights, knots, _, _, features, _ = (COARSE, FINE)[kind]
    flat[ranges:weights] = np.tile((-1.0, 1.0), features)
    flat[weights : weights + knots] += 10.0 - flat[weights : weights + knots].min()
    return flat

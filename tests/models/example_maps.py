"""A contact map with numbers of its own, for tests of models: arrays of one `Map`."""

import numpy as np

from foretouch.models import ContactMapModel
from foretouch.models.contact_map.layout import GRIDS, Map
from foretouch.models.contact_map.wire import shrunk

PARAMETERS = (3000.0, 1500.0, 1.4, 0.0)
NO_BOUND = 1e30  # no force here is too large to be believed


def parts(maps):
    """The grid and the record of each map of splines."""
    return tuple(zip(GRIDS, (maps[0].coarse, maps[0].fine), strict=True))


def example_numbers(shares=(0.3, 0.5, 0.2), *, seed=0):
    """A map that was visited from 4 mm above to 8 mm below its origin: 400 N/m, with features of up to 0.1 N."""
    made = Map.new(
        felt=NO_BOUND, law=PARAMETERS, shares=shares, uncertainty=(0.01, 0.0025),
        law_speed=0.2, law_reached=8e-3, lowest=-4e-3, reached=8e-3,
    )  # fmt: skip
    random = np.random.default_rng(seed)
    for grid, part in parts(made):
        part.ranges[:] = -1.0, 1.0
        part.weights[: grid.knots] = 400.0 * np.maximum((np.arange(grid.knots) - grid.below - 1) * grid.spacing, 0.0)
        part.weights[grid.knots :] = random.uniform(0.0, 0.1, grid.size - grid.knots)
    return made


def model_of(maps):
    """The same as a model."""
    return ContactMapModel(*maps[0].law.tolist(), shrunk(maps)[0])


def example_map(shares=(0.3, 0.5, 0.2), *, seed=0):
    """`example_numbers` as a model."""
    return model_of(example_numbers(shares, seed=seed))


def random_numbers(seed, *, fine=True):
    """Any map: numbers of every size that learning gives, visited somewhere, origin and zero off the published ones."""
    random = np.random.default_rng(seed)
    made = Map.new(felt=NO_BOUND)
    learnt = made[0]
    learnt.origin, learnt.zero = random.uniform(-2e-3, 2e-3), random.uniform(-0.5, 0.5)
    learnt.law[:] = random.uniform(100.0, 9000.0), random.uniform(0.0, 2000.0), *random.uniform(0.0, 1.5, 2)
    learnt.law_surface, learnt.law_speed = random.uniform(-1e-3, 1e-3), random.uniform(0.0, 0.3)
    learnt.lowest, learnt.reached = random.uniform(-9e-3, 0.0), random.uniform(1e-4, 30e-3)
    learnt.law_reached = learnt.reached
    learnt.uncertainty[:2] = random.uniform(0.0, 0.1, 2)
    shares = random.dirichlet((1.0, 1.0, 1.0)) * (1.0, 1.0, float(fine))
    learnt.shares[:] = shares / shares.sum()
    for grid, part in parts(made):
        part.ranges[:] = np.sort(random.uniform(-3.0, 3.0, (grid.features, 2)), axis=1)
        part.weights[: grid.knots] = np.cumsum(random.uniform(-0.2, 0.5, grid.knots))
        part.weights[grid.knots :] = random.normal(0.0, 0.3, grid.size - grid.knots)
    return made


def whole_numbers(kind, *, seed=0):
    """A map of one kind (0 coarse, 1 fine) that was visited wherever it has knots, always some newtons."""
    made = random_numbers(seed)
    learnt, (grid, part) = made[0], parts(made)[kind]
    learnt.origin = learnt.zero = 0.0
    learnt.shares[:] = np.eye(3)[1 + kind]
    learnt.lowest, learnt.reached = -grid.below * grid.spacing, grid.above * grid.spacing
    part.ranges[:] = -1.0, 1.0
    part.weights[: grid.knots] += 10.0 - part.weights[: grid.knots].min()
    return made

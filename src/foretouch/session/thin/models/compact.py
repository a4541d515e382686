"""A model as whole numbers: each number on a grid as fine as can be felt.

There are even steps up to one unit, and even ratios from there on. Both ends keep the steps of the models that crossed,
and what is written is the difference to one of them (`foretouch.session.thin.models.coding`): no rounding adds up.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import compiled, kernel
from foretouch.core.compiling import inlined, scratch
from foretouch.models.contact_map.layout import COARSE, FINE, HEADER, SIZE, Map
from foretouch.models.contact_map.wire import mark

Numbers = NDArray[np.float64]
Steps = NDArray[np.int64]

PARAMETERS, MOST_PARAMETERS = 1, 6  # Where the parameters begin, after the surface, and their largest number
AT_MAP = PARAMETERS + MOST_PARAMETERS
AT_SPACE, SPACE = AT_MAP + SIZE, 6 + 6 + 1 + 8  # Pose of the fixture, its deviations, its age, and friction
AT_ERRORS = AT_SPACE + SPACE
COUNT = AT_ERRORS + MOST_PARAMETERS
"""All numbers of a model: surface, parameters, map, what sessions in space have, and standard errors."""

FARTHEST = 60  # Powers of two between one unit and the largest number

FINE_LENGTH = 5e-7 * 2**20, 20  # Unit and powers of two of steps in it: steps of half a micrometre
LENGTH = 5e-6 * 2**18, 18  # Steps of five micrometres
FORCE = 1.0, 7  # Steps of a 128th of a newton, and of less than a percent above one newton
ROUGH = 1e-6, 3  # Ratios of an eighth: for deviations and errors
_OF_MAP = {
    "origin": FINE_LENGTH,
    "zero": (1.0, 9),
    "law": (1.0, 7),
    "law_surface": FINE_LENGTH,
    "law_speed": (0.05, 5),
    "uncertainty": (1e-4, 2),
    "place": FINE_LENGTH,
    "shares": (1.0, 7),
    "felt": (1.0, 6),
    "touch_way": (1e-4, 5),
    "touch_force": (1.0, 6),
    "pull": FORCE,
}
_LAW_OF_MAP = ((1.0, 8), (1.0, 7), (1.0, 11), (1.0, 11), ROUGH, ROUGH)  # k, lambda, n, alpha
_RANGE = 1.0, 7
_POSE = ((1e-5 * 2**16, 16),) * 3 + ((1e-4 * 2**12, 12),) * 3


def _grids(parameters: tuple[tuple[float, int], ...]) -> Numbers:
    """Unit, and steps in it, of each number, shape (COUNT, 2)."""
    grids = [FINE_LENGTH, *parameters]
    for name in Map.layout.names or ():
        kind: np.dtype[np.void] = Map.layout.fields[name][0]  # type: ignore[index]
        if name in ("coarse", "fine"):
            ranges, weights = (kind[part].itemsize // 8 for part in ("ranges", "weights"))
            grids += [_RANGE] * ranges + [FORCE] * weights
        else:
            grids += [_OF_MAP.get(name, LENGTH)] * (kind.itemsize // 8)
    grids += [*_POSE, *[ROUGH] * 6, (1.0, 3), *[(1e-3, 6)] * 8, *[ROUGH] * MOST_PARAMETERS]
    return np.array([(unit, 2.0**power) for unit, power in grids])


GRIDS_OF_MAP, GRIDS = _grids(_LAW_OF_MAP), _grids(((1e-3, 14),) * MOST_PARAMETERS)
"""Grids of a contact map's numbers, and of those of other laws, which their parameters alone make."""


def grids_of(is_map: bool) -> Numbers:
    """The grids of a contact map, or of another law."""
    return GRIDS_OF_MAP if is_map else GRIDS


def fits(numbers: Numbers, is_map: bool) -> bool:
    """Whether the numbers of a model, shape (COUNT,), are all on their grids."""
    return bool(np.all(np.abs(numbers) < grids_of(is_map)[:, 0] * 2.0 ** (FARTHEST - 1)))


@inlined
def _step_of(value: float, unit: float, steps: float) -> float:
    """Where on its grid a number lies, between two steps."""
    mantissa, power = math.frexp(1.0 + abs(value) / unit)
    step = steps * (power - 1 + 2.0 * mantissa - 1.0)
    return step if value >= 0.0 else -step


@inlined
def value_of(step: int, unit: float, steps: float) -> float:
    """The number at a step of its grid."""
    power = min(abs(step) // int(steps), FARTHEST)
    value = unit * (math.ldexp(1.0 + (abs(step) % int(steps)) / steps, power) - 1.0)
    return value if step >= 0 else -value


LAST_STEP = (FARTHEST + 1) << 20  # Beyond those of all grids


def _at(name: str) -> slice:
    """Where a field of a map's header is among the numbers."""
    kind, offset = Map.layout.fields[name][:2]  # type: ignore[index]
    return slice(AT_MAP + offset // 8, AT_MAP + (offset + kind.itemsize) // 8)


SHARES = _at("shares").start
OF_LAW = np.r_[PARAMETERS:AT_MAP, _at("law_surface"), _at("law_speed"), _at("law_reached")]
"""Numbers that no force depends on while the law has no weight."""

GROUPS = (
    OF_LAW,
    np.r_[_at("shares")],
    np.r_[_at("touch"), _at("touch_way"), _at("touch_force")],
    np.r_[_at("zero")],
    np.r_[_at("felt")],
    np.r_[_at("lowest")],
)
"""Numbers of a map's header in groups: a group whose change the operator would not feel is not sent."""

IDLE = np.full(COUNT, 0.5)
"""Steps within which a number stays as it was. To dither between two steps costs bits; but what a map's own rules
compare with another number is rounded to the nearest."""
IDLE[AT_MAP + HEADER : AT_SPACE] = IDLE[_at("shares")] = 0.7
IDLE[_at("uncertainty")] = 2.0

LAW = Map.layout.fields["law"][1] // 8  # type: ignore[index]  # In a map, where its parameters stand, too


@compiled
def write_map(steps: Steps, grids: Numbers, maps: NDArray[np.void]) -> None:
    """Write the map of these steps; the weights of experts sum to 1."""
    numbers, learnt = maps.view(np.float64), maps[0]
    for k in range(SIZE):
        numbers[k] = value_of(steps[AT_MAP + k], grids[AT_MAP + k, 0], grids[AT_MAP + k, 1])
    for k in range(4):
        learnt.law[k] = value_of(steps[PARAMETERS + k], grids[PARAMETERS + k, 0], grids[PARAMETERS + k, 1])
    law = min(max(learnt.shares[0], 0.0), 1.0)
    fine = min(max(learnt.shares[2], 0.0), 1.0 - law)
    learnt.shares[0], learnt.shares[1], learnt.shares[2] = law, 1.0 - law - fine, fine


@compiled
def mark_needed(steps: Steps, grids: Numbers, maps: NDArray[np.void], needed: NDArray[np.int8]) -> None:
    """Mark the numbers of a map that are written: those that a force is computed from, by the steps of its header."""
    write_map(steps, grids, maps)
    mark(maps, needed)
    needed[SHARES + 1 - AT_MAP] = 0  # follows from the others
    for k in range(4):
        needed[LAW + k] = 0


@compiled
def drop_unneeded(steps: Steps, base: Steps, grids: Numbers, maps: NDArray[np.void]) -> None:
    """Let the steps be those of the base that are not written. The map is written."""
    needed = scratch(np.int8, SIZE)
    mark_needed(steps, grids, maps, needed)
    for k in range(HEADER, SIZE):
        if needed[k] == 0:
            steps[AT_MAP + k] = base[AT_MAP + k]


@kernel("(f8[::1], f8[:, ::1], i8[::1], i8[::1], Map[::1], b1)")
def settle(numbers: Numbers, grids: Numbers, base: Steps, steps: Steps, maps: NDArray[np.void], errors: bool) -> None:
    """Write the steps of a model's numbers, shape (COUNT,): those of the base where a number is not needed, or idle.

    Args:
        numbers: Of the model.
        grids: Theirs.
        base: Steps of the model that the other end has.
        steps: Written.
        maps: An array of one, which is written.
        errors: Whether those numbers are needed, too, that only people look at.
    """
    for k in range(COUNT):
        exact = _step_of(numbers[k], grids[k, 0], grids[k, 1])
        steps[k] = base[k] if abs(exact - base[k]) <= IDLE[k] else round(exact)
    steps[SHARES + 1] = 0
    for k in range(4):
        steps[AT_MAP + LAW + k] = base[AT_MAP + LAW + k]
    if steps[SHARES] == 0 and maps.size > 0 and not errors:
        for k in OF_LAW:
            steps[k] = base[k]
    drop_unneeded(steps, base, grids, maps)
    if not errors:
        for k in range(AT_ERRORS, COUNT):
            steps[k] = base[k]


@kernel("(i8[::1], f8[:, ::1], f8[::1], Map[::1])")
def unsettle(steps: Steps, grids: Numbers, numbers: Numbers, maps: NDArray[np.void]) -> None:
    """Write the numbers and the map of these steps."""
    for k in range(COUNT):
        numbers[k] = value_of(steps[k], grids[k, 0], grids[k, 1])
    write_map(steps, grids, maps)


def _parts() -> Steps:
    """Parts of the numbers: begin, end, kind, and distance of the neighbour in the row before; shape (parts, 4)."""
    rows = [(0, AT_MAP + HEADER, 1, 0)]
    at = AT_MAP + HEADER
    for number, grid in enumerate((COARSE, FINE)):
        rows.append((at, at + 2 * grid.features, 2, 0))
        at += 2 * grid.features
        rows.append((at, at + grid.knots, 3 + 2 * number, 0))
        at += grid.knots
        for feature in range(grid.features):
            rows.append((at, at + grid.feature_knots, 4 + 2 * number, grid.feature_knots if feature else 0))
            at += grid.feature_knots
    rows += [(AT_SPACE, AT_ERRORS, 7, 0), (AT_ERRORS, COUNT, 8, 0)]
    return np.array(rows)


PARTS = _parts()

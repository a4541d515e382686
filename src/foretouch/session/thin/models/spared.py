"""What of a model need not cross: numbers that stay as the other end has them, where nobody feels the difference."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import compiled, kernel
from foretouch.core.compiling import inlined, scratch
from foretouch.models.contact_map.layout import PLAYS, Map
from foretouch.models.law_kernel import Law
from foretouch.models.predictor_kernel import copy
from foretouch.session.thin.models.compact import AT_MAP, AT_SPACE, GROUPS, PARTS, drop_unneeded, value_of, write_map
from foretouch.session.thin.models.felt import (
    AT_EDGE,
    EDGE,
    IN_AIR,
    INSIDE,
    NO_TIME,
    POINTS,
    Touches,
    force_at,
)

UNFELT, UNFELT_SHARE = 0.012, 0.018
"""Change of force by rounding, at most, where the material was touched [N], or as a part of the force."""

AIR_SPEED, PART_OF_SPEED = 0.02, 0.4  # Speed in the air [m/s], and the part of the largest speed in contact elsewhere


@compiled
def _place(touches: Touches, point: int, zero: float, position: float, velocity: float, average: float) -> None:
    """Write a point where the probe moves with this velocity, and has been at this mean depth [m from the origin]."""
    back = 0.0 if velocity == 0.0 else math.copysign(1.0, velocity)
    memory = touches.memories[point]
    memory[0], memory[1] = zero + position - back * PLAYS[0], zero + position - back * PLAYS[1]
    memory[2] = memory[3] = memory[4] = zero + max(average, 0.0)
    memory[5] = 0.0 if velocity > 0.0 else 1.0
    touches.positions[point], touches.velocities[point] = zero + position, velocity
    touches.aheads[point], touches.known[point] = NO_TIME, 1


@compiled
def _place_all(law: Law, surface: float, touches: Touches) -> None:
    """Write the points at the edge, inside and in the air, of what a map knows of them."""
    learnt, zero = law.map, surface + law.map.origin
    speed, point = PART_OF_SPEED * max(learnt.law_speed, AIR_SPEED), AT_EDGE
    deepest = max(learnt.reached - learnt.touch, 0.0)
    for index in range(len(EDGE) + INSIDE):
        away = EDGE[index] if index < len(EDGE) else (index - len(EDGE) + 1.0) / INSIDE * deepest
        position = learnt.touch + min(away, deepest)
        _place(touches, point, zero, position, speed, 0.5 * position)
        _place(touches, point + 1, zero, position, -speed, 0.5 * (position + learnt.reached))
        point += 2
    for index in range(IN_AIR):
        position = learnt.touch - (index + 1.0) / IN_AIR * max(learnt.touch - learnt.lowest, 0.0)
        _place(touches, point + index, zero, position, AIR_SPEED, 0.0)


@compiled
def _is_near(law: Law, surface: float, touches: Touches, forces: NDArray[np.float64], limit: float) -> bool:
    """Whether a law gives these forces [N] at all points, but for this part of what rounding may change."""
    for point in range(POINTS - 1, -1, -1):
        if touches.known[point] != 0:
            wrong = abs(force_at(law, surface, touches, point) - forces[point])
            if not wrong <= limit * max(UNFELT, UNFELT_SHARE * abs(forces[point])):
                return False
    return True


SHORTER = (62, 5, 4, 3, 2, 1)
"""Bits by which the differences of a part are shortened where nobody feels it: all of them, or some."""

MOST_OF_A_PART = 64
MAP_IN_LAW = Law.layout.fields["map"][1] // 8  # type: ignore[index]
ALL_GROUPS, GROUP_ENDS = np.concatenate(GROUPS), np.cumsum([0, *map(len, GROUPS)])


@inlined
def rounded(value: int, bits: int) -> int:
    """The nearest multiple of a power of two."""
    return ((value + ((1 << bits) >> 1)) >> bits) << bits


@compiled
def _spare_header(
    steps: NDArray[np.int64],
    base: NDArray[np.int64],
    grids: NDArray[np.float64],
    seen: float,
    others: NDArray[np.void],
    maps: NDArray[np.void],
    touches: Touches,
    wanted: NDArray[np.float64],
    limit: float,
) -> None:
    """The same for groups of numbers of the header."""
    numbers, kept = others.view(np.float64)[MAP_IN_LAW:], scratch(np.int64, MOST_OF_A_PART)
    for group in range(len(GROUP_ENDS) - 1):
        begin, end, changed = GROUP_ENDS[group], GROUP_ENDS[group + 1], False
        for k in range(begin, end):
            at = ALL_GROUPS[k]
            changed = changed or steps[at] != base[at]
            kept[k - begin], steps[at] = steps[at], base[at]
        if not changed:
            continue
        write_map(steps, grids, maps)
        copy(maps.view(np.float64), numbers)
        fits = maps[0].lowest <= maps[0].reached and maps[0].hold <= maps[0].catch
        if not (fits and _is_near(others[0], seen, touches, wanted, limit)):
            for k in range(begin, end):
                steps[ALL_GROUPS[k]] = kept[k - begin]
    drop_unneeded(steps, base, grids, maps)
    copy(maps.view(np.float64), numbers)


@kernel("(i8[::1], i8[::1], f8[:, ::1], Law[::1], f8, f8, Law[::1], Map[::1], Touches, f8)", Map)
def spare(
    steps: NDArray[np.int64],
    base: NDArray[np.int64],
    grids: NDArray[np.float64],
    laws: NDArray[np.void],
    surface: float,
    seen: float,
    others: NDArray[np.void],
    maps: NDArray[np.void],
    touches: Touches,
    limit: float,
) -> None:
    """Let the steps of a contact map be those of the base, part by part, where that cannot be felt.

    Args:
        steps: Of the map; written.
        base: Of the model that the other end has.
        grids: Theirs.
        laws: An array of one, the map as it is.
        surface: Its surface [m].
        seen: Surface as the other end has it [m].
        others: An array of one, which is written.
        maps: The same.
        touches: Points where forces are compared.
        limit: Part of what rounding may change.
    """
    wanted, kept = scratch(np.float64, POINTS), scratch(np.int64, MOST_OF_A_PART)
    _place_all(laws[0], surface, touches)
    for point in range(POINTS):
        wanted[point] = force_at(laws[0], surface, touches, point) if touches.known[point] != 0 else 0.0
    others[0].kind = laws[0].kind
    _spare_header(steps, base, grids, seen, others, maps, touches, wanted, limit)
    numbers = others.view(np.float64)[MAP_IN_LAW:]
    for part in range(len(PARTS) - 1, 0, -1):
        begin, end = PARTS[part, 0], PARTS[part, 1]
        if begin >= AT_SPACE:
            continue
        for k in range(begin, end):
            kept[k - begin] = steps[k]
        for bits in (*SHORTER, 0):
            changed = False
            for k in range(begin, end):
                steps[k] = base[k] + rounded(kept[k - begin] - base[k], bits)
                numbers[k - AT_MAP] = value_of(steps[k], grids[k, 0], grids[k, 1])
                changed = changed or steps[k] != kept[k - begin]
            if not changed or _is_near(others[0], seen, touches, wanted, limit):
                break

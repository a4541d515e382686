"""How far apart two models are at the leader's hand: their forces where the material was touched.

An update shows the material's memory, whose inner play says where the probe is to 0.1 mm, and which way it went.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.core.compiling import inlined, scratch
from foretouch.errors import InputError
from foretouch.messages import ModelUpdate
from foretouch.models import ContactMapModel, ContactModel, make_model
from foretouch.models.contact_map.layout import MEMORY, PLAYS, SIZE, Map
from foretouch.models.law_kernel import Law, advance, form_of
from foretouch.models.predictor_kernel import copy
from foretouch.session.thin.compact import AT_MAP, AT_SPACE, GROUPS, PARTS, drop_unneeded, value_of, write_map

JND_SHARE, JND_FORCE = 0.1, 0.05
"""Just noticeable difference of force: a part of the force, and at least this [N], as reports have it."""

RECENT, APART = 16, 0.055
"""Newest touches, and the least time between two of them [s]: a press and what comes after it."""

DEPTHS, NEAREST, IN_A_DOUBLING = 32, 2e-5, 3
"""Classes of depth in each of which the newest touch is kept, inwards and outwards: even up to the nearest [m], and so
many in each doubling from there on."""

HORIZONS = (0.1, 0.2, 0.4)
"""How far ahead of the newest touch forces are compared, too [s], no deeper than was visited: the leader is ahead by
the round trip."""

SIDES = 3  # Points of a recent touch: in the middle of the inner play, and near both of its ends
WITHIN = 0.97  # Of its radius: the ends themselves lie on a grid of counts, where models have their edges
AT_DEPTHS = SIDES * RECENT
AT_HORIZONS = AT_DEPTHS + 2 * DEPTHS
AT_EDGE = AT_HORIZONS + len(HORIZONS)

EDGE = 1e-3 * np.array([-2.0, -1.4, -1.0, -0.6, -0.4, -0.2, -0.1, -0.05, -0.02, 0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8])
"""Distances from where the material was touched first [m] at which rounding is looked at, inwards and outwards; beside
them, in so many even steps, the depth that was visited, and the free air."""
INSIDE, IN_AIR = 8, 4
AIR_SPEED, PART_OF_SPEED = 0.02, 0.4  # Speed there [m/s], and the part of the largest speed in contact elsewhere

POINTS = AT_EDGE + 2 * (len(EDGE) + INSIDE) + IN_AIR

NO_TIME = 1e-9  # Time in which no average moves [s]


class Touches(Record):
    """Points at which forces are compared; positions and memories [m] count as the surface's position does."""

    count: int  # of recent touches so far
    near: float = math.nan  # where the inner play was at the newest update [m]
    time: float  # of it [s]
    newest: float = -math.inf  # when the newest recent touch began [s]
    known: Annotated[NDArray[Any], int, POINTS]  # whether there is one
    positions: Annotated[NDArray[Any], float, POINTS]
    velocities: Annotated[NDArray[Any], float, POINTS]
    aheads: Annotated[NDArray[Any], float, POINTS]  # time since the memory [s]
    memories: Annotated[NDArray[Any], float, (POINTS, MEMORY)]
    forces: Annotated[NDArray[Any], float, POINTS]  # of the law that the leader has [N]


@compiled
def _force(law: Law, surface: float, touches: Touches, point: int) -> float:
    """Force of a law with its surface [m] at a point [N]."""
    memory, zero = touches.memories[point], surface + law.map.origin
    before = (
        memory[0] - zero,
        memory[1] - zero,
        max(memory[2] - zero, 0.0),
        max(memory[3] - zero, 0.0),
        max(memory[4] - zero, 0.0),
        memory[5],
    )
    depth, velocity = touches.positions[point] - surface, touches.velocities[point]
    return float(advance(law, before, depth, velocity, touches.aheads[point])[1])


@compiled
def _noticed(first: float, second: float) -> float:
    """Difference of two forces, in just noticeable differences."""
    return abs(first - second) / max(JND_FORCE, JND_SHARE * max(abs(first), abs(second)))


@kernel("(Law[::1], f8, Touches)")
def remember(laws: NDArray[np.void], surface: float, touches: Touches) -> None:
    """The leader has this law from now on."""
    for point in range(AT_EDGE):
        if touches.known[point] != 0:
            touches.forces[point] = _force(laws[0], surface, touches, point)


@kernel("f8(Law[::1], f8, Touches)")
def gap(laws: NDArray[np.void], surface: float, touches: Touches) -> float:
    """The largest difference of a law to that which the leader has, in just noticeable differences."""
    largest = 0.0
    for point in range(AT_EDGE):
        if touches.known[point] != 0:
            largest = max(largest, _noticed(_force(laws[0], surface, touches, point), touches.forces[point]))
    return largest


@kernel("f8(Law[::1], f8, Law[::1], f8, Touches)")
def apart(laws: NDArray[np.void], surface: float, others: NDArray[np.void], other: float, touches: Touches) -> float:
    """The largest difference between two laws with their surfaces [m], in just noticeable differences."""
    largest = 0.0
    for point in range(AT_EDGE):
        if touches.known[point] != 0:
            force = _force(laws[0], surface, touches, point)
            largest = max(largest, _noticed(force, _force(others[0], other, touches, point)))
    return largest


@compiled
def _note(touches: Touches, point: int, state: tuple[float, ...], zero: float, away: float, ahead: float) -> None:
    """Write a point: so far from the inner play, so long after the memory."""
    for index in range(MEMORY):
        touches.memories[point, index] = state[index] + zero
    touches.memories[point, MEMORY - 1] = state[MEMORY - 1]
    touches.positions[point] = state[0] + zero + away
    touches.aheads[point] = ahead
    touches.known[point] = 1


@kernel("(Law[::1], f8, UniTuple(f8, 6), f8, Law[::1], f8, Touches)")
def touch(
    laws: NDArray[np.void],
    surface: float,
    state: tuple[float, ...],
    time: float,
    formers: NDArray[np.void],
    former: float,
    touches: Touches,
) -> None:
    """Remember where the material is touched, if it is.

    Args:
        laws: An array of one, the newest law.
        surface: Its surface [m].
        state: Memory of the material.
        time: Time of it [s].
        formers: An array of one, the law that the leader has.
        former: Its surface [m].
        touches: Written.
    """
    zero = surface + laws[0].map.origin
    near, before, since = state[0] + zero, touches.near, time - touches.time
    touches.near, touches.time = near, time
    if not math.isfinite(near):
        return
    velocity = (near - before) / since if since > 0.0 and math.isfinite(before) else 0.0
    fresh = time - touches.newest >= APART
    first = SIDES * ((touches.count if fresh else max(touches.count - 1, 0)) % RECENT)
    felt = 0.0
    for side in range(SIDES):
        point = first + side
        _note(touches, point, state, zero, (side - 1) * WITHIN * PLAYS[0], NO_TIME)
        touches.velocities[point] = velocity
        felt = max(felt, abs(_force(laws[0], surface, touches, point)))
        touches.forces[point] = _force(formers[0], former, touches, point)
    if felt < 0.5 * JND_FORCE:
        for side in range(SIDES):
            touches.known[first + side] = 0
        return
    if fresh:
        touches.count, touches.newest = touches.count + 1, time
    depth = int(IN_A_DOUBLING * math.log2(1.0 + max(near - surface, 0.0) / NEAREST))
    point = AT_DEPTHS + 2 * min(depth, DEPTHS - 1) + (1 if velocity < 0.0 else 0)
    _note(touches, point, state, zero, WITHIN * PLAYS[0] if velocity > 0.0 else -WITHIN * PLAYS[0], NO_TIME)
    touches.velocities[point] = velocity
    touches.forces[point] = _force(formers[0], former, touches, point)
    for index in range(len(HORIZONS)):
        point = AT_HORIZONS + index
        away = min(velocity * HORIZONS[index], max(laws[0].map.reached - state[0], 0.0))
        _note(touches, point, state, zero, away, HORIZONS[index])
        touches.velocities[point] = velocity
        touches.forces[point] = _force(formers[0], former, touches, point)


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
    """Whether a law gives these forces at all points, but for so many just noticeable differences."""
    for point in range(POINTS - 1, -1, -1):
        if touches.known[point] != 0 and not _noticed(_force(law, surface, touches, point), forces[point]) <= limit:
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


@kernel("(i8[::1], i8[::1], f8[:, ::1], Law[::1], f8, f8, Law[::1], Map[::1], Touches, f8)")
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
        limit: Difference that cannot be felt, in just noticeable differences.
    """
    wanted, kept = scratch(np.float64, POINTS), scratch(np.int64, MOST_OF_A_PART)
    _place_all(laws[0], surface, touches)
    for point in range(POINTS):
        wanted[point] = _force(laws[0], surface, touches, point) if touches.known[point] != 0 else 0.0
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


def law_of(update: ModelUpdate) -> tuple[NDArray[np.void], ContactMapModel | None]:
    """The law of a model, an array of one, and its map; no law where it is not valid or cannot be evaluated."""
    model: ContactModel | None = None
    if update.valid:
        try:
            model = make_model(update.law, update.parameters, update.map)
        except InputError:
            model = None
    law = Law.new()
    law["kind"], law["numbers"][0], law["map"] = form_of(model)
    return law, model if isinstance(model, ContactMapModel) else None


FIXTURE_CHANGE = (1e-4, 1e-3)  # Motion [m] and turn [rad] of a fixture that is felt


def moved(before: tuple[float, ...], now: tuple[float, ...]) -> bool:
    """Whether a fixture has moved, or turned, by more than is felt."""
    if len(before) != len(now):
        return True
    return any(abs(a - b) > FIXTURE_CHANGE[index // 3] for index, (a, b) in enumerate(zip(before, now, strict=True)))

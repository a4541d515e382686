"""How far apart two models are at the leader's hand: their forces where the material was touched.

An update shows the material's memory, whose inner play says where the probe is to 0.1 mm, and which way it went.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.errors import InputError
from foretouch.messages import ModelUpdate
from foretouch.models import ContactMapModel, ContactModel, make_model
from foretouch.models.contact_map.layout import MEMORY, PLAYS
from foretouch.models.law_kernel import Law, advance, form_of

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
def force_at(law: Law, surface: float, touches: Touches, point: int) -> float:
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
def noticed(first: float, second: float) -> float:
    """Difference of two forces, in just noticeable differences."""
    return abs(first - second) / max(JND_FORCE, JND_SHARE * max(abs(first), abs(second)))


@kernel("(Law[::1], f8, Touches)")
def remember(laws: NDArray[np.void], surface: float, touches: Touches) -> None:
    """The leader has this law from now on."""
    for point in range(AT_EDGE):
        if touches.known[point] != 0:
            touches.forces[point] = force_at(laws[0], surface, touches, point)


@kernel("f8(Law[::1], f8, Touches)")
def gap(laws: NDArray[np.void], surface: float, touches: Touches) -> float:
    """How far the force of a law is from that of the leader's law at most [just noticeable differences]."""
    largest = 0.0
    for point in range(AT_EDGE):
        if touches.known[point] != 0:
            largest = max(largest, noticed(force_at(laws[0], surface, touches, point), touches.forces[point]))
    return largest


@kernel("f8(Law[::1], f8, Law[::1], f8, Touches)")
def apart(laws: NDArray[np.void], surface: float, others: NDArray[np.void], other: float, touches: Touches) -> float:
    """The largest difference between two laws with their surfaces [m], in just noticeable differences."""
    largest = 0.0
    for point in range(AT_EDGE):
        if touches.known[point] != 0:
            force = force_at(laws[0], surface, touches, point)
            largest = max(largest, noticed(force, force_at(others[0], other, touches, point)))
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
        felt = max(felt, abs(force_at(laws[0], surface, touches, point)))
        touches.forces[point] = force_at(formers[0], former, touches, point)
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
    touches.forces[point] = force_at(formers[0], former, touches, point)
    for index in range(len(HORIZONS)):
        point = AT_HORIZONS + index
        away = min(velocity * HORIZONS[index], max(laws[0].map.reached - state[0], 0.0))
        _note(touches, point, state, zero, away, HORIZONS[index])
        touches.velocities[point] = velocity
        touches.forces[point] = force_at(formers[0], former, touches, point)


SUPPOSED = 1e-3 * np.array([0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0])
SUPPOSED_SPEEDS = np.array([-0.03, 0.0, 0.03])
"""Depths [m] and speeds [m/s] at which laws without memory are compared."""


@kernel("(f8, Law[::1], f8, Touches)")
def suppose(surface: float, formers: NDArray[np.void], former: float, touches: Touches) -> None:
    """Suppose that the material is touched as most are, from this surface [m] on; the others are those of `touch`."""
    point = AT_DEPTHS
    for index in range(len(SUPPOSED)):
        for speed in SUPPOSED_SPEEDS:
            touches.positions[point], touches.velocities[point] = surface + SUPPOSED[index], speed
            touches.aheads[point], touches.known[point] = NO_TIME, 1
            touches.forces[point] = force_at(formers[0], former, touches, point)
            point += 1


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

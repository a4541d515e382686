"""How far apart two models are at the leader's hand: forces of both, where the material was touched.

An update shows the material's memory, whose inner play says where the probe is to 0.1 mm and which way it went.
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

ROOM = 48
"""Touches that are remembered, the newest: about a second in contact. Where nothing is learnt, nothing changes."""

JND_SHARE, JND_FORCE = 0.1, 0.05
"""Just noticeable difference of force: a part of the force, and at least this [N], as reports have it."""

HORIZONS = (0.1, 0.2, 0.4)
"""How far ahead of the newest touch models are compared, too [s]: the leader is ahead by the round trip."""

NO_TIME = 1e-9  # Time in which no average moves [s]


class Touches(Record):
    """Touches of the material: positions [m] and memories in the frame of the surface's position."""

    count: int  # of all so far
    near: float  # where the inner play was at the newest update [m], NaN before the first
    time: float  # of it [s]
    velocities: Annotated[NDArray[Any], float, ROOM]
    memories: Annotated[NDArray[Any], float, (ROOM, MEMORY)]


@compiled
def _force(law: Law, surface: float, memory: NDArray[np.float64], position: float, velocity: float, ahead: float) -> float:
    """Force of a law [N] at a position, some time after the memory was this."""
    zero = surface + law.map.origin
    before = (
        memory[0] - zero,
        memory[1] - zero,
        max(memory[2] - zero, 0.0),
        max(memory[3] - zero, 0.0),
        max(memory[4] - zero, 0.0),
        memory[5],
    )
    return float(advance(law, before, position - surface, velocity, ahead)[1])


@compiled
def _gap(first: float, second: float) -> float:
    """Difference of two forces, in just noticeable differences."""
    return abs(first - second) / max(JND_FORCE, JND_SHARE * max(abs(first), abs(second)))


@kernel("f8(Law[::1], f8, Law[::1], f8, Touches)", Law)
def gap(laws: NDArray[np.void], surface: float, formers: NDArray[np.void], former: float, touches: Touches) -> float:
    """The largest difference of force between two laws with their surfaces [m], in just noticeable differences."""
    largest = 0.0
    law, other = laws[0], formers[0]
    for index in range(min(touches.count, ROOM)):
        memory, velocity = touches.memories[index], touches.velocities[index]
        for side in range(-1, 2):
            position = memory[0] + side * PLAYS[0]
            mine = _force(law, surface, memory, position, velocity, NO_TIME)
            largest = max(largest, _gap(mine, _force(other, former, memory, position, velocity, NO_TIME)))
    if touches.count > 0:
        newest = (touches.count - 1) % ROOM
        memory, velocity = touches.memories[newest], touches.velocities[newest]
        for ahead in HORIZONS:
            position = memory[0] + velocity * ahead
            mine = _force(law, surface, memory, position, velocity, ahead)
            largest = max(largest, _gap(mine, _force(other, former, memory, position, velocity, ahead)))
    return largest


@kernel("b1(Law[::1], f8, UniTuple(f8, 6), f8, Touches)", Law)
def touch(
    laws: NDArray[np.void], surface: float, state: tuple[float, ...], time: float, touches: Touches
) -> bool:
    """Remember where the material is touched; whether it is."""
    law = laws[0]
    zero = surface + law.map.origin
    near, before, since = state[0] + zero, touches.near, time - touches.time
    touches.near, touches.time = near, time
    if not math.isfinite(near):
        return False
    at = touches.count % ROOM
    for index in range(5):
        touches.memories[at, index] = state[index] + zero
    touches.memories[at, 5] = state[5]
    touches.velocities[at] = (near - before) / since if since > 0.0 and math.isfinite(before) else 0.0
    memory = touches.memories[at]
    felt = 0.0
    for side in range(-1, 2):
        force = _force(law, surface, memory, near + side * PLAYS[0], touches.velocities[at], NO_TIME)
        felt = max(felt, abs(force))
    if felt > 0.5 * JND_FORCE:
        touches.count += 1
        return True
    return False


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

"""Rigid contact: a wall that stands elsewhere than at first, and free air before it."""

from __future__ import annotations

import numpy as np
import pytest

from foretouch.identification import ContactMap, Learner, predict
from foretouch.models import ContactMapModel, advance
from foretouch.quantities import Array, Recording

TIME = np.arange(0.0, 24.0, 1e-3)
WALL, MOVED = 0.010, 12.0


def pressed(depths: tuple[float, float], seed: int, varied: float) -> Array:
    """Depth [m] of touches from 4 mm outside, up to so much that varies by a fraction, another one after 12 s."""
    random, begin = np.random.default_rng(seed), 1.0
    part = np.clip(TIME / 0.6, 0.0, 1.0)
    depth = part**3 * (10.0 - 15.0 * part + 6.0 * part * part) * (WALL - 0.004) - WALL
    while begin < TIME[-1]:
        length = 1.2 * random.uniform(0.8, 1.2)
        deepest = depths[int(begin >= MOVED)] * random.uniform(1.0 - varied, 1.0 + varied)
        inside = (begin <= TIME) & (begin + length > TIME)
        depth[inside] += 0.5 * (deepest + 0.004) * (1.0 - np.cos(2.0 * np.pi * (TIME[inside] - begin) / length))
        begin += length
    return depth


def felt(position: Array, force: Array, seed: int) -> Recording:
    noise = np.random.default_rng(seed + 1).normal(0.0, 0.02, TIME.size)
    return Recording(TIME, np.round(position, 6), force + 0.3 + noise)


def touched(moved: float, seed: int) -> tuple[Recording, Array]:
    """Touches of 0.4 mm by a hand that follows a wall of 20 kN/m, which moves after 12 s; and the true force [N]."""
    depth = pressed((0.0004, 0.0004), seed, 0.25)
    force = np.maximum(2e4 * np.maximum(depth, 0.0) * (1.0 + 2.0 * np.gradient(depth, TIME)), 0.0)
    return felt(WALL + depth + moved * (TIME >= MOVED), force, seed), force


@pytest.mark.parametrize(
    "seed", [20, pytest.param(21, marks=pytest.mark.long), pytest.param(22, marks=pytest.mark.long)]
)
@pytest.mark.parametrize("moved", [0.0, 0.003, -0.003, 0.0055])
@pytest.mark.first
def test_a_wall_is_learnt_wherever_it_stands(moved: float, seed: int) -> None:
    recording, force = touched(moved, seed)
    predicted, late = predict(recording, Learner(), delay=0.3).force, TIME > 19.0
    error = np.sqrt(np.mean((predicted - force)[late & ((force > 0.4) | (predicted > 0.4))] ** 2))
    assert error < 0.03 * np.sqrt(np.mean(force[late & (force > 0.4)] ** 2))


def test_the_fine_map_is_where_the_wall_is() -> None:
    recording, _ = touched(0.003, 20)
    learner = Learner()
    learner.run(recording.time, recording.position, recording.force)
    estimator = learner.estimator
    assert isinstance(estimator, ContactMap)
    learnt, model = estimator.states[0].map[0], estimator.model
    assert isinstance(model, ContactMapModel)
    assert model.shares[2] > 0.9
    assert learnt.place - learnt.origin + learner.conditioner.surface == pytest.approx(WALL + 0.003, abs=0.5e-3)


@pytest.mark.parametrize("velocity", [-0.2, 0.0, 0.2])
def test_nothing_is_felt_outside_of_where_the_wall_was_touched(velocity: float) -> None:
    recording, _ = touched(0.0, 20)
    learner = Learner()
    learner.run(recording.time, recording.position, recording.force)
    model, surface = learner.learnt().model, learner.learnt().surface
    assert model is not None
    for away in (0.4e-3, 1e-3, 3e-3):
        assert advance(model, learner.learnt().state, WALL - away - surface, velocity, 1e-3)[1] == 0.0
    assert advance(model, learner.learnt().state, WALL + 0.3e-3 - surface, 0.0, 1e-3)[1] > 4.0


@pytest.mark.parametrize(("hardness", "deepest"), [(10.0, 0.0056), (66.0, 0.0053)])
@pytest.mark.first
def test_a_hard_layer_takes_nothing_from_what_is_known_above_it(hardness: float, deepest: float) -> None:
    """Soft tissue of 400 N/m; a layer so many times as stiff 5 mm below its surface is reached from 12 s on."""
    depth = pressed((0.004, deepest), 30, 0.05)
    force = 400.0 * (np.maximum(depth, 0.0) + (hardness - 1.0) * np.maximum(depth - 0.005, 0.0))
    predicted = predict(felt(WALL + depth, force, 30), Learner(), delay=0.3).force
    above = (TIME[depth > 0.005][0] < TIME) & (depth > 0.0005) & (depth < 0.0048)
    assert np.sqrt(np.mean((predicted - force)[above] ** 2)) < 0.03 * np.sqrt(np.mean(force[above] ** 2))

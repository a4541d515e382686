"""What pulls is learnt and predicted, and nothing else is taken for it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.identification import Learner, SensorState, SensorWatch, predict
from foretouch.models import ContactMapModel
from foretouch.quantities import Array, Recording
from foretouch.report import delayed_force, score_prediction
from foretouch.robot import make_material

TIME = np.arange(0.0, 16.0, 1e-3)
SURFACE, DELAY, ZERO = 0.010, 0.3, 0.3


def pressed(seed: int, deepest: float = 0.006) -> Array:
    """Positions: 12 mm in, and presses of 0.6 to 0.9 of the deepest from 3 mm outside of the surface."""
    random, begin = np.random.default_rng(seed), 1.0
    part = np.clip(TIME / 0.6, 0.0, 1.0)
    position = part**3 * (10.0 - 15.0 * part + 6.0 * part * part) * (SURFACE - 0.003)
    while begin < TIME[-1]:
        length, depth = random.uniform(0.9, 1.5), deepest * random.uniform(0.6, 0.9)
        inside = (begin <= TIME) & (begin + length > TIME)
        position[inside] += 0.5 * (depth + 0.003) * (1.0 - np.cos(2.0 * np.pi * (TIME[inside] - begin) / length))
        begin += length
    return position


def sticky(position: Array) -> Array:
    """The force of the simulated gel, which pulls with 1 N [N]."""
    law, force = make_material("adhesive").model, np.empty(position.size)
    state = law.initial_state()
    for index, depth in enumerate((position - SURFACE).tolist()):
        state, force[index], _ = law.advance(state, depth, 0.0, 1e-3)
    return force


def sensed(force: Array, seed: int) -> Array:
    return force + ZERO + np.random.default_rng(seed).normal(0.0, 0.02, force.size)


def pull_of(learner: Learner) -> float:
    model = learner.estimator.model
    assert isinstance(model, ContactMapModel)
    return float(model.record[0].pull)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.first
def test_what_sticks_is_predicted(seed: int) -> None:
    position, learner = pressed(seed), Learner()
    true = sticky(position)
    sensor = sensed(true, seed)
    predicted = predict(Recording(TIME, position, sensor), learner, delay=DELAY).force
    late = TIME > 6.0
    assert learner.estimator.changes == 0
    assert learner.conditioner.force_offset == pytest.approx(ZERO, abs=0.02)
    assert pull_of(learner) == pytest.approx(-true.min(), abs=0.06)
    error = np.sqrt(np.mean((predicted - true)[late] ** 2) / np.mean(true[late] ** 2))
    assert error < 0.04
    pulled = late & (true < -0.2)
    assert np.sqrt(np.mean((predicted - true)[pulled] ** 2)) < 0.2 * np.sqrt(np.mean(true[pulled] ** 2))
    known = delayed_force(TIME, sensor, DELAY)
    scores = score_prediction(TIME, sensor, predicted, known, contact_floor=0.05, score_from=6.0, position=position)
    assert scores.in_contact[pulled].mean() > 0.95
    assert scores.prediction_error_percent == pytest.approx(100.0 * error, abs=1.0)


def friction(position: Array) -> Array:
    """A mechanism that rubs with 0.3 N against its motion, and not where it stands."""
    velocity = np.gradient(position, TIME)
    return 0.3 * velocity / (np.abs(velocity) + 2e-3)


@pytest.mark.parametrize(
    "unlike",
    [
        lambda position: np.zeros(position.size),
        friction,
        lambda position: -0.05 * TIME,
        lambda position: -1.0 * (TIME > 8.0),
        lambda position: -3.0 * (np.arange(TIME.size) % 997 == 0),
    ],
    ids=["nothing", "friction", "drift", "a zero that falls", "spikes"],
)
def test_nothing_else_is_a_pull(unlike) -> None:  # type: ignore[no-untyped-def]
    position, learner = pressed(5), Learner()
    force = 600.0 * np.maximum(position - SURFACE, 0.0)
    sensor = sensed(force + unlike(position), 5)
    learner.run(TIME, position, sensor)
    assert pull_of(learner) == 0.0
    known = delayed_force(TIME, sensor, DELAY)
    scores = score_prediction(TIME, sensor, sensor, known, contact_floor=0.05, score_from=3.0, position=position)
    assert not scores.in_contact[scores.measured_force < 0.0].any()


def test_a_probe_that_is_held_for_long_is_in_no_free_air() -> None:
    """For 11 s it stays half a millimetre outside of the surface, where it is pulled by 1 N, as it was before."""
    position, stay = pressed(4), (TIME > 3.0) & (TIME < 15.0)
    before, there = position[TIME <= 3.0][-1], SURFACE - 0.5e-3
    way = np.clip((TIME - 3.0) / 0.4, 0.0, 1.0)
    inside = before + (SURFACE + 0.004 - before) * np.sin(0.5 * np.pi * way)
    outwards = SURFACE + 0.004 + (there - SURFACE - 0.004) * np.clip(TIME - 3.4, 0.0, 1.0)
    position[stay] = np.where(TIME < 3.4, inside, outwards)[stay]
    position[TIME >= 15.0] = there
    learner = Learner()
    true = sticky(position)
    learner.run(TIME, position, sensed(true, 4))
    assert true[-1] < -0.9
    assert learner.conditioner.force_offset == pytest.approx(ZERO, abs=0.05)


@pytest.mark.parametrize("length", [0.4, 1.25, 5.0, 20.0])
def test_no_sensor_is_faulty_for_what_sticks(length: float) -> None:
    time = np.arange(0.0, 2.5 * length, 1e-3)
    position = SURFACE + 0.004 * np.sin(2.0 * np.pi * time / length - 0.5 * np.pi) - 1e-3
    sensor, watch = sensed(sticky(position), 1), SensorWatch((-50.0, 50.0))
    assert sensor.min() < -0.5
    for sample in zip(time.tolist(), position.tolist(), sensor.tolist(), strict=True):
        assert watch.update(*sample, zero=ZERO) is SensorState.GOOD, sample[0]


@pytest.mark.parametrize(("step", "latest"), [(-1.0, 0.7), (-2.5, 0.06)])
@pytest.mark.parametrize("begin", [2100, 2300, 2500, 2700])
def test_a_zero_that_falls_in_free_air_is_none_that_sticks(step: float, latest: float, begin: int) -> None:
    """What is as level further out, or pulls by more than 2 N, does not stick."""
    time = np.arange(0.0, 4.0, 1e-3)
    position = -0.02 + 0.005 * np.sin(8.0 * time)
    sensor, watch = sensed(np.where(time >= 1e-3 * begin, step, 0.0), 2), SensorWatch((-50.0, 50.0))
    found = math.inf
    for sample in zip(time.tolist(), position.tolist(), sensor.tolist(), strict=True):
        if watch.update(*sample, zero=ZERO) is not SensorState.GOOD:
            found = sample[0]
            break
    assert 0.0 < found - 1e-3 * begin < latest
    assert watch.state is SensorState.OFFSET_STEP

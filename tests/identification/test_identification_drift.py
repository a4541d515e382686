"""The zero of a force that drifts, that comes late, and that a material pulls below itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.identification import Learner, predict
from foretouch.quantities import Array, Recording
from foretouch.report import delayed_force, score_prediction

TIME = np.arange(0.0, 20.0, 1e-3)
SURFACE, DELAY = 0.010, 0.3


def pressed(seed: int) -> tuple[Array, Array]:
    """Positions of presses of 6 to 10 mm from 3 mm outside of the surface, and the force of a Hunt-Crossley law."""
    random, begin = np.random.default_rng(seed), 1.0
    part = np.clip(TIME / 0.6, 0.0, 1.0)
    position = part**3 * (10.0 - 15.0 * part + 6.0 * part * part) * (SURFACE - 0.003)
    while begin < TIME[-1]:
        length, depth = random.uniform(0.96, 1.44), random.uniform(0.006, 0.010)
        inside = (begin <= TIME) & (begin + length > TIME)
        position[inside] += 0.5 * (depth + 0.003) * (1.0 - np.cos(2.0 * np.pi * (TIME[inside] - begin) / length))
        begin += length
    depth = position - SURFACE
    force = 3000.0 * np.maximum(depth, 0.0) ** 1.4 * (1.0 + 0.5 * np.gradient(position, TIME))
    return position, np.maximum(force, 0.0)


def pulling(position: Array, force: Array) -> Array:
    """The same of a material that holds on to the probe with up to 1 N, from 2 mm inside to 2 mm outside."""
    depth, velocity, result, stuck = position - SURFACE, np.gradient(position, TIME), force.copy(), False
    for index, here in enumerate(depth.tolist()):
        stuck = here > 0.002 or (stuck and here >= -0.002)
        if stuck and velocity[index] < 0.0 and here < 0.002:
            result[index] = -math.sin(math.pi * (0.002 - here) / 0.004)
    return result


def error(predicted: Array, force: Array) -> float:
    """RMS error from 3 s on, in contact and where contact is predicted, relative to the RMS of the true force [%]."""
    least, late = 0.05 * np.percentile(force, 98.0), TIME > 3.0
    contact, scored = late & (force > least), late & ((force > least) | (predicted > least))
    return float(100.0 * np.sqrt(np.mean((predicted - force)[scored] ** 2) / np.mean(force[contact] ** 2)))


def said(position: Array, sensor: Array, learner: Learner) -> Array:
    return predict(Recording(TIME, position, sensor), learner, delay=DELAY).force


@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.long), pytest.param(5, marks=pytest.mark.long)])
@pytest.mark.parametrize("rate", [-0.05, 0.0, 0.02, 0.05])
@pytest.mark.first
def test_a_zero_that_drifts_is_followed(rate: float, seed: int) -> None:
    position, force = pressed(seed)
    zero, learner = 0.3 + rate * TIME, Learner()
    noise = np.random.default_rng(seed).normal(0.0, 0.02, TIME.size)
    predicted = said(position, force + zero + noise, learner)
    assert error(predicted, force) < 3.0
    assert learner.conditioner.force_offset == pytest.approx(zero[-1], abs=0.1)
    assert predicted[(position < SURFACE - 0.001) & (TIME > 3.0)].max() < 0.2
    assert learner.estimator.changes == 0


def test_a_spike_before_the_first_press_is_no_surface_from_which_all_is_contact() -> None:
    position, force = pressed(109)
    zero, learner = 0.3 + 0.05 * TIME, Learner()
    sensor = force + zero + np.random.default_rng(109).normal(0.0, 0.02, TIME.size)
    sensor[980:983] += 0.1
    assert error(said(position, sensor, learner), force) < 5.0
    assert learner.conditioner.force_offset == pytest.approx(zero[-1], abs=0.1)


@pytest.mark.parametrize("zero", [-0.5, 0.5])
@pytest.mark.first
def test_a_sensor_that_says_one_number_at_first_has_said_nothing(zero: float) -> None:
    position, force = pressed(6)
    sensor, learner = force + zero + np.random.default_rng(6).normal(0.0, 0.05, TIME.size), Learner()
    sensor[:100] = 0.0
    assert error(said(position, sensor, learner), force) < 3.0
    assert learner.conditioner.force_offset == pytest.approx(zero, abs=0.05)


def test_without_noise_a_number_that_lasts_is_the_zero() -> None:
    position, force = pressed(6)
    learner = Learner()
    assert error(said(position, force, learner), force) < 3.0
    assert learner.conditioner.force_offset == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("seed", [3, 7])
@pytest.mark.first
def test_what_pulls_is_no_zero_and_the_score_says_so_too(seed: int) -> None:
    position, force = pressed(seed)
    true, learner = pulling(position, force), Learner()
    sensor = true + 0.3 + np.random.default_rng(seed).normal(0.0, 0.02, TIME.size)
    predicted = said(position, sensor, learner)
    assert true.min() < -0.9
    assert error(predicted, true) < 5.0
    assert learner.conditioner.force_offset == pytest.approx(0.3, abs=0.05)
    known = delayed_force(TIME, sensor, DELAY)
    scores = score_prediction(TIME, sensor, predicted, known, contact_floor=0.05, score_from=3.0, position=position)
    assert scores.measured_force == pytest.approx(sensor - 0.3, abs=0.05)
    assert scores.prediction_error_percent < 5.0  # of what pulls, too
    assert scores.in_contact[(true < -0.5) & (TIME > 3.0)].all()


@pytest.mark.parametrize(("friction", "floor"), [(0.1, 0.05), (0.2, 0.05), (0.2, 0.3), (0.3, 0.3)])
@pytest.mark.first
def test_friction_in_free_air_is_no_contact(friction: float, floor: float) -> None:
    position, force = pressed(4)
    rubbing = friction * np.tanh(np.gradient(position, TIME) / 2e-3)
    sensor = force + 0.3 + rubbing + np.random.default_rng(4).normal(0.0, 0.02, TIME.size)
    learner = Learner(contact_floor=floor)
    predicted = said(position, sensor, learner)
    air = (position < SURFACE - 0.0005) & (TIME > 3.0)
    assert error(predicted, force + np.where(force > 0.0, rubbing, 0.0)) < 6.0
    assert predicted[air].max() < 0.35
    assert learner.conditioner.force_offset == pytest.approx(0.3, abs=0.02)
    assert learner.conditioner.records[0].air.known[2] == pytest.approx(friction, rel=0.2)
    assert learner.conditioner.surface == pytest.approx(SURFACE, abs=0.001)
    assert not Learner(contact_floor=floor).run(TIME, position, sensor).in_contact[air].any()


@pytest.mark.parametrize("friction", [0.05, 0.15])
def test_the_score_takes_the_level_of_free_air_for_its_zero(friction: float) -> None:
    position, force = pressed(4)
    sensor = force + 0.3 + friction * np.tanh(np.gradient(position, TIME) / 2e-3)
    scores = score_prediction(TIME, sensor, force, force, contact_floor=0.3, position=position)
    assert scores.force_zero_from == "level of free air"
    assert scores.force_zero_N == pytest.approx(0.3, abs=0.05)
    without = score_prediction(TIME, sensor, force, force, contact_floor=0.3)
    assert (without.force_zero_from, without.force_zero_N) == ("lowest 50 ms mean", pytest.approx(0.3 - friction))
    given = score_prediction(TIME, sensor, force, force, contact_floor=0.3, position=position, offset=0.31)
    assert (given.force_zero_from, given.force_zero_N) == ("given", 0.31)


@pytest.mark.parametrize("wrong", [-0.04, 0.0, 0.08])
@pytest.mark.first
def test_a_zero_that_is_given_with_an_error_is_where_it_begins(wrong: float) -> None:
    position, force = pressed(3)
    zero, learner = 0.3 + 0.02 * TIME, Learner(force_offset=0.3 + wrong, offset_error=0.05)
    sensor = force + zero + np.random.default_rng(3).normal(0.0, 0.02, TIME.size)
    assert learner.conditioner.force_offset == 0.3 + wrong
    assert error(said(position, sensor, learner), force) < 3.0
    assert learner.conditioner.force_offset == pytest.approx(zero[-1], abs=0.05)


def test_a_zero_that_is_given_stays() -> None:
    position, force = pressed(3)
    learner = Learner(force_offset=0.3)
    said(position, force + 0.3 + 0.02 * TIME, learner)
    assert learner.conditioner.force_offset == 0.3


@pytest.mark.parametrize("fall", [0.3, 1.0])
@pytest.mark.first
def test_a_zero_that_falls_at_once_is_followed_with_little_air(fall: float) -> None:
    position = 0.008 * np.clip(TIME / 0.6, 0.0, 1.0) + 0.0045 * (
        1.0 - np.cos(2.0 * np.pi * np.maximum(TIME - 1.0, 0.0) / 1.2)
    )
    force = 600.0 * np.maximum(position - SURFACE, 0.0)
    zero, learner = 0.3 - fall * (TIME > 8.0), Learner()
    predicted = said(position, force + zero + np.random.default_rng(8).normal(0.0, 0.02, TIME.size), learner)
    assert learner.conditioner.force_offset == pytest.approx(0.3 - fall, abs=0.05)
    late = TIME > 12.0
    assert np.sqrt(np.mean((predicted - force)[late] ** 2)) < 0.05 * np.sqrt(np.mean(force[late] ** 2))


def test_a_slow_first_press_of_something_soft_is_no_drift() -> None:
    position = np.minimum(0.004 + 0.001 * TIME, 0.02)
    force, learner = 30.0 * np.maximum(position - SURFACE, 0.0), Learner()
    learner.run(TIME, position, force + 0.3 + np.random.default_rng(9).normal(0.0, 0.01, TIME.size))
    assert learner.conditioner.in_contact
    assert learner.conditioner.force_offset == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_the_steps_of_a_sensor_are_no_noise(step: float) -> None:
    position = 0.008 + 0.0025 * (1.0 - np.cos(2.0 * np.pi * TIME / 1.2))
    force, learner = 500.0 * np.maximum(position - SURFACE, 0.0), Learner()
    learner.run(TIME, position, np.round((force + 0.3) / step) * step)
    assert learner.conditioner.force_offset == pytest.approx(0.3, abs=1e-6)
    assert learner.conditioner.surface == pytest.approx(SURFACE, abs=0.4e-3)

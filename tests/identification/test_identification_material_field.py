"""The learner of a field of materials: batch least squares, truth in space, uncertainty, changes, hostile samples."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest

from foretouch.identification import ContactSample, MaterialFieldLearner, Status
from foretouch.identification.material_field_kernel import (
    FEWEST_UPDATES,
    FORCE_NOISE,
    SHARE_NOISE,
    UNKNOWNS,
    Node,
    carry_over,
    learn,
)
from foretouch.models import MOST_NODES, MaterialField

Law = Callable[[float, float], tuple[float, float, float]]


def soft(x: float, y: float) -> tuple[float, float, float]:
    """Ever stiffer along x."""
    share = 1.0 + 15.0 * x
    return 300.0 * share, 4e4 * share, 200.0 * share


def palpate(
    learner: MaterialFieldLearner, law: Law, *, size: float = 0.03, rows: int = 11, noise: float = 0.02, seed: int = 0
) -> list[Status]:
    """Presses of 3 mm at 25 mm/s in every place of a grid."""
    random = np.random.default_rng(seed)
    statuses = []
    depth = 3e-3 * np.sin(np.linspace(0.0, np.pi, 240))
    velocity = np.gradient(depth, 1e-3)
    for x in np.linspace(-size, size, rows).tolist():
        for y in np.linspace(-size, size, rows).tolist():
            a, b, c = law(x, y)
            for d, v in zip(depth.tolist(), velocity.tolist(), strict=True):
                force = d * (a + b * d + c * v) + random.normal(0.0, noise)
                learner.touch_at((x, y, 1e-3 * math.sin(200.0 * x)))
                statuses.append(learner.update(ContactSample(0.0, d, v, force, d > 0.0)))
    return statuses


def errors_of(field: MaterialField, law: Law, size: float = 0.03) -> tuple[np.ndarray, np.ndarray]:
    """Of local stiffness at 2 mm, in shares, on a fine grid between the presses; and in deviations."""
    axis = np.linspace(-size, size, 41)
    points = np.array([(x, y, 1e-3 * math.sin(200.0 * x)) for x in axis for y in axis])
    true = np.array([law(x, y)[0] + 0.004 * law(x, y)[1] for x, y, _ in points.tolist()])
    result, deviations = field.stiffness_at(points, 0.002)
    return result / true - 1.0, (result - true) / deviations


@pytest.fixture(scope="module")
def palpated() -> MaterialFieldLearner:
    """Has learnt what is ever stiffer along x."""
    learner = MaterialFieldLearner()
    palpate(learner, soft)
    return learner


@pytest.mark.long
def test_a_field_that_changes_evenly_is_found(palpated: MaterialFieldLearner) -> None:
    learner = palpated
    share, deviations = errors_of(learner.field, soft)
    assert np.sqrt(np.mean(share**2)) < 0.05
    assert np.abs(share).max() < 0.2
    assert np.mean(np.abs(deviations) < 2.0) > 0.9
    assert learner.changes == 0
    assert len(learner.field) < 350


@pytest.mark.long
def test_the_uncertainty_is_large_where_nobody_pressed(palpated: MaterialFieldLearner) -> None:
    field = palpated.field
    _, pressed, known = field.law_at((0.0, 0.0, 0.0))
    law, elsewhere, nothing = field.law_at((0.2, 0.0, 0.0))
    assert (known, nothing) == (True, False)
    assert elsewhere > 3.0 * pressed
    assert law == field.mean
    assert law.stiffness + 0.004 * law.stiffening == pytest.approx(460.0, rel=0.3)  # soft places count more


def test_one_node_is_batch_least_squares() -> None:
    """Without forgetting, the filter gives what weighted least squares with its prior gives."""
    random = np.random.default_rng(1)
    rows = random.uniform((0.05, 0.0, -1.0), (1.0, 1.0, 1.0), (300, 3))
    forces = rows @ (3.0, 5.0, 0.4) + random.normal(0.0, 0.05, 300)
    nodes, joint = Node.new(covariance=100.0 * np.eye(3), limit=1e9), 100.0 * np.eye(3)
    at, weights = np.zeros(1, np.int64), np.ones(1)
    for row, force in zip(rows.tolist(), forces.tolist(), strict=True):
        learn(nodes, at, weights, joint, (row[0], row[1], row[2]), force, 0.04, 0.0)
    information = rows.T @ rows / 0.04 + np.eye(3) / 100.0
    np.testing.assert_allclose(nodes[0].covariance, np.linalg.inv(information), rtol=1e-6)
    np.testing.assert_allclose(nodes[0].theta, np.linalg.solve(information, rows.T @ forces / 0.04), rtol=1e-6)


def test_eight_nodes_are_batch_least_squares_and_their_pairs_go_along() -> None:
    random = np.random.default_rng(2)
    nodes = Node.new(12, covariance=np.eye(3), limit=1e9)
    at, other = np.arange(8), np.array([4, 5, 6, 7, 8, 9, 10, -1])
    joint = carry_over(nodes, np.zeros(0, np.int64), at, np.zeros((24, 24)))
    np.testing.assert_array_equal(joint, np.eye(24))
    information, right = np.eye(24), np.zeros(24)
    for _ in range(100):
        weights, row = random.dirichlet(np.ones(8)), random.uniform(0.0, 1.0, 3)
        force = float(random.normal(0.0, 1.0))
        h = np.outer(weights, row).ravel()
        information += np.outer(h, h) / 100.0
        right += h * force / 100.0
        learn(nodes, at, weights, joint, tuple(row.tolist()), force, 100.0, 0.0)
    np.testing.assert_allclose(joint, np.linalg.inv(information), atol=1e-9)
    np.testing.assert_allclose(nodes["theta"][:8].ravel(), np.linalg.solve(information, right), atol=1e-9)
    np.testing.assert_array_equal(nodes[3].covariance, joint[9:12, 9:12])
    moved = carry_over(nodes, at, other, joint)
    np.testing.assert_array_equal(moved[:12, :12], joint[12:, 12:])
    np.testing.assert_array_equal(moved[12:, :12], 0.0)
    np.testing.assert_array_equal(moved[-UNKNOWNS:], 0.0)
    assert np.linalg.eigvalsh(moved).min() > -1e-12


def test_an_inclusion_is_found_at_its_place() -> None:
    def law(x: float, y: float) -> tuple[float, float, float]:
        share = 1.0 + 3.0 / (1.0 + math.exp((math.hypot(x - 0.005, y) - 0.012) / 0.001))
        return 300.0 * share, 4e4 * share, 200.0 * share

    learner = MaterialFieldLearner()
    palpate(learner, law)
    stiff = learner.field.stiffness_at([(0.005, 0.0, 0.0)])[0][0]
    around = learner.field.stiffness_at([(-0.02, 0.0, 0.0), (0.005, 0.025, 0.0), (0.03, 0.0, 0.0)])[0]
    assert stiff == pytest.approx(4.0 * 460.0, rel=0.1)
    np.testing.assert_allclose(around, 460.0, rtol=0.15)


def press(learner: MaterialFieldLearner, law: tuple[float, float, float], times: int) -> list[Status]:
    depth = 3e-3 * np.abs(np.sin(np.linspace(0.0, np.pi * times, 300 * times)))
    velocity = np.gradient(depth, 1e-3)
    a, b, c = law
    return [
        learner.update(ContactSample(0.0, d, v, d * (a + b * d + c * v), True))
        for d, v in zip(depth.tolist(), velocity.tolist(), strict=True)
    ]


def test_a_place_that_has_changed_is_learnt_again() -> None:
    learner = MaterialFieldLearner()
    learner.touch_at((0.003, 0.003, 0.003))
    press(learner, (300.0, 4e4, 200.0), 20)
    statuses = press(learner, (1500.0, 2e5, 1000.0), 3)
    assert Status.CHANGED in statuses
    assert learner.changes >= 1
    model = learner.model
    assert model is not None
    assert model.stiffness + 0.004 * model.stiffening == pytest.approx(2300.0, rel=0.1)


def test_a_held_position_teaches_nothing() -> None:
    learner = MaterialFieldLearner()
    press(learner, (300.0, 4e4, 200.0), 2)
    before = learner.field
    for _ in range(5000):
        learner.update(ContactSample(0.0, 2e-3, 0.0, 5.0, True))
    assert learner.update(ContactSample(0.0, 2e-3, 0.0, 5.0, True)) is Status.HELD
    np.testing.assert_allclose(learner.field.values, before.values, rtol=0.05)


def test_of_too_many_nodes_the_oldest_makes_room() -> None:
    learner = MaterialFieldLearner()
    press(learner, (300.0, 4e4, 200.0), 1)
    for index in range(3 * MOST_NODES):
        learner.touch_at((0.006 * index, 0.0, 0.0))
        learner.update(ContactSample(0.0, 1e-3 + 1e-4 * (index % 2), 0.0, 0.34, True))
    assert len(learner.field) == MOST_NODES
    assert learner.field.law_at((0.006 * (3 * MOST_NODES - 1), 0.0, 0.0))[2]
    assert not learner.field.law_at((0.006, 0.0, 0.0))[2]
    assert MaterialField.from_bytes(learner.field.to_bytes()) == learner.field


@pytest.mark.long
def test_hostile_places_and_samples_leave_a_field_that_can_be_sent() -> None:
    learner = MaterialFieldLearner()
    random = np.random.default_rng(4)
    for index in range(8_000):
        size = 10.0 ** random.uniform(-6, 6)
        learner.touch_at(
            (random.normal(0.0, size, 3) * random.choice([1.0, math.nan, math.inf], p=[0.9, 0.05, 0.05])).tolist()
        )
        depth, force = abs(random.normal(0.0, 10.0 ** random.uniform(-5, 0))), random.normal(0.0, size)
        learner.update(ContactSample(0.0, depth, random.normal(0.0, size), force, True))
        if index % 500 == 0:
            field = learner.field
            assert MaterialField.from_bytes(field.to_bytes()) == field
            model = learner.model
            assert model is None or all(map(math.isfinite, model.parameters))


def test_before_enough_samples_there_is_no_law_and_an_empty_field() -> None:
    learner = MaterialFieldLearner()
    assert len(learner.field) == 0
    for index in range(FEWEST_UPDATES - 1):
        learner.update(ContactSample(0.0, 1e-4 * (index + 1), 0.0, 0.03 * (index + 1), True))
    assert learner.model is None
    assert len(learner.field) == 0
    assert MaterialField.from_bytes(learner.field.to_bytes()) == learner.field
    assert FORCE_NOISE > 0.0 < SHARE_NOISE


def test_an_update_costs_the_same_however_large_the_field_is() -> None:
    learner = MaterialFieldLearner()
    costs = []
    for index in range(4000):
        learner.touch_at((2e-6 * index, 1e-3, 1e-3))
        sample = ContactSample(0.0, 1e-3 + 5e-5 * (index % 40), 0.05, 0.4, True)
        start = time.perf_counter_ns()
        learner.update(sample)
        costs.append(time.perf_counter_ns() - start)
    assert np.median(costs[-1000:]) < 3.0 * np.median(costs[:1000])


def raster(samples: int = 700) -> tuple[MaterialFieldLearner, list[str]]:
    """Random samples along a raster over a material that changes half way; what was answered, and the learner."""
    learner, random, answers = MaterialFieldLearner(), np.random.default_rng(3), []
    for index in range(samples):
        learner.touch_at((2e-4 * (index % 100), 3e-3 * (index // 100), random.normal(0.0, 1e-4)))
        depth, velocity = abs(random.normal(0.0, 2e-3)), random.normal(0.0, 0.05)
        force = (1.0 if index < samples // 2 else 9.0) * depth * (300.0 + 4e4 * depth + 200.0 * velocity)
        sample = ContactSample(0.0, depth, velocity, force + random.normal(0.0, 0.02), index % 50 > 0)
        answers.append(learner.update(sample).name)
        assert learner.has_model == (learner.model is not None)
    return learner, answers


def digest(learner: MaterialFieldLearner, answers: list[str]) -> str:
    seen = learner.states.tobytes(), learner.field.to_bytes(), repr((learner.model, learner.standard_errors, answers))
    return hashlib.sha256(seen[0] + seen[1] + seen[2].encode()).hexdigest()


def test_compiled_and_interpreted_learn_the_same_bits() -> None:
    learner, answers = raster()
    assert {"FREE_AIR", "LEARNT", "CHANGED"} <= set(answers)
    assert len(learner.field) > 20
    assert learner.has_model
    code = "import test_identification_material_field as test; print(test.digest(*test.raster()))"
    paths = os.pathsep.join([os.path.dirname(__file__), *sys.path])
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": paths}
    answer = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == digest(learner, answers)


def test_of_the_nodes_about_the_probe_none_makes_room() -> None:
    """It comes back to where four of the nodes made room, and the other four are next."""
    learner = MaterialFieldLearner()
    press(learner, (300.0, 4e4, 200.0), 1)
    for index in [*range(MOST_NODES // 4), 0]:
        learner.touch_at((0.003 - 0.006 * index, 0.003, 0.003))
        learner.update(ContactSample(0.0, 1e-3 + 1e-4 * (index % 2), 0.0, 0.34, True))
        assert len(set(learner.states[0].at.tolist())) == 8
    assert len(learner.field) == MOST_NODES

"""Friction from sliding, against what was simulated, batch least squares, and hostile samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.identification import FrictionEstimator, Status
from foretouch.models import BristleFriction

T = 1e-3


def slide(
    estimator: FrictionEstimator,
    mu: float,
    c: float,
    *,
    seconds: float = 6.0,
    noise: float = 0.02,
    jitter: float = 0.0,
    seed: int = 0,
) -> None:
    """To and fro on a slope in space with changing speed and force."""
    random = np.random.default_rng(seed)
    direction = np.array([0.6, 0.0, 0.8])
    for t in np.arange(0.0, seconds, T).tolist():
        speed = 0.06 * math.sin(2.0 * math.pi * 0.7 * t) * (1.0 + 0.5 * math.sin(1.3 * t))
        pressed = 1.5 + math.sin(3.1 * t)
        force = -math.copysign(mu * pressed + c * abs(speed), speed) * direction
        estimator.update(
            pressed + random.normal(0.0, noise),
            (force + random.normal(0.0, noise, 3)).tolist(),
            (speed * direction + random.normal(0.0, jitter, 3)).tolist(),
            T,
        )


@pytest.mark.parametrize(("mu", "c"), [(0.4, 0.0), (0.15, 3.0), (0.9, 1.0), (0.0, 2.0)])
@pytest.mark.parametrize("jitter", [0.0, 3e-3])
def test_it_finds_what_was_simulated_within_its_uncertainty(mu: float, c: float, jitter: float) -> None:
    estimator = FrictionEstimator()
    assert not estimator.known
    slide(estimator, mu, c, jitter=jitter)
    assert estimator.known
    of_mu, of_c = estimator.deviations
    assert estimator.coefficient == pytest.approx(mu, abs=max(3.0 * of_mu, 0.02))
    assert estimator.viscous == pytest.approx(c, abs=max(3.0 * of_c, 0.3))
    assert of_mu < 0.05
    assert estimator.coefficient == pytest.approx(mu, abs=0.05)


@pytest.mark.parametrize("stiffness", [500.0, 2000.0, 10_000.0])
@pytest.mark.parametrize("static", [1.0, 1.5])
@pytest.mark.first
def test_the_bristles_stiffness_is_learnt_where_the_hand_turns(stiffness: float, static: float) -> None:
    """Against the law that is simulated, with the noise of a sensor and of encoders."""
    law, estimator, random = BristleFriction(0.4, 1.0, stiffness, static), FrictionEstimator(), np.random.default_rng(0)
    bend, direction = (0.0, 0.0, 0.0), np.array([0.6, 0.0, 0.8])
    for t in np.arange(0.0, 10.0, T).tolist():
        velocity, pressed = 0.03 * math.sin(2.0 * math.pi * 0.7 * t) * direction, 1.5 + 0.5 * math.sin(3.1 * t)
        bend, force = law.advance(bend, tuple(velocity.tolist()), pressed, T)
        noisy = np.array(force) + random.normal(0.0, 0.02, 3), velocity + random.normal(0.0, 2e-3, 3)
        estimator.update(pressed + random.normal(0.0, 0.02), noisy[0].tolist(), noisy[1].tolist(), T)
    assert estimator.known
    assert estimator.sticks
    assert estimator.stiffness == pytest.approx(stiffness, abs=2.0 * estimator.stiffness_deviation)
    assert estimator.stiffness_deviation < 0.2 * stiffness
    assert estimator.numbers[4:6] == (estimator.stiffness, estimator.stiffness_deviation)


@pytest.mark.parametrize("static", [1.0, 1.6])
def test_what_is_harder_to_move_from_rest_is_learnt_where_it_slows_down(static: float) -> None:
    law, estimator, random = BristleFriction(0.6, 2.0, 1500.0, static), FrictionEstimator(), np.random.default_rng(0)
    bend = (0.0, 0.0, 0.0)
    for t in np.arange(0.0, 10.0, T).tolist():
        velocity, pressed = (0.02 * math.sin(2.0 * math.pi * 0.5 * t) ** 3, 0.0, 0.0), 1.5 + 0.5 * math.sin(3.1 * t)
        bend, force = law.advance(bend, velocity, pressed, T)
        noisy = np.array(force) + random.normal(0.0, 0.02, 3), velocity + random.normal(0.0, 2e-3, 3)
        estimator.update(pressed + random.normal(0.0, 0.02), noisy[0].tolist(), noisy[1].tolist(), T)
    assert estimator.coefficient == pytest.approx(0.6, abs=0.05)
    true, (told, deviation) = 0.6 * (static - 1.0), estimator.numbers[6:]
    assert 0.6 * true <= told <= 1.1 * true  # the law reaches its static friction by and by, the bristle at once
    assert deviation < 0.03


def test_where_nothing_rubs_no_stiffness_is_learnt() -> None:
    estimator = FrictionEstimator()
    for t in np.arange(0.0, 3.0, T).tolist():
        estimator.update(1.0, (0.0, 0.0, 0.0), (0.03 * math.sin(5.0 * t), 0.0, 0.0), T)
    estimator.records["theta"] = 0.0
    estimator.update(1.0, (0.0, 0.0, 0.0), (0.03, 0.0, 0.0), T)
    assert not estimator.sticks
    assert all(map(math.isfinite, estimator.numbers))


def test_a_surface_that_changes_is_learnt_again() -> None:
    estimator = FrictionEstimator()
    slide(estimator, 0.8, 0.0, seconds=3.0)
    slide(estimator, 0.2, 0.0, seconds=12.0)
    assert estimator.coefficient == pytest.approx(0.2, abs=0.1)


def test_a_constant_speed_leaves_the_two_apart_to_uncertainty() -> None:
    estimator = FrictionEstimator()
    for _ in range(3000):
        estimator.update(1.0, (-0.45, 0.0, 0.0), (0.05, 0.0, 0.0), T)
    mu, c = estimator.coefficient, estimator.viscous
    assert mu + 0.05 * c == pytest.approx(0.45, abs=0.01)
    assert estimator.deviations[1] > 1.0


@pytest.mark.parametrize(
    ("pressed", "speed", "status"),
    [
        (1.0, 1e-3, Status.GATED),
        (0.2, 0.05, Status.GATED),
        (math.nan, 0.05, Status.UNUSABLE),
        (1.0, math.inf, Status.UNUSABLE),
        (1e9, 0.05, Status.UNUSABLE),
        (1.0, 0.05, Status.WAITING),
    ],
)
def test_only_what_slides_teaches(pressed: float, speed: float, status: Status) -> None:
    estimator = FrictionEstimator()
    assert estimator.update(pressed, (-0.4, 0.0, 0.0), (speed, 0.0, 0.0), T) is status
    assert estimator.updates == 0


def test_hostile_samples_leave_it_within_its_bounds() -> None:
    estimator = FrictionEstimator()
    random = np.random.default_rng(3)
    for _ in range(8_000):
        size = 10.0 ** random.uniform(-9, 9)
        values = random.normal(0.0, size, 7).tolist()
        estimator.update(values[0], values[1:4], values[4:], float(random.choice([T, 0.0, -1.0, 1e9, math.nan])))
        estimator.update(abs(values[0]) % 5.0, [v % 3.0 for v in values[1:4]], [v % 0.2 for v in values[4:]], T)
        assert 0.0 <= estimator.coefficient <= 2.0
        assert 0.0 <= estimator.viscous < 1e4
        assert all(map(math.isfinite, estimator.deviations))
    estimator.reset()
    slide(estimator, 0.4, 0.0)
    assert estimator.coefficient == pytest.approx(0.4, abs=0.05)

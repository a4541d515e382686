"""The simulated arm of three axes, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.errors import SettingError
from foretouch.robot import GantryArm

STIFFNESS = 1000.0
OFFSET = (0.1, -0.15, 0.3)


def floor(place: tuple, velocity: tuple, elapsed: float) -> tuple:
    """A spring below z = 0, with a friction of 0.3 along x."""
    pressed = STIFFNESS * max(-place[2], 0.0)
    return -0.3 * pressed * math.tanh(velocity[0] / 2e-3), 0.0, pressed


def ramp(arm: GantryArm, to: tuple, seconds: float) -> list:
    start, ticks = np.array(arm.read().exact_place), round(seconds * 1e3)
    return [arm.exchange(tuple(start + (np.array(to) - start) * (k + 1) / ticks)) for k in range(ticks)]


def test_it_goes_where_it_is_told_along_every_axis() -> None:
    arm = GantryArm(lambda *_: (0.0, 0.0, 0.0), seed=0, start=(0.0, 0.0, 0.05))
    for to in ((0.03, 0.0, 0.05), (0.03, -0.04, 0.05), (0.03, -0.04, 0.02), (0.0, 0.0, 0.05)):
        ramp(arm, to, 0.4)
        for _ in range(50):
            sample = arm.exchange(to)
        np.testing.assert_allclose(sample.exact_place, to, atol=2e-6)
        np.testing.assert_allclose(sample.place, to, atol=2e-5)
        assert math.dist(sample.force, OFFSET) < 0.12  # weight and inertia are taken out


def test_its_sensor_shows_the_contact_force_and_its_offset() -> None:
    arm = GantryArm(floor, seed=0, start=(0.0, 0.0, 0.004))
    samples = ramp(arm, (0.0, 0.0, -0.004), 0.5) + ramp(arm, (0.03, 0.0, -0.004), 0.6)
    felt, true = (np.array([getattr(sample, name) for sample in samples]) for name in ("force", "exact_force"))
    error = felt - OFFSET - true
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.05
    assert true[:, 2].max() == pytest.approx(4.0, abs=0.05)
    assert true[800:, 0].mean() == pytest.approx(-1.2, abs=0.05)


def test_same_seed_same_commands_same_samples() -> None:
    runs = [ramp(GantryArm(floor, seed=3, start=(0.0, 0.0, 0.001)), (0.0, 0.0, -0.003), 0.1) for _ in range(2)]
    assert runs[0] == runs[1]


def test_it_holds_no_more_than_its_limit_whichever_way_it_presses() -> None:
    def walls(place: tuple, velocity: tuple, elapsed: float) -> tuple:
        return tuple(-2e4 * math.copysign(max(abs(x) - 0.01, 0.0), x) for x in place)

    for axis in range(3):
        for way in (1.0, -1.0):
            arm = GantryArm(walls, seed=0, start=(0.0, 0.0, 0.0), force_limit=5.0)
            to = tuple(way * 0.03 * (k == axis) for k in range(3))
            ramp(arm, to, 1.0)
            for _ in range(300):
                sample = arm.exchange(to)
            assert abs(sample.exact_force[axis]) == pytest.approx(5.0, abs=0.5), (axis, way)


@pytest.mark.parametrize("wrong", [(math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), ()])
def test_a_place_that_is_none_is_left_out(wrong: tuple) -> None:
    arm = GantryArm(floor, seed=0)
    for _ in range(20):
        sample = arm.exchange(wrong)
    np.testing.assert_allclose(sample.exact_place, (0.0, 0.0, 0.05), atol=1e-6)


def test_it_stays_within_its_reach() -> None:
    arm = GantryArm(lambda *_: (0.0, 0.0, 0.0), seed=0, reach=((-0.02, -0.02, 0.0), (0.02, 0.02, 0.06)))
    ramp(arm, (0.2, -0.2, -0.2), 1.0)
    for _ in range(200):
        sample = arm.exchange((0.2, -0.2, -0.2))
    np.testing.assert_allclose(sample.exact_place, (0.02, -0.02, 0.0), atol=1e-5)


def test_a_world_that_answers_nonsense_breaks_nothing() -> None:
    answers = iter([(math.nan, 0.0, 0.0), (1e9, 0.0, 0.0), (0.0, -math.inf, 0.0)] * 100)
    arm = GantryArm(lambda *_: next(answers), seed=0)
    for _ in range(100):
        sample = arm.exchange((0.0, 0.0, 0.05))
    assert np.isfinite([*sample.place, *sample.force]).all()


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"seed": -1}, {"force_limit": 0.0}, {"sample_period": 0.1}, {"sensor_bandwidth": -1.0}):
        with pytest.raises(SettingError, match=next(iter(wrong))):
            GantryArm(floor, **({"seed": 0} | wrong))

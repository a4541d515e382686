"""The arm along a line without a physics engine: it moves and feels as the one in MuJoCo does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.errors import SettingError
from foretouch.export.beginnings import PRESSED
from foretouch.robot import RobotSample, make_robot
from foretouch.robot.engine import normal_draws
from foretouch.robot.slide import exchange, make_slide

NEAR = {
    "sensor_force": 2e-4,
    "acceleration": 2e-3,
    "exact_force": 1e-6,
    "exact_position": 1e-8,
    "commanded_position": 1e-9,
    "effort": 2e-3,
}
"""Largest difference from the second tenth of a second on, in the units of each."""


def course(depth: float, tick: int) -> float:
    """Into the material and out of it, once a second, after a way through the air."""
    approach = 0.010 * min(tick / 500.0, 1.0)
    return approach + 0.5 * depth * (1.0 - math.cos(2e-3 * math.pi * tick))


@pytest.mark.parametrize("name", PRESSED)
def test_it_is_the_arm_in_mujoco_without_its_hinges(name: str) -> None:
    arm, slides, draws = make_robot(name, seed=3), make_slide(name), normal_draws(3)
    for _ in range(3):  # which the arm took for the sample before its first exchange
        next(draws)
    there, here, move = [], [], exchange.entry
    for tick in range(3000):
        wanted = course(1.5 * arm.material.press_depth, tick)
        there.append(arm.exchange(wanted)[:8])
        here.append(move(slides, wanted, next(draws), next(draws), next(draws)))
    difference = np.abs(np.array(there, dtype=float) - np.array(here, dtype=float))[100:].max(axis=0)
    apart = dict(zip(RobotSample._fields, difference.tolist(), strict=False))
    assert max(sample[3] for sample in there) > 1.0
    assert apart["clipped"] == 0.0
    assert all(apart[field] <= most for field, most in NEAR.items()), apart


def test_the_same_draws_give_the_same_bits() -> None:
    one, other = make_slide("sponge"), make_slide("sponge")
    for tick in range(200):
        given = course(0.01, tick), 0.1, -0.2, 0.3
        assert exchange(one, *given) == exchange(other, *given)
    assert one.tobytes() == other.tobytes()


def test_a_material_whose_law_is_not_compiled_is_refused() -> None:
    with pytest.raises(SettingError, match="material"):
        make_slide("mullins")

"""The passivity observer and controller."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.rendering.passivity_control import RECOVERY_RATE, PassivityController

PERIOD = 1e-3


def drive(controller: PassivityController, moves: list[tuple[float, float]]) -> list[float]:
    """Motion by steps [m], each under a wanted force [N], whose velocity is known when the force is chosen."""
    position, forces = 0.0, []
    controller.observe(position)
    for step, wanted in moves:
        force = controller.control(wanted, step / PERIOD, PERIOD)
        controller.hold(force, touching=wanted > 0.0)
        position += step
        controller.observe(position)
        forces.append(force)
    return forces


STEPS = st.floats(-1e-4, 1e-4).filter(lambda step: step == 0.0 or abs(step) > 1e-9)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(st.tuples(STEPS, st.floats(0.0, 5.0)), max_size=60))
def test_where_the_velocity_is_right_no_energy_comes_out(moves: list[tuple[float, float]]) -> None:
    controller = PassivityController(2.0)
    forces = drive(controller, moves)
    assert controller.energy >= -1e-12
    assert min(forces, default=0.0) >= 0.0


def test_what_was_paid_for_is_given_back_and_no_more() -> None:
    controller = PassivityController(2.0)
    drive(controller, [(1e-5, 1.0)] * 10)
    forces = drive_on(controller, 1e-4, [(-1e-5, 2.0)] * 10)
    assert forces == pytest.approx([2.0] * 5 + [0.0] * 5, abs=1e-9)


def drive_on(controller: PassivityController, position: float, moves: list[tuple[float, float]]) -> list[float]:
    forces = []
    for step, wanted in moves:
        forces.append(controller.control(wanted, step / PERIOD, PERIOD))
        controller.hold(forces[-1], touching=True)
        position += step
        controller.observe(position)
    return forces


def in_debt() -> PassivityController:
    """A hand that was pushed out at a velocity that nobody saw."""
    controller = PassivityController(2.0)
    controller.observe(0.0)
    controller.hold(controller.control(4.0, 0.0, PERIOD), touching=True)
    controller.observe(-1e-4)
    return controller


def test_in_debt_the_force_comes_back_slowly_and_the_damper_is_bounded() -> None:
    controller = in_debt()
    assert controller.energy == pytest.approx(-4e-4)
    controller.hold(0.0, touching=True)
    assert controller.control(4.0, 0.0, PERIOD) == pytest.approx(RECOVERY_RATE * PERIOD)
    assert controller.control(4.0, 0.05, PERIOD) == pytest.approx(RECOVERY_RATE * PERIOD + 2.0 * 0.05)
    assert controller.damping == 2.0
    assert controller.control(4.0, -0.05, PERIOD) == 0.0


def test_a_debt_outlives_the_contact_and_a_surplus_does_not() -> None:
    controller = in_debt()
    controller.hold(0.0, touching=False)
    assert controller.energy == pytest.approx(-4e-4)
    rich = PassivityController(2.0)
    drive(rich, [(1e-5, 1.0)] * 10)
    assert rich.energy > 0.0
    rich.hold(0.0, touching=False)
    assert rich.energy == 0.0


@pytest.mark.parametrize("damping", [-1.0, math.nan, math.inf])
def test_no_negative_damping(damping: float) -> None:
    with pytest.raises(SettingError):
        PassivityController(damping)

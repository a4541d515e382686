"""A hand that owes energy: whoever presses again feels the model, and pays."""

from __future__ import annotations

import math

import pytest
from renderer_runs import Run

from foretouch.devices import DeviceSpecification
from foretouch.models import KelvinVoigt

DEVICE = DeviceSpecification(damping=2.0, resolution=1e-5, delay=5e-4, watchdog=0.02)
STIFFNESS = 600.0


def press(run: Run, depth: float, ticks: int = 400) -> list[tuple[float, float]]:
    """Force that is rendered and force of the model, in and out again, with every promise checked in every tick."""
    felt = []
    for number in range(1, ticks + 1):
        force = run.tick(0.5 * depth * (1.0 - math.cos(2.0 * math.pi * number / ticks)))
        felt.append((force, run.renderer.predictor.force))
    for _ in range(20):
        run.tick(-0.001)
    return felt


def in_debt() -> Run:
    """A run whose hand jerked out of a press, and was given more than half of what the account may give out."""
    run = Run(DEVICE)
    run.tick(-0.001, ((KelvinVoigt(STIFFNESS, 0.0), -0.002),))
    for number in range(400):
        run.tick(0.01 * number / 400)
    for number in range(30):
        run.tick(0.01 - 4e-4 * number)
    assert run.renderer.booked[0] < -0.5 * run.renderer.booked[1]
    return run


@pytest.mark.parametrize("ticks", [200, 400, 1500])
def test_the_next_press_is_felt_and_pays(ticks: int) -> None:
    run = in_debt()
    owed = -run.renderer.booked[0]
    first = press(run, 0.01, ticks)
    at_depth = first[len(first) // 2]
    assert at_depth[1] > 5.0
    assert at_depth[0] > 0.5 * at_depth[1]
    assert run.renderer.booked[0] > -owed
    for _ in range(3):
        last = press(run, 0.01, ticks)
    assert last[len(last) // 2][0] > 0.9 * last[len(last) // 2][1]


def test_a_hand_that_does_not_leave_the_surface_pays_too() -> None:
    run = in_debt()
    for number in range(3000):
        depth = 0.006 - 0.004 * math.cos(2.0 * math.pi * number / 500)
        force = run.tick(depth * min(number / 300, 1.0))
        if number % 500 == 250 and number > 500:
            assert force > 0.5 * run.renderer.predictor.force

"""A device that gives no position: the force fades, and comes back as a new model does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.devices import DeviceSpecification
from foretouch.models import KelvinVoigt
from foretouch.rendering import LARGEST_STEP, Renderer

TICK = 1e-3


def pressed(device: DeviceSpecification | None) -> tuple[Renderer, int]:
    """A renderer whose hand holds 10 mm deep in a spring of 500 N/m, and the ticks so far."""
    renderer = Renderer(device)
    renderer.engage(-2e-3, -2e-3)
    renderer.adopt(KelvinVoigt(500.0, 0.0), 0.0)
    places = np.concatenate((np.linspace(-2e-3, 0.01, 200), np.full(100, 0.01)))
    for tick, place in enumerate(places.tolist()):
        force = renderer.update(tick * TICK, place, TICK)
    assert force == pytest.approx(5.0, rel=0.02)
    return renderer, places.size


@pytest.mark.parametrize("device", [None, DeviceSpecification(damping=2.0, delay=5e-4)])
def test_the_force_is_gone_within_five_ticks_of_the_third_missing_position(device: DeviceSpecification | None) -> None:
    renderer, tick = pressed(device)
    forces = [renderer.update((tick + n) * TICK, math.nan, TICK) for n in range(20)]
    assert forces[1] == pytest.approx(5.0, rel=0.02)  # one or two that are missing are nothing to speak of
    assert (np.diff(forces[1:8]) <= 0.0).all()
    assert forces[2] < forces[1]
    assert forces[6:] == [0.0] * 14


def test_what_a_lost_hand_may_have_been_given_is_told_and_widens_no_bound() -> None:
    renderer, tick = pressed(DeviceSpecification(damping=2.0, delay=5e-4))
    for number in range(1000):
        renderer.update((tick + number) * TICK, math.nan, TICK)
    renderer.update((tick + 1000) * TICK, -0.05, TICK)
    assert renderer.booked[1] < 2e-3
    assert renderer.booked[0] >= -renderer.booked[1]
    # 5 N for the three ticks until it fades, 10 N ms while it does, over the second in which it went 60 mm.
    assert renderer.booked[2] == pytest.approx(-(5.0 * 2e-3 + 5.0 * 2e-3) * 0.06 / 1.001, rel=0.15)


def test_the_force_comes_back_mediated() -> None:
    renderer, tick = pressed(DeviceSpecification(damping=2.0, delay=5e-4))
    for number in range(50):
        renderer.update((tick + number) * TICK, math.nan, TICK)
    forces = [renderer.update((tick + 50 + n) * TICK, 0.01, TICK) for n in range(400)]
    assert forces[0] <= LARGEST_STEP + 1e-9
    assert max(np.diff(forces)) <= LARGEST_STEP + 1e-9
    assert forces[-1] > 2.0  # as far as what the hand had put in pays for it

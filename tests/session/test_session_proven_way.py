"""What the robot's own motion proves of the way in: no more than it has gone through, as fast as it went."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.session.safety.proven_way import CELL, GROWTH, ProvenWay

TICK = 1e-3


def gone(way: ProvenWay, places: list[float], damping: float, stiffness: float = 0.0) -> None:
    """Go through places [m], feeling a spring and a damper from 0 on."""
    before = places[0]
    for place in places:
        speed, before = (place - before) / TICK, place
        way.observe(place, max(stiffness * place + damping * speed, 0.0) if place > 0.0 else 0.0, TICK)


def ramp(begin: float, end: float, speed: float) -> list[float]:
    count = max(round(abs(end - begin) / speed / TICK), 2)
    return np.linspace(begin, end, count).tolist()


@pytest.mark.parametrize("speed", [0.002, 0.02, 0.2])
def test_a_cell_that_was_crossed_may_be_crossed_at_what_the_damping_allows(speed: float) -> None:
    way = ProvenWay()
    gone(way, ramp(-2e-3, 5e-3, speed), damping=100.0)
    assert way.speed(2.1e-3, 10.0) == pytest.approx(
        min(10.0 / 100.0, GROWTH * speed) if speed < 0.1 else speed, rel=0.1
    )
    assert math.isnan(way.speed(7e-3, 10.0)), "it has not been there"
    assert math.isnan(way.speed(-3e-3, 10.0))


def test_what_comes_back_out_is_elastic_and_no_damping() -> None:
    """10 N at 2 mm, of which a spring makes 8: next time the speed may double what it makes."""
    allowed = []
    for comes_back in (False, True):
        way = ProvenWay()
        gone(way, ramp(-2e-3, 4e-3, 0.02), damping=100.0, stiffness=4000.0)
        if comes_back:
            gone(way, ramp(4e-3, -1e-3, 0.002), damping=100.0, stiffness=4000.0)
        allowed.append(way.speed(2.1e-3, 13.0))
    assert allowed[1] > 1.2 * allowed[0] > 0.02
    force = 4000.0 * 2.25e-3 + 100.0 * allowed[1]
    assert force <= 13.0 + 0.5


@pytest.mark.parametrize("noise", [lambda n: 15e-6 * (n.random() < 0.5), lambda n: 5e-6 * n.standard_normal()])
def test_an_encoder_that_trembles_is_no_motion(noise: object) -> None:
    """A creep of 0.3 mm/s proves 0.3 mm/s, with a count that flickers and with white noise."""
    numbers, way = np.random.default_rng(1), ProvenWay()
    for place in ramp(-5e-4, 1.5e-3, 3e-4):
        way.observe(place + noise(numbers), 0.3, TICK)  # type: ignore[operator]
    found = [way.speed(place, 0.3) for place in np.arange(0.1e-3, 1.1e-3, CELL)]
    assert np.nanmax(found) < 3e-4 * 1.2


def test_a_way_that_is_harder_than_was_proven_counts_from_then_on_and_one_that_is_softer_too() -> None:
    way = ProvenWay()
    gone(way, ramp(-2e-3, 4e-3, 0.02), damping=10.0)
    quick = way.speed(2.1e-3, 10.0)
    gone(way, ramp(4e-3, -2e-3, 0.02) + ramp(-2e-3, 4e-3, 0.02), damping=400.0)
    assert way.speed(2.1e-3, 10.0) < 0.5 * quick
    gone(way, ramp(4e-3, -2e-3, 0.02) + ramp(-2e-3, 4e-3, 0.02), damping=10.0)
    assert way.speed(2.1e-3, 10.0) == pytest.approx(quick, rel=0.1)


def test_a_jump_is_no_motion_and_another_place_is_unknown() -> None:
    way = ProvenWay()
    for tick in range(60):
        way.observe(-0.01 if tick < 30 else 0.01, 0.0, TICK)
    assert math.isnan(way.speed(0.0, 10.0))
    gone(way, ramp(-2e-3, 4e-3, 0.02), damping=10.0)
    assert way.speed(2.1e-3, 10.0) > 0.02
    way.forget()
    assert math.isnan(way.speed(2.1e-3, 10.0))
    for nonsense in (math.nan, 1e300, -math.inf):
        assert math.isnan(way.speed(nonsense, 10.0))

"""A trigger as a device: the maker's library, against a bus of ours on a pseudo terminal. No servo was here."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from servo_bus import COUNT, GOAL_CURRENT, LEVER, TORQUE

from foretouch.devices import DeviceSpecification
from foretouch.errors import SettingError
from foretouch.grippers.handle import TICK, felt_over_bus, make_handle
from foretouch.session.conformance import check_device, failed

AMPERE_PER_NEWTON = LEVER / (0.52 / 1.47)

Settings = Callable[..., SimpleNamespace]


@pytest.fixture
def handle(settings: Settings) -> Iterator[Any]:
    made = make_handle(settings(device=DeviceSpecification(damping=1.5)), None)
    yield made
    made.close()


def held(handle: Any, seconds: float, force: float = 0.0) -> list[float]:
    """The positions while a force is rendered [N], in real time."""
    positions, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        positions.append(handle.read(0))
        handle.render(force)
        time.sleep(0.001)
    return positions


@pytest.mark.live
def test_closing_it_is_in_and_a_force_opens_it(handle: Any, bus: Any) -> None:
    bus.hand = bus.start
    assert held(handle, 0.1)[0] == 0.0
    bus.hand = bus.start - 0.01
    assert held(handle, 0.5)[-1] == pytest.approx(0.01, abs=0.0015)  # a newton of friction in the hand's spring
    assert held(handle, 0.5, 1.5)[-1] == pytest.approx(0.005, abs=0.002)
    assert bus.get(GOAL_CURRENT) == pytest.approx(1500.0 * AMPERE_PER_NEWTON, abs=1.0)
    handle.close()
    handle.close()
    assert bus.get(TORQUE) == bus.get(GOAL_CURRENT) == 0


@pytest.mark.live
def test_a_session_that_stops_rendering_gives_no_force(handle: Any, bus: Any) -> None:
    held(handle, 0.3, 2.0)
    assert bus.get(GOAL_CURRENT) > 0
    time.sleep(0.3)
    assert bus.get(GOAL_CURRENT) == 0


@pytest.mark.live
def test_one_that_is_pulled_out_is_lost_and_says_so(settings: Settings, bus: Any, capsys: Any) -> None:
    handle = make_handle(settings(device=DeviceSpecification(damping=1.5)), None)
    held(handle, 0.2, 1.0)
    bus.kill()
    assert math.isnan(held(handle, 0.5, 1.0)[-1])
    assert handle.lost
    assert handle.render(1.0) == 0.0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "lost" in line]
    assert "The hand gets no force" in line
    handle.close()


@pytest.mark.live
@pytest.mark.long
def test_one_that_has_let_go_or_is_silent_shows_no_position(handle: Any, bus: Any) -> None:
    held(handle, 0.2, 1.0)
    bus.errors = 1 << 2
    assert math.isnan(held(handle, 0.2, 1.0)[-1])
    assert handle.render(1.0) == 0.0
    bus.errors = 0
    assert not math.isnan(held(handle, 0.2, 1.0)[-1])
    bus.silent = True
    assert math.isnan(held(handle, 0.15, 1.0)[-1])
    assert not handle.lost
    bus.silent = False
    assert not math.isnan(held(handle, 0.3, 1.0)[-1])


@pytest.mark.live
@pytest.mark.long
def test_it_keeps_the_rules_of_a_device(settings: Settings, bus: Any) -> None:
    device = DeviceSpecification(damping=1.5)
    assert failed(check_device(lambda: make_handle(settings(device=device), None), name="dynamixel")) == []


@pytest.mark.live
def test_a_scene_is_refused(settings: Settings) -> None:
    with pytest.raises(SettingError, match="moves along a line"):
        make_handle(settings(scene="plane"), None)


def work(stiffness: float, period: float, delay: float, frequency: float, ticks: float) -> float:
    """Mean work per second that a wall gives to a hand which moves by 1 m x sin, over a bus [W].

    The wall is a spring about 0: its force follows from what an exchange read, ``ticks`` of the session later, goes out
    with the next exchange, acts after the delay of the device, and is held for the period.
    """
    step, turns = 2e-5, 80.0
    time = np.arange(0.0, turns / frequency, step)
    written = period * np.ceil((period * np.arange(time[-1] // period) + ticks * TICK) / period - 1e-9) + delay
    at = np.searchsorted(written, time, side="right") - 1
    position = np.sin(2.0 * np.pi * frequency * period * np.maximum(at, 0))
    speed = 2.0 * np.pi * frequency * np.cos(2.0 * np.pi * frequency * time)
    return float(np.mean(-stiffness * position * speed * (at >= 0)))


@pytest.mark.parametrize("period", [0.001, 0.002, 0.005])
@pytest.mark.first
def test_what_a_bus_carries_gives_no_energy_to_a_hand(period: float) -> None:
    damping, delay = 2.0, 5e-4
    felt = felt_over_bus(DeviceSpecification(damping=damping, delay=delay), period)
    stiffness = felt.largest_stiffness(TICK)
    taken = {f: damping * 0.5 * (2.0 * np.pi * f) ** 2 for f in np.geomspace(1.0, 0.47 / period, 12)}
    for frequency, spent in taken.items():
        for ticks in (1e-3, 1.0):  # the session's tick comes at once, or as late as it can
            assert work(stiffness, period, delay, frequency, ticks) < 1.02 * spent
    assert any(work(4.0 * stiffness, period, delay, f, 1.0) > spent for f, spent in taken.items())


def test_a_slower_bus_carries_less_and_damping_that_is_rendered_is_counted() -> None:
    device = DeviceSpecification(damping=2.0, delay=1e-3, resolution=COUNT)
    carried = [felt_over_bus(device, period).largest_stiffness(TICK) for period in (1e-3, 2e-3, 5e-3)]
    assert carried == pytest.approx([2.0 / 3.5e-3, 2.0 / 5e-3, 2.0 / 9.5e-3])
    with_damping = felt_over_bus(device, 2e-3).largest_stiffness(TICK, 0.5)
    assert with_damping < 1.5 / 5e-3

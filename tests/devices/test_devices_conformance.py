"""What every device of the package keeps to. A new one is added to DEVICES and passes before anything else.

What every device keeps to, of this package or another, is in `foretouch.session.conformance.check_device`; the rest
here is what those are asked for that press by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from foretouch.devices import (
    GRIPS,
    OPERATORS,
    BrowserOperator,
    Device,
    DeviceSpecification,
    Hand,
    RecordedOperator,
    ScriptedOperator,
)
from foretouch.session.conformance import check_device, failed

SURFACE, PRESS_DEPTH = 0.012, 0.009
TICK_NS = 1_000_000
LARGEST_SPEED, LARGEST_ACCELERATION = 0.3, 30.0


def recorded() -> RecordedOperator:
    t = np.arange(0.0, 4.0, 0.0005)
    hand = 0.004 * np.sin(2 * np.pi * 1.3 * t) + 0.001 * np.sin(2 * np.pi * 0.37 * t + 1.0)
    return RecordedOperator(t + 20.0, np.round(hand / 1.6e-6) * 1.6e-6, SURFACE, PRESS_DEPTH)


DEVICES: dict[str, Callable[[], Device]] = {
    "scripted": lambda: ScriptedOperator(SURFACE, PRESS_DEPTH, seed=3),
    "recorded": recorded,
    "browser": lambda: BrowserOperator(ScriptedOperator(SURFACE, PRESS_DEPTH, seed=3)),
}


FINE = DeviceSpecification(damping=2.0, resolution=1e-9)
"""Its counts are so small that second differences of what it shows are still accelerations."""


def holding(operator: str, grip: str) -> Callable[[], Device]:
    return lambda: Hand(DEVICES[operator](), GRIPS[grip], FINE)


HANDS = {f"{operator}, {grip} grip": holding(operator, grip) for operator in DEVICES for grip in GRIPS}


def slack(device: Device) -> float:
    """A hand in free air is not quite where it wants to be: friction, damping and mass [m]."""
    return 1e-3 if device.closed_loop else 1e-6


def run(device: Device, seconds: float, start_ns: int = 7_000_000_000) -> np.ndarray:
    return np.array([device.read(start_ns + i * TICK_NS) for i in range(int(seconds * 1000))])


@cache
def a_minute(make: Callable[[], Device]) -> np.ndarray:
    """What it does in a minute, for those who only look."""
    return run(make(), 60.0)


RARER = [name for name in HANDS if "normal" not in name]


@pytest.fixture(
    params=[*sorted(DEVICES), *(pytest.param(n, marks=[pytest.mark.long] * (n in RARER)) for n in sorted(HANDS))]
)
def make(request: pytest.FixtureRequest) -> Callable[[], Device]:
    return (DEVICES | HANDS)[request.param]


def test_every_operator_has_a_conformance_test_and_says_its_name() -> None:
    assert set(DEVICES) == set(OPERATORS)
    assert {name: make().name for name, make in DEVICES.items()} == {name: name for name in OPERATORS}
    assert {name: make().name for name, make in HANDS.items()} == {name: name.split(",")[0] for name in HANDS}


@pytest.mark.first
def test_it_passes_the_checks_of_every_device(make: Callable[[], Device]) -> None:
    findings = check_device(make)
    assert failed(findings) == []
    assert all(finding.passed for finding in findings)  # and all of it was seen


def test_motion_is_finite_continuous_and_bounded(make: Callable[[], Device]) -> None:
    position = a_minute(make)
    assert np.isfinite(position).all()
    assert position[0] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(position)).max() / 1e-3 < LARGEST_SPEED
    assert np.abs(np.diff(position, 2)).max() / 1e-6 < LARGEST_ACCELERATION
    # From rest: no velocity at the start.
    assert abs(position[1] - position[0]) / 1e-3 < 0.01


def test_motion_touches_by_itself_and_stays_within_the_press_depth(make: Callable[[], Device]) -> None:
    position = a_minute(make)
    touched = position > SURFACE
    assert not touched[:900].any()
    assert touched.any()
    assert position.max() <= SURFACE + PRESS_DEPTH + slack(make())
    assert position.max() > SURFACE + 0.8 * PRESS_DEPTH
    assert position.min() >= -1e-9
    # It comes and goes: many touches, and as many departures.
    assert np.count_nonzero(np.diff(touched.astype(int)) == 1) > 10


def test_motion_depends_on_nothing_but_the_times(make: Callable[[], Device]) -> None:
    assert np.array_equal(run(make(), 6.0), run(make(), 6.0))
    # The first time is the start, whatever the clock says.
    assert np.allclose(run(make(), 3.0, 0), run(make(), 3.0, 9 * 10**18), rtol=0, atol=2e-9)


def test_late_ticks_catch_up(make: Callable[[], Device]) -> None:
    device, punctual = make(), make()
    run(device, 2.0, 0)
    steady = run(punctual, 3.0, 0)
    # In the gap a hand takes its intention's way for a straight line: afterwards it needs a moment.
    late = device.read(2_999_000_000)
    assert late == pytest.approx(steady[-1], abs=slack(device))
    steady = run(punctual, 0.5, 3_000_000_000)
    assert run(device, 0.5, 3_000_000_000)[-1] == pytest.approx(steady[-1], abs=0.02 * slack(device))


def test_who_feels_nothing_says_so(make: Callable[[], Device]) -> None:
    device = make()
    position = device.read(0)
    assert math.isnan(device.intention) == math.isnan(device.exact_position) == (not device.closed_loop)
    if device.closed_loop:
        assert device.exact_position == pytest.approx(position, abs=1e-9)
    assert not device.clutched


def test_only_a_hand_is_moved_by_the_force(make: Callable[[], Device]) -> None:
    device, free = make(), make()
    run(device, 2.0)
    run(free, 2.0)
    device.render(1.0)
    moved = run(device, 0.5, 9_000_000_000) - run(free, 0.5, 9_000_000_000)
    assert (moved[-1] < -5e-4) if device.closed_loop else (moved == 0.0).all()


def test_render_tells_what_was_rendered(make: Callable[[], Device]) -> None:
    assert make().render(1.25) == 1.25

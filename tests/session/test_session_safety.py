"""Whatever the leader says: the robot's motion keeps its limits, its force the ceiling, and silence ends softly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_limits import MotionLimits
from pressed import ACCELERATION, JERK, SPEED, TICK, Pressed, keep_safe, kept

from foretouch.errors import SettingError
from foretouch.messages import STATUS_SENTENCES, Status
from foretouch.session.safety.safety import Safety, SafetyLimits


def begun(jerk: float = JERK) -> MotionLimits:
    limits = MotionLimits(SPEED, ACCELERATION, jerk, TICK)
    limits.begin(0.0)
    return limits


places = st.floats(-0.05, 0.1) | st.sampled_from((math.nan, math.inf, -math.inf, 1e300))


def test_the_limits_let_pass_what_is_within_them_reach_a_step_without_overshoot_and_brake_what_is_too_fast() -> None:
    limits = begun()
    stream = [0.01 * (1.0 - math.cos(2.0 * math.pi * tick * TICK)) for tick in range(2000)]
    path = [limits.update(place) for place in stream]
    assert path[200:] == pytest.approx(stream[200:], abs=1e-9)
    limits = begun()
    path = [limits.update(0.0)] + [limits.update(0.02) for _ in range(400)]
    kept(path)
    assert max(path) <= 0.02 + 2e-6
    assert path[200] == pytest.approx(0.02, abs=2e-6)
    limits = begun()
    path = [limits.update(0.0)] + [limits.update(1.0) for _ in range(60)]
    path += [limits.update(1.0, 0.03) for _ in range(60)]
    kept(path)
    assert (path[-1] - path[-2]) / TICK == pytest.approx(0.03, rel=0.02)


def test_an_emergency_stop_latches_until_it_is_released_at_rest() -> None:
    pressed = Pressed("hunt-crossley")
    deep = pressed.robot.surface + 0.012
    pressed.run(deep, 2.0)
    pressed.safety.stop("a person shouted")
    pressed.safety.stop("later")
    assert pressed.safety.stop_reason == "a person shouted"
    assert not pressed.safety.release(0.0, pressed.felt), "it still presses"
    pressed.run(deep + 0.01, 1.0)
    assert pressed.safety.status is Status.STOPPED
    assert pressed.forces[-1] < 1.0
    assert not pressed.safety.release(0.02, 0.0), "it still moves"
    assert pressed.safety.release(0.0, pressed.felt)
    pressed.run(deep, 1.0)
    assert pressed.safety.status is Status.FOLLOWING


# Interpreted, numbers of NumPy warn where compiled ones become infinite.
@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            places, places, places, st.booleans(), places, st.sampled_from((0.0, 0.1, 2.0, math.inf)), st.booleans()
        ),
        min_size=1,
        max_size=40,
    )
)
def test_nothing_raises_and_every_path_keeps_its_limits(ticks: list[tuple[float, ...]]) -> None:
    safety = Safety(SafetyLimits(workspace=(-0.02, 0.06)), TICK)
    path = []
    for desired, position, force, touches, surface, silence, faulty in ticks:
        sensed = position, 100.0 * force, bool(touches), bool(faulty)
        path.append(keep_safe(safety, desired, sensed, surface, silence))
    finite = [place for place in path if math.isfinite(place)]
    assert finite == path[len(path) - len(finite) :], "once it has a place it keeps one"
    kept(finite)


def test_sensors_that_stay_faulty_take_the_robot_out_by_the_way_that_it_came() -> None:
    """Nobody knows the force then: the way that it was told counts, at the speed of any way back."""
    for deep in (0.002, 0.01):
        pressed = Pressed("sponge")
        pressed.run(pressed.robot.surface + deep, 2.0)
        before = len(pressed.path)
        pressed.run(pressed.robot.surface + deep, 0.45, faulty=True)
        assert np.ptp(pressed.path[before:]) < 1e-5
        assert pressed.safety.status is Status.SENSOR_FAULT
        assert pressed.safety.pressing
        pressed.run(pressed.robot.surface + deep, 0.8, faulty=True)
        assert pressed.safety.status is Status.SENSOR_FAULT
        assert pressed.forces[-1] == 0.0
        assert not pressed.safety.pressing
        assert pressed.robot.surface - 0.003 < pressed.path[-1], "and no further than it came"
        assert np.diff(pressed.path[before:]).min() >= -0.07 * TICK, "the path may swing over its speed"


def test_an_emergency_stop_goes_back_without_a_force() -> None:
    pressed = Pressed("bone", force_limit=1000.0)
    pressed.run(pressed.robot.surface + 0.03, 2.0)
    assert pressed.forces[-1] > 13.0
    pressed.safety.stop("a person shouted")
    for _ in range(200):
        pressed.sample = pressed.sample._replace(sensor_force=pressed.robot.specification.tool_force(0.0) + 0.3)
        pressed.run(pressed.robot.surface + 0.03, TICK)
    assert pressed.forces[-1] == 0.0


def test_a_force_that_is_in_uncertainty_is_not_pressed_towards() -> None:
    limits = SafetyLimits()
    for uncertain in (False, True):
        safety, path = Safety(limits, TICK), []
        for tick in range(300):
            sensed = 0.0, 1.0, True, False, uncertain and tick > 50
            path.append(keep_safe(safety, 0.01, sensed, 0.0, 0.0))
        assert (max(path) - path[60] > 1e-4) is not uncertain


def test_every_status_has_a_sentence() -> None:
    assert set(STATUS_SENTENCES) == set(Status)


@pytest.mark.parametrize(
    ("name", "value"),
    [("force", 0.0), ("speed", -1.0), ("jerk", math.nan), ("hold_after", 0.0), ("unload_after", 0.01)],
)
def test_limits_that_are_none_are_refused(name: str, value: float) -> None:
    with pytest.raises(SettingError, match=name):
        SafetyLimits(**{name: value})

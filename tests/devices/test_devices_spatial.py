"""Operators that move in three dimensions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foretouch.devices import GRIPS, DeviceSpecification, Hand, PalpatingOperator, SpatialBrowserOperator, SpatialHand
from foretouch.devices.device import Device
from foretouch.errors import SettingError

MS = 1_000_000
HERE = (0.0,) * 6
PATH = [(0.0, (0.0, 0.0, 0.02)), (0.5, (0.01, 0.0, 0.02)), (1.0, (0.01, 0.02, 0.0)), (1.5, (0.01, 0.0, 0.02))]


def read(operator: object, seconds: float, begin: float = 0.0) -> np.ndarray:
    ticks = range(round(begin * 1e3), round((begin + seconds) * 1e3))
    return np.array([operator.read(tick * MS) for tick in ticks])  # type: ignore[attr-defined]


def test_a_palpating_hand_goes_through_its_keyframes_smoothly_and_again() -> None:
    places = read(PalpatingOperator(PATH, HERE), 4.0)
    for time, place in PATH:
        np.testing.assert_allclose(places[round(time * 1e3)], place, atol=1e-6)
    np.testing.assert_allclose(places[1501:2500], places[501:1500], atol=1e-9)  # from the second keyframe on
    speed = np.abs(np.diff(places[:1500], axis=0)) / 1e-3
    assert speed.max() < 0.1
    low, high = np.min([place for _, place in PATH], axis=0), np.max([place for _, place in PATH], axis=0)
    assert (places >= low - 1e-9).all()
    assert (places <= high + 1e-9).all()


def test_it_follows_what_it_sees_as_an_eye_does() -> None:
    operator = PalpatingOperator([(0.0, (0.0, 0.0, 0.0)), (100.0, (0.0, 0.0, 0.0))], HERE)
    read(operator, 0.1)
    operator.see((0.02, 0.0, 0.01, 0.0, 0.0, 0.0))
    operator.see((math.nan,) * 6)  # is left out
    places = read(operator, 1.5, 0.1)
    assert np.abs(np.diff(places, axis=0)).max() < 2e-4  # no jump
    expected = 0.02 * -np.expm1(-0.3 / 0.15)
    assert places[299][0] == pytest.approx(expected, rel=0.02)
    np.testing.assert_allclose(places[-1], (0.02, 0.0, 0.01), atol=1e-5)


def test_a_path_that_would_jump_is_refused() -> None:
    with pytest.raises(SettingError, match="must end where the second is"):
        PalpatingOperator([*PATH, (2.0, (0.0, 0.0, 0.0))], HERE)


@pytest.mark.parametrize("path", [[], [(0.0, (0.0, 0.0, 0.0))], [(1.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.0, 0.0))]])
def test_a_path_that_is_none_is_refused(path: list) -> None:
    with pytest.raises(SettingError, match="growing times"):
        PalpatingOperator(path, HERE)


def test_a_browser_takes_over_and_gives_back_without_a_jump() -> None:
    operator = SpatialBrowserOperator(PalpatingOperator(PATH, HERE))
    places = [read(operator, 0.3)]
    for k in range(40):
        operator.take((0.02, -0.03, 0.04), True, round((0.3 + 0.025 * k) * 1e9))
        places.append(read(operator, 0.025, 0.3 + 0.025 * k))
    assert operator.held
    np.testing.assert_allclose(places[-1][-1], (0.02, -0.03, 0.04), atol=1e-4)
    operator.take((0.02, -0.03, 0.04), False, round(1.3e9))
    places.append(read(operator, 6.0, 1.3))
    assert not operator.held
    assert np.abs(np.diff(np.concatenate(places), axis=0)).max() < 6e-4
    for wrong in ((), (1.0,), (math.nan, 0.0, 0.0)):
        operator.take(wrong, True, round(7.4e9))
    assert not operator.held


class Along(Device):
    """One axis of a place as a device of its own."""

    name = "along"
    closed_loop = False

    def __init__(self, operator: PalpatingOperator, axis: int) -> None:
        self.operator, self.axis = operator, axis

    def read(self, now_ns: int) -> float:
        return self.operator.read(now_ns)[self.axis]

    def render(self, force: float) -> float:
        return 0.0


def test_each_axis_of_a_hand_is_the_hand_along_a_line() -> None:
    device = DeviceSpecification(damping=2.0)
    hand = SpatialHand(PalpatingOperator(PATH, HERE), GRIPS["normal"], device)
    lines = [Hand(Along(PalpatingOperator(PATH, HERE), axis), GRIPS["normal"], device) for axis in range(3)]
    for tick in range(1200):
        place = hand.read(tick * MS)
        assert place == tuple(line.read(tick * MS) for line in lines)
        force = max(2.0 * math.sin(0.01 * tick), 0.0)
        hand.render((-force, 0.0, -0.5 * force))  # against the axes: a hand along a line is pushed out so
        lines[0].render(force)
        lines[2].render(0.5 * force)


def test_a_hand_gives_no_more_than_its_device() -> None:
    device = DeviceSpecification(damping=2.0, force_limit=2.0, friction=0.0)
    still = PalpatingOperator([(0.0, (0.0, 0.0, 0.0)), (100.0, (0.0, 0.0, 0.0))], HERE)
    hand = SpatialHand(still, GRIPS["normal"], device)
    for force, expected in (((30.0, 40.0, 0.0), (1.2, 1.6, 0.0)), ((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0))):
        hand.render(force)
        read(hand, 2.0, 0.0 if force[1] else 2.0)
        np.testing.assert_allclose(hand.exact_position, np.array(expected) / GRIPS["normal"].stiffness, atol=1e-5)


def test_a_hand_in_a_hand_is_refused() -> None:
    hand = SpatialHand(PalpatingOperator(PATH, HERE), GRIPS["soft"], DeviceSpecification(damping=2.0))
    with pytest.raises(SettingError, match="open loop"):
        SpatialHand(hand, GRIPS["soft"], DeviceSpecification(damping=2.0))

"""Where a tool touches, from the wrench, against contacts whose place is known."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.robot.arms.sensing.tip_contact import TipSensing, Touching

CENTRE = (0.01, -0.02, 0.15)
FORCE_NOISE, TORQUE_NOISE = 0.03, 0.0008
numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


def sensing(radius: float) -> TipSensing:
    return TipSensing(radius, CENTRE, FORCE_NOISE, TORQUE_NOISE)


def wrench(force: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Of a force at a point from the centre of the tip."""
    return np.concatenate((force, np.cross(np.array(CENTRE) + point, force)))


@given(vectors, vectors, st.sampled_from((0.0, 0.001, 0.005, 0.02)), st.floats(1.0, 50.0))
def test_a_contact_with_friction_comes_out_where_it_is(normal, tangent, radius, size) -> None:
    assume(np.linalg.norm(normal) > 0.1)
    outwards = normal / np.linalg.norm(normal)
    across = tangent - (tangent @ outwards) * outwards
    force = size * (-outwards + 0.9 * across / max(1.0, np.linalg.norm(across)))  # within a wide cone of friction
    point = radius * outwards
    found = sensing(radius).locate(wrench(force, point))
    assert found.touching is Touching.TIP
    np.testing.assert_allclose(found.point, point, atol=1e-9)
    assert radius == 0.0 or force @ np.array(found.point) < 0.0
    assert found.distance <= radius + 1e-12


def test_a_contact_of_the_shaft_is_told_from_one_of_the_tip() -> None:
    random, tip = np.random.default_rng(11), sensing(0.005)
    said = {"tip": 0, "shaft": 0}
    noise = np.repeat((FORCE_NOISE, TORQUE_NOISE), 3)
    for _ in range(5000):
        outwards = random.normal(size=3)
        outwards /= np.linalg.norm(outwards)
        force = -random.uniform(0.5, 5.0) * outwards
        at_tip = wrench(force, 0.005 * outwards) + noise * random.standard_normal(6)
        said["tip"] += tip.locate(at_tip).touching is not Touching.TIP
        aside = np.array((random.uniform(1.0, 5.0), 0.0, 0.0))
        on_shaft = wrench(aside, np.array((0.0, 0.0, -0.06))) + noise * random.standard_normal(6)
        found = tip.locate(on_shaft)
        said["shaft"] += found.touching is not Touching.ELSEWHERE
        assert found.distance == pytest.approx(0.06, abs=6.0 * found.deviation)
    assert said == {"tip": 0, "shaft": 0}


def test_a_point_tip_is_not_blamed_for_noise() -> None:
    random, tip = np.random.default_rng(12), sensing(0.0)
    noise = np.repeat((FORCE_NOISE, TORQUE_NOISE), 3)
    for _ in range(20_000):
        found = tip.locate(wrench(np.array((0.0, 1.0, -1.0)), np.zeros(3)) + noise * random.standard_normal(6))
        assert found.touching is Touching.TIP
        assert found.point == (0.0, 0.0, 0.0)


def test_the_stated_deviation_is_not_smaller_than_that_of_the_points() -> None:
    random, tip = np.random.default_rng(13), sensing(0.02)
    noise = np.repeat((FORCE_NOISE, TORQUE_NOISE), 3)
    outwards = np.array((0.0, 0.6, -0.8))
    truth = wrench(-3.0 * outwards, 0.02 * outwards)
    found = [tip.locate(truth + noise * random.standard_normal(6)) for _ in range(2000)]
    spread = np.array([one.point for one in found]).std(axis=0).max()
    assert 0.5 < spread / found[0].deviation < 1.05


def test_a_force_too_small_or_no_number_says_nothing() -> None:
    tip = sensing(0.005)
    nothing = tip.locate(wrench(np.array((0.0, 0.0, 0.1)), np.array((0.3, 0.0, 0.0))))
    assert nothing.touching is Touching.NOTHING
    for bad in (np.nan, np.inf):
        for axis in range(6):
            broken = wrench(np.array((0.0, 0.0, -3.0)), np.zeros(3))
            broken[axis] = bad
            assert tip.locate(broken).touching is Touching.NOTHING


def test_it_is_cheap_and_refuses_what_cannot_be() -> None:
    tip, one = sensing(0.005), wrench(np.array((0.0, 0.0, -3.0)), np.zeros(3))
    begin = time.perf_counter()
    for _ in range(5000):
        tip.locate(one)
    assert (time.perf_counter() - begin) / 5000 < 2e-5
    for arguments in ((-1.0, CENTRE, 0.03, 0.001), (0.0, (0.0, 1.0), 0.03, 0.001), (0.0, CENTRE, 0.0, 0.001)):
        with pytest.raises(SettingError):
            TipSensing(*arguments)

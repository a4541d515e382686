"""Laws (1) to (4): arrays and loop agree, energy adds up, slopes are slopes, and where the equations pull."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from foretouch.models import (
    NO_STATE,
    ContinuousSwitching,
    HuntCrossley,
    KelvinVoigt,
    MemorylessLaw,
    ThresholdSwitching,
    advance,
)

EXAMPLES: list[MemorylessLaw] = [
    KelvinVoigt(6000.0, 500.0),
    HuntCrossley(3000.0, 1500.0, 1.4),
    ThresholdSwitching(3900.0, 500.0, 3000.0, 1500.0, 1.4, 4000.0),
    ThresholdSwitching(4000.0, 500.0, 3000.0, 1500.0, 1.4, 4000.0),
    ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5),
    ContinuousSwitching(4500.0, 0.0, 0.2, 0.9),
]
LAWS = pytest.mark.parametrize("law", EXAMPLES, ids=lambda law: f"{law.law}-{law.general_form}")

# Within (5), its ends included.
laws = st.tuples(st.floats(10.0, 1e5), st.floats(0.0, 1e4), st.floats(1.0, 1.99), st.floats(0.0, 1.0)).map(
    lambda p: ContinuousSwitching(p[0], p[1], p[2] - p[3], p[3])
)
depths = st.floats(-0.05, 0.05)
inside = st.floats(1e-4, 0.05)
velocities = st.floats(-2.0, 2.0)
quickly = settings(derandomize=True, deadline=None, max_examples=60)


@LAWS
@quickly
@given(pairs=st.lists(st.tuples(depths, velocities), min_size=1, max_size=20))
def test_arrays_and_the_loop_have_one_force(law: MemorylessLaw, pairs: list[tuple[float, float]]) -> None:
    depth, velocity = np.array(pairs).T
    looped = [advance(law, NO_STATE, x, v, 1e-3)[1] for x, v in pairs]
    np.testing.assert_allclose(law.force(depth, velocity), looped, rtol=1e-13, atol=0.0)


@quickly
@given(law=laws, depth=depths, velocity=velocities)
def test_arrays_and_the_loop_have_one_force_for_every_law(
    law: ContinuousSwitching, depth: float, velocity: float
) -> None:
    looped = advance(law, NO_STATE, depth, velocity, 1e-3)[1]
    assert float(law.force(depth, velocity)) == pytest.approx(looped, rel=1e-13, abs=0.0)


def test_the_general_law_is_equation_4() -> None:
    x, v = np.array([0.001, 0.01, 0.04]), np.array([0.02, -0.01, 0.0])
    law = ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5)
    expected = 4500.0 * x**1.2 + 1000.0 * x**0.7 * v
    np.testing.assert_allclose(law.force(x, v, allow_tension=True), expected, rtol=1e-12)


@quickly
@given(depth=depths, velocity=velocities)
def test_the_ends_of_the_general_law_are_the_two_others(depth: float, velocity: float) -> None:
    ends: list[tuple[MemorylessLaw, MemorylessLaw]] = [
        (ContinuousSwitching(6000.0, 500.0, 0.0, 1.0), KelvinVoigt(6000.0, 500.0)),
        (ContinuousSwitching(3000.0, 1500.0, 1.4, 0.0), HuntCrossley(3000.0, 1500.0, 1.4)),
    ]
    for general, special in ends:
        for tension in (False, True):
            assert general.force(depth, velocity, allow_tension=tension) == special.force(
                depth, velocity, allow_tension=tension
            )


def test_the_threshold_chooses() -> None:
    below = ThresholdSwitching(3999.0, 500.0, 3000.0, 1500.0, 1.4, 4000.0)
    at = ThresholdSwitching(4000.0, 500.0, 3000.0, 1500.0, 1.4, 4000.0)
    assert below.chosen == HuntCrossley(3000.0, 1500.0, 1.4)
    assert at.chosen == KelvinVoigt(4000.0, 500.0)
    jump = float(at.force(0.03, 0.0) - below.force(0.03, 0.0))
    assert jump == pytest.approx(4000.0 * 0.03 - 3000.0 * 0.03**1.4)


@LAWS
def test_shapes_broadcast_and_floats_give_numbers(law: MemorylessLaw) -> None:
    depth, velocity = np.linspace(-0.01, 0.03, 5)[:, None], np.linspace(-0.1, 0.1, 3)
    for method in (law.force, law.dissipated_power):
        assert method(depth, velocity).shape == (5, 3)
        assert isinstance(method(0.01, 0.02), float)
    assert law.stored_energy(depth).shape == (5, 1)
    assert isinstance(law.stored_energy(0.01), float)
    assert isinstance(law.tension_depth(-0.1), float)


@LAWS
def test_nan_stays_nan(law: MemorylessLaw) -> None:
    assert np.isnan(law.force([math.nan, 0.01], [0.0, math.nan])).all()
    assert np.isnan(law.stored_energy(math.nan))


@quickly
@given(law=laws, depth=depths, velocity=velocities)
def test_forces_pull_only_where_asked_and_below_the_tension_depth(
    law: ContinuousSwitching, depth: float, velocity: float
) -> None:
    assert law.force(depth, velocity) >= 0.0
    pulling = float(law.force(depth, velocity, allow_tension=True))
    limit = float(law.tension_depth(velocity))
    if depth <= 0.0:
        assert pulling == 0.0
    elif depth < 0.999 * limit:
        assert pulling < 0.0 or depth < 1e-300  # where the product underflows
    elif depth > 1.001 * limit:
        assert pulling >= 0.0


def test_tension_depths_known_by_hand() -> None:
    assert KelvinVoigt(6000.0, 500.0).tension_depth(-0.12) == pytest.approx(500.0 * 0.12 / 6000.0)
    assert KelvinVoigt(6000.0, 500.0).tension_depth(0.12) == 0.0
    hunt_crossley = HuntCrossley(3000.0, 1500.0, 1.4)
    np.testing.assert_array_equal(hunt_crossley.tension_depth([0.1, -1.9, -2.1]), [0.0, 0.0, np.inf])
    between = ContinuousSwitching(4500.0, 1000.0, 0.7, 0.5)
    assert between.tension_depth(-0.09) == pytest.approx(0.02**2)


@quickly
@given(law=laws, depth=inside)
def test_stored_energy_is_the_integral_of_the_force_at_rest(law: ContinuousSwitching, depth: float) -> None:
    work = quad(lambda x: float(law.force(x, 0.0)), 0.0, depth, epsabs=0.0, epsrel=1e-9)[0]
    assert float(law.stored_energy(depth)) == pytest.approx(work, rel=1e-7)
    assert law.stored_energy(-depth) == 0.0


@quickly
@given(law=laws, depth=depths, velocity=velocities)
def test_power_is_what_the_spring_takes_and_what_is_lost(
    law: ContinuousSwitching, depth: float, velocity: float
) -> None:
    _, damping, n, _ = law.general_form
    for tension in (False, True):
        lost = float(law.dissipated_power(depth, velocity, allow_tension=tension))
        into_spring = float(law.force(depth, 0.0)) * velocity
        total = float(law.force(depth, velocity, allow_tension=tension)) * velocity
        assert lost >= 0.0
        assert total == pytest.approx(into_spring + lost, rel=1e-9, abs=1e-12 * (abs(into_spring) + lost))
        if tension and depth > 0.0:
            expected = damping * depth**n * velocity**2
            assert lost == pytest.approx(expected, rel=1e-9, abs=1e-13 * abs(into_spring))


def test_validity_says_what_is_outside_range_5() -> None:
    for law in (KelvinVoigt(6000.0, 500.0), HuntCrossley(3000.0, 1500.0, 1.4), ContinuousSwitching(1.0, 1.0, 0.0, 1.0)):
        assert law.validity() == ()
    (steep,) = HuntCrossley(1.0, 1.0, 2.0).validity()
    assert "s = n + alpha = 2 is outside [1, 2)" in steep
    flat, wide = ContinuousSwitching(1.0, 1.0, 1.5, 1.5).validity()
    assert "s = n + alpha = 3" in flat
    assert "alpha = 1.5 is outside [0, 1]" in wide
    assert len(ContinuousSwitching(1.0, 1.0, 0.3, 0.3).validity()) == 1

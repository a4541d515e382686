"""What a device carries, against the theorem itself, and what models say of slopes and of the work to leave contact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from renderer_runs import example_map
from scipy.integrate import quad

from foretouch.models import ContinuousSwitching, HuntCrossley, KelvinVoigt, MotionFilter, Predictor, advance
from foretouch.models.predictor import VELOCITY_CUTOFF
from foretouch.rendering import rendered_share

TICK = 1e-3
quick = settings(derandomize=True, deadline=None, max_examples=40)


def needed_damping(stiffness: float, damping: float, period: float, delay: float = 0.0) -> float:
    """Colgate and Schenkel: the largest value over frequency, of a force whose transfer function is measured here."""
    gain = 1.0 - math.exp(-2.0 * math.pi * VELOCITY_CUTOFF * period)
    angle = np.linspace(1e-4, math.pi, 4001)
    back = np.exp(-1j * angle)
    velocity = gain / period * (1.0 - back) / (1.0 - (1.0 - gain) * back)
    late = delay / period  # in a tick the hand moves evenly
    force = (stiffness + damping * velocity) * (1.0 - late + late * back)
    return float(np.max(0.5 * period * np.real((1.0 - back) * force) / (1.0 - np.cos(angle))))


def test_the_transfer_function_is_that_of_the_motion_filter():
    gain = 1.0 - math.exp(-2.0 * math.pi * VELOCITY_CUTOFF * TICK)
    for frequency in (10.0, 150.0, 400.0):
        motion, angle = MotionFilter(), 2.0 * math.pi * frequency * TICK
        shown = [motion.update(k * TICK, math.cos(angle * k)) for k in range(400)]
        back = np.exp(-1j * angle)
        exact = gain / TICK * (1.0 - back) / (1.0 - (1.0 - gain) * back)
        assert shown[300:] == pytest.approx(
            np.real(exact * np.exp(1j * angle * np.arange(300, 400))), rel=1e-6, abs=1e-3
        )


@quick
@given(
    st.floats(0.0, 1e6),
    st.floats(-50.0, 50.0),
    st.sampled_from((0.5, 2.0, 5.0)),
    st.sampled_from((2e-4, 1e-3, 5e-3)),
    st.sampled_from((0.0, 0.3, 1.0)),
)
def test_the_share_is_the_largest_that_the_theorem_allows(stiffness, damping, device_damping, period, late):
    carried = {"device_damping": device_damping, "sample_period": period, "delay": late * period}
    share = rendered_share(stiffness, damping, **carried)
    assert 0.0 < share <= 1.0
    needed = needed_damping(share * stiffness, share * damping, period, late * period)
    assert needed <= device_damping * (1.0 + 1e-6)
    if share < 1.0 and (late == 0.0 or damping == 0.0 or stiffness == 0.0):  # with both, one maximum is at rest
        assert needed == pytest.approx(device_damping, rel=1e-4)


def test_the_share_in_numbers():
    carried = {"device_damping": 2.0, "sample_period": TICK}
    assert rendered_share(4000.0, 0.0, **carried) == 1.0
    assert rendered_share(40000.0, 0.0, **carried) == pytest.approx(0.1)
    assert rendered_share(40000.0, 0.0, delay=5e-4, **carried) == pytest.approx(0.05)  # b / (T / 2 + d)
    assert rendered_share(0.0, -20.0, **carried) == pytest.approx(0.1)
    # The low-pass leaves a quarter of a damper at half the sample rate.
    assert 2.0 / (20.0 * rendered_share(0.0, 20.0, **carried)) == pytest.approx(0.246, abs=1e-3)
    assert rendered_share(0.0, 0.0, device_damping=0.0, sample_period=TICK) == 1.0
    assert rendered_share(1.0, 0.0, device_damping=0.0, sample_period=TICK) == 0.0


LAWS = [KelvinVoigt(800.0, 5.0), HuntCrossley(3000.0, 200.0, 1.4), ContinuousSwitching(2000.0, 30.0, 0.6, 0.5)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.law)
@pytest.mark.parametrize("offset", [0.0, -0.7])
@pytest.mark.parametrize("depth", [5e-4, 3.3e-3, 4e-3, 9e-3])
def test_the_leaving_work_of_gives_back_the_integral_of_the_force_at_rest(law, depth, offset):
    def force(x):
        return max(float(law.force(x, 0.0)) + offset, 0.0)

    zero = (max(-offset, 0.0) / law.general_form[0]) ** (1.0 / sum(law.general_form[2:]))
    exact = quad(force, min(zero, depth), depth)[0]
    work, way = law.leaving_work((), depth, offset)
    assert work == pytest.approx(exact, rel=0.01, abs=0.004 * depth)
    assert way == pytest.approx(depth, abs=2.6e-4)


def test_outside_nothing_comes_back():
    for law in LAWS:
        assert law.leaving_work((), -1e-3) == (0.0, 0.0)
        assert law.leaving_work((), 0.0) == (0.0, 0.0)


@pytest.mark.parametrize("offset", [0.0, -0.5, 0.5])
def test_the_leaving_work_of_of_a_map_is_that_of_a_fine_walk(offset):
    """Sixteen slices against 2000, with what the material remembers passing at 50 mm/s."""
    model, state = example_map((0.2, 0.8, 0.0)), ()
    for depth in np.linspace(0.0, 6e-3, 300):
        state, _, _ = advance(model, state, depth, 0.02, TICK)
    work, way = model.leaving_work(state, 6e-3, offset)
    depths = np.linspace(6e-3, 0.0, 2001)
    forces = [model.advance(state, 6e-3, 0.0, TICK)[1]]
    for depth in depths[1:]:
        state, force, _ = model.advance(state, depth, 0.0, 3e-6 / 0.05)
        forces.append(force)
    walked = float(np.trapezoid(np.maximum(np.array(forces) + offset, 0.0), -depths))
    beyond = max(offset, 0.0) * 5e-3  # an offset above zero goes on beyond the surface, here for 5 mm
    assert work == pytest.approx(walked + beyond, rel=0.04)
    assert way >= 6e-3 - 1e-12


@quick
@given(st.sampled_from(LAWS), st.floats(1e-3, 0.02), st.floats(0.0, 0.1))
def test_local_slopes_are_the_laws_derivatives(law, depth, velocity):
    stiffness, damping = law.local_slopes((), depth, velocity, 1e-6)
    k, lam, n, alpha = law.general_form
    s, viscous = n + alpha, n * lam * velocity * depth ** (n - 1.0) if n > 0.0 else 0.0
    assert stiffness == pytest.approx(s * k * depth ** (s - 1.0) + viscous, rel=1e-2)
    assert damping == pytest.approx(lam * depth**n, rel=1e-6)


def test_a_surface_within_reach_is_seen_from_outside_and_its_step_counts_as_stiffness():
    wall = KelvinVoigt(1000.0, 20.0)
    assert wall.local_slopes((), -2e-5, 0.1, 1e-5) == (0.0, 0.0)
    # 0.1 m/s of 20 N s/m are 2 N at once.
    stiffness, _ = wall.local_slopes((), -1e-5, 0.1, 3e-5)
    assert stiffness == pytest.approx((2.0 + 1000.0 * 2e-5) / 3e-5, rel=1e-6)


def test_local_slopes_of_a_map_are_differences_of_its_forces():
    model, state = example_map((0.0, 1.0, 0.0)), ()
    for depth in np.linspace(0.0, 5e-3, 200):
        state, _, _ = advance(model, state, depth, 0.02, TICK)
    stiffness, damping = model.local_slopes(state, 5e-3, 0.02, 3e-5)
    # In no time nothing is remembered anew but the plays, which hold still for 30 um within their radius.
    forces = {v: model.advance(state, 5e-3, v, 1e-9)[1] for v in (0.018, 0.02, 0.022)}
    assert damping == pytest.approx((forces[0.022] - forces[0.018]) / 0.004, rel=1e-6)
    assert 300.0 < stiffness < 2000.0


def test_a_shift_is_seen_by_the_force_and_not_by_the_velocity():
    law, moved, still = KelvinVoigt(500.0, 10.0), Predictor(), Predictor()
    for predictor in (moved, still):
        predictor.adopt(law, 0.0)
        for k in range(200):
            predictor.update(k * TICK, 1e-3 + 2e-5 * k)
    moved.shift(2e-3)
    for k in range(200, 210):
        moved.update(k * TICK, 3e-3 + 2e-5 * k)
        still.update(k * TICK, 1e-3 + 2e-5 * k)
        assert moved.velocity == pytest.approx(still.velocity, rel=1e-9)
        assert moved.force == pytest.approx(still.force + 500.0 * 2e-3, rel=1e-9)


def test_a_shift_with_a_new_model_compares_with_the_old_one_where_that_would_have_been():
    predictor = Predictor()
    predictor.adopt(KelvinVoigt(500.0, 0.0), 0.0)
    for k in range(50):
        predictor.update(k * TICK, 4e-3)
    predictor.adopt(KelvinVoigt(800.0, 0.0), -2e-3)
    predictor.shift(-2e-3)
    predictor.update(0.05, 2e-3)
    assert predictor.force == pytest.approx(3.2)
    assert predictor.jump == pytest.approx(3.2 - 2.0)

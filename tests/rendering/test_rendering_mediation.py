"""Mediation: a new model makes no step, is let in in the time that is said, and only as far as it is paid for."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from foretouch.rendering import Mediation
from foretouch.rendering.mediation import LARGEST_STEP, RELEASE_TIME

TICK = 1e-3
RELEASED = -math.expm1(-TICK / RELEASE_TIME)


def update(mediation, wanted, jump=0.0, *, work=0.0, way=1e-3, energy=1.0, bound=0.0, period=TICK):
    """One tick; what the model gives back does not depend on the offset, and by default plenty is paid."""
    return mediation.update(
        wanted,
        jump,
        period,
        energy=energy,
        bound=bound,
        leaving_work=lambda offset: (work, way) if way > 0 else (0.0, 0.0),
    )


@pytest.mark.parametrize("jump", [0.02, 0.5, 3.0, -0.02, -0.5, -3.0])
def test_a_jump_is_let_in_by_the_step_and_then_in_its_time_constant(jump):
    mediation, before, after = Mediation(), 5.0, 5.0 + jump
    assert update(mediation, before) == before
    left = jump
    for number in range(200):
        left -= math.copysign(min(LARGEST_STEP, RELEASED * abs(left)), left)
        force = update(mediation, after, jump if number == 0 else 0.0)
        assert force == pytest.approx(after - left, abs=2e-6)
    assert force == after
    assert mediation.offset == 0.0


def test_how_long_it_takes():
    """3 N: 0.08 N a tick down to where a share of 1 - exp(-0.1) is less than that, and from there exponentially."""
    mediation, ticks = Mediation(), 0
    update(mediation, 5.0, 3.0)
    while abs(mediation.offset) > 0.01:
        update(mediation, 5.0)
        ticks += 1
    corner = LARGEST_STEP / RELEASED
    linear = math.ceil((3.0 - corner) / LARGEST_STEP)
    exponential = RELEASE_TIME / TICK * math.log((3.0 - linear * LARGEST_STEP) / 0.01)
    assert ticks + 1 == pytest.approx(linear + exponential, abs=1.01)


def test_the_wait_does_not_depend_on_how_ticks_are_cut():
    slow, fast = Mediation(), Mediation()
    for mediation in (slow, fast):
        mediation.offset = -0.05
    update(slow, 5.0, period=4 * TICK)
    for _ in range(4):
        update(fast, 5.0)
    assert slow.offset == pytest.approx(fast.offset, rel=1e-12)


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 1e3), st.floats(-1e3, 1e3), st.floats(0.0, 1.0), st.floats(0.0, 0.1), st.floats(-1.0, 1.0)
        ),
        max_size=40,
    )
)
@example([(5.0, 5.0, 1.0, 1e-9, 0.0)] * 20)
def test_models_never_step_the_force_by_more_than_a_step(ticks):
    """Reckoned from F, J and o as documented: what would be without model and release is max(0, F - J + o)."""
    mediation = Mediation()
    for wanted, jump, work, way, energy in ticks:
        jump = min(jump, wanted)  # no force is below zero
        without = max(wanted - jump + mediation.offset, 0.0)
        force = update(mediation, wanted, jump, work=work, way=way, energy=energy)
        assert force == max(wanted + mediation.offset, 0.0)
        assert abs(force - without) <= LARGEST_STEP + 1e-9
        assert mediation.step == pytest.approx(force - without, abs=1e-9)
        assert mediation.offset >= -wanted


def test_what_is_not_paid_for_is_not_let_in():
    mediation = Mediation()
    update(mediation, 5.0, 4.0, energy=2e-3, work=2e-3)
    assert mediation.offset == -4.0
    assert mediation.held_back
    # E - W = 0.05 mJ pays for 0.05 N over 1 mm.
    update(mediation, 5.0, energy=2.05e-3, work=2e-3)
    assert mediation.offset == pytest.approx(-3.95)
    assert mediation.held_back
    update(mediation, 5.0, energy=9e-3, work=2e-3)
    assert mediation.offset == pytest.approx(-3.87)
    assert not mediation.held_back


def test_what_is_not_covered_any_more_is_lowered_until_it_is():
    mediation = Mediation()
    # W is 0.03 mJ more than E and its bound: 0.03 N over 1 mm.
    update(mediation, 5.0, energy=1e-3, bound=1e-4, work=1.13e-3)
    assert mediation.offset == pytest.approx(-0.03)
    assert mediation.step == pytest.approx(-0.03)
    assert mediation.held_back
    # Within the bound nothing happens.
    update(mediation, 5.0, energy=1e-3, bound=1e-4, work=1.09e-3)
    assert mediation.offset == pytest.approx(-0.03)
    for _ in range(200):  # and never further than to nothing, never faster than a step
        update(mediation, 5.0, energy=0.0, work=1.0)
        assert mediation.step >= -LARGEST_STEP - 1e-12
    assert mediation.offset == -5.0
    assert mediation.force == 0.0


def test_a_lowered_force_that_is_paid_for_again_comes_back():
    mediation = Mediation()
    update(mediation, 5.0, energy=0.0, work=1.0)
    assert mediation.offset == -LARGEST_STEP
    for _ in range(200):
        update(mediation, 5.0, energy=1.0, work=0.0)
    assert mediation.offset == 0.0


def test_a_weaker_model_is_let_in_whatever_it_costs():
    mediation = Mediation()
    update(mediation, 2.0, -3.0, energy=-1.0, work=1.0, bound=0.5)
    assert mediation.offset == pytest.approx(3.0 - LARGEST_STEP)


def test_whoever_leaves_pays():
    """3 N of 5 are held back: on the way out nothing is left at 3 N, and who presses again feels the model."""
    mediation = Mediation()
    update(mediation, 5.0, 3.0, energy=0.0, work=0.0)
    for wanted in (4.0, 3.0, 2.0, 1.0):
        force = update(mediation, wanted, energy=0.0, work=0.0)
        assert force == pytest.approx(max(wanted - 3.0, 0.0))
    assert mediation.offset == -1.0
    assert update(mediation, 1.5, energy=0.0, work=0.0) == pytest.approx(0.5)
    assert update(mediation, 0.0) == 0.0
    assert mediation.offset == 0.0


def test_nothing_is_asked_of_a_model_that_gives_no_force():
    mediation = Mediation()

    def fail(offset):
        raise AssertionError("out of contact")

    assert mediation.update(0.0, -2.0, TICK, energy=0.0, bound=0.0, leaving_work=fail) == pytest.approx(1.92)

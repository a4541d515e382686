"""Friction with memory: closed forms of Dahl's law, energy, and what it does at rest and without contact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.models import BristleFriction

T, DAHL = 1e-3, BristleFriction(coefficient=0.4, viscous=0.0, stiffness=2000.0)
NOTHING = (0.0, 0.0, 0.0)


def slid(law: BristleFriction, speeds: np.ndarray, pressed: float, period: float = T) -> tuple[np.ndarray, np.ndarray]:
    """Forces along a straight motion, and the bends [m] at which they are."""
    bend, rows = NOTHING, []
    for speed in speeds.tolist():
        bend, force = law.advance(bend, (0.0, speed, 0.0), pressed, period)
        rows.append((force[1], bend[1]))
    forces, bends = np.array(rows).T
    return forces, bends


@pytest.mark.parametrize("period", [1e-3, 1e-4, 1e-5])
def test_it_is_dahls_closed_form_whatever_the_step_is(period: float) -> None:
    """Of a motion that begins: z = g / sigma (1 - exp(-sigma s / g)), Dahl (1968)."""
    speeds = np.full(round(0.05 / period), 0.02)
    _, bends = slid(DAHL, speeds, 1.5, period)
    carried = 0.4 * 1.5
    way = np.cumsum(speeds) * period
    assert bends == pytest.approx(carried / 2000.0 * -np.expm1(-2000.0 * way / carried), rel=1e-9)


def test_sliding_it_is_coulombs_and_viscous_friction() -> None:
    forces, _ = slid(BristleFriction(0.3, 2.0), np.full(2000, 0.05), 2.0)
    assert forces[-1] == pytest.approx(-(0.3 * 2.0 + 2.0 * 0.05))


def test_static_friction_is_larger_where_it_hardly_slides() -> None:
    law = BristleFriction(0.3, 0.0, static=1.5)
    slow, fast = (slid(law, np.full(20_000, speed), 1.0)[0][-1] for speed in (1e-4, 0.05))
    assert (slow, fast) == pytest.approx((-0.45, -0.3), rel=1e-3)


def test_at_rest_it_holds_and_without_contact_it_forgets() -> None:
    _, bends = slid(DAHL, np.array([0.02] * 100 + [0.0] * 1000), 1.0)
    assert bends[-1] == bends[99] > 0.0
    assert DAHL.advance((0.0, bends[-1], 0.0), NOTHING, 0.0, T) == (NOTHING, NOTHING)
    bend, _ = DAHL.advance((0.0, bends[-1], 0.0), NOTHING, 0.1, T)
    assert bend[1] == pytest.approx(0.4 * 0.1 / 2000.0)  # what a smaller normal force does not hold has let go


@given(
    st.lists(st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(0.0, 5.0)), min_size=1, max_size=60),
    st.sampled_from([1.0, 2.0]),
    st.sampled_from([1e-4, 1e-3, 5e-3]),
)
def test_it_never_gives_out_more_than_the_bristles_held(
    motion: list[tuple[float, float, float]], static: float, period: float
) -> None:
    law, bend, given_out = BristleFriction(0.5, 0.5, 1500.0, static), NOTHING, 0.0
    for x, y, pressed in motion:
        bend, force = law.advance(bend, (x, y, 0.0), pressed, period)
        given_out += (force[0] * x + force[1] * y) * period
        stored = 0.5 * law.stiffness * (bend[0] ** 2 + bend[1] ** 2)
        assert given_out + stored <= 1e-9
        assert math.hypot(*bend) <= law.static * 0.5 * pressed / law.stiffness * (1.0 + 1e-9)


def test_a_wrong_number_is_one_line() -> None:
    with pytest.raises(SettingError, match="static"):
        BristleFriction(static=0.5)

"""The clamps before the hand."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.rendering import ForceLimiter


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=50))
def test_no_force_leaves_the_limits(wanted: list[float]) -> None:
    limiter, before = ForceLimiter(10.0, 200.0), 0.0
    for force in wanted:
        given_force = limiter.update(force, 1e-3)
        assert 0.0 <= given_force <= 10.0
        assert abs(given_force - before) <= 0.2 + 1e-12
        assert limiter.clipped == (not abs(given_force - force) <= 1e-3)
        before = given_force


def test_within_the_limits_the_force_passes_untouched() -> None:
    limiter = ForceLimiter()
    forces = [0.1 * n for n in range(50)]
    assert [limiter.update(force, 1e-3) for force in forces] == forces
    assert not limiter.clipped


def test_what_is_no_number_lets_go_as_fast_as_allowed() -> None:
    limiter = ForceLimiter(10.0, 200.0)
    for _ in range(50):
        limiter.update(5.0, 1e-3)
    assert [limiter.update(math.nan, 1e-3) for _ in range(3)] == pytest.approx([4.8, 4.6, 4.4])
    assert limiter.clipped


@pytest.mark.parametrize("limits", [(0.0, 1.0), (1.0, -1.0), (math.inf, 1.0)])
def test_limits_must_be_positive(limits: tuple[float, float]) -> None:
    with pytest.raises(SettingError):
        ForceLimiter(*limits)

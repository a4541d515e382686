"""Figures of a scene with little to say: a pose that is never right again, a phantom that is felt all alike."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_sessions import make_session

from foretouch.models import MaterialField
from foretouch.report.scene.map import StiffnessMap, map_figures
from foretouch.report.scene.pose import NEAR_FOR, NEAR_MM, PoseError, pose_figures
from foretouch.session.spatial import make_scene

TICK = 0.1
FIELD = MaterialField([(0, 0, 0)], [(400.0, 0.0, 0.0, 0.1)], mean=(400.0, 0.0, 0.0), doubt=0.1)


def error_of(far: np.ndarray, end: float, tick: float = TICK) -> PoseError:
    """A bump from 0.05 s on, and ticks that are far off or not."""
    ticks = tick * np.arange(far.size)
    none = np.zeros(0)
    return PoseError(ticks, np.where(far, 2.0 * NEAR_MM, 0.0), 0.0 * ticks, none, none, none, ((0.05, end),))


def recovered(error: PoseError) -> float | None:
    deviation = np.full(error.time.size, np.nan)
    whole = PoseError(error.time, error.place, error.turn, deviation, deviation, np.zeros(0), error.bumps)
    found: float | None = pose_figures(make_session(1.0), whole)["bumps"][0]["recovered_s"]
    return found


@given(st.lists(st.booleans(), min_size=2, max_size=60), st.integers(0, 8))
def test_a_pose_is_right_again_behind_the_last_tick_before_a_long_enough_rest(far: list[bool], end_tick: int) -> None:
    end = end_tick * TICK + 0.05
    error = error_of(np.array(far), end)
    expected = None
    for start in [end, *(t for t, wrong in zip(error.time.tolist(), far, strict=True) if wrong and t >= end)]:
        until = min(
            (t for t, wrong in zip(error.time.tolist(), far, strict=True) if wrong and t > start),
            default=max(error.time[-1], end),
        )
        if until - start >= NEAR_FOR:
            expected = start - 0.05
            break
    found = recovered(error)
    assert found == (None if expected is None else pytest.approx(expected))


def test_a_quarter_of_an_hour_that_is_never_right_again_is_judged_at_once() -> None:
    error = error_of(np.ones(1_000_000, dtype=bool), 0.5, 1e-3)
    begun = time.monotonic()
    assert recovered(error) is None
    assert time.monotonic() - begun < 20.0  # going over all ticks for each took hours


def test_a_phantom_that_is_felt_all_alike_has_no_inclusion() -> None:
    axis = np.linspace(-0.03, 0.03, 7)
    alike = np.full((7, 7), 400.0)
    found = StiffnessMap(0.075 + axis, axis, alike, 0.1 * alike, alike, np.ones((7, 7), dtype=bool))
    with np.errstate(all="raise"):
        figures = map_figures(found, FIELD, make_scene("phantom"))
    assert figures["inclusion"] is None
    assert figures["median_error_percent"] == 0.0

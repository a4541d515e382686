"""The field of scales: SciPy's interpolation, the closed form of what is not touched, and hostile bytes."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from foretouch.errors import DecodeError
from foretouch.models import HuntCrossley, KelvinVoigt, ScaleField, advance, force_at_rest, stiffness_at_rest
from foretouch.models.scale_field import NODE, packed
from foretouch.models.scale_field_kernel import FILLED, LARGEST_LOG, REACH, SIDE, SPACING, SPREAD
from foretouch.robot.materials import make_material

MIDDLE = SIDE // 2


def a_patch(rows: int = 6) -> tuple[ScaleField, np.ndarray]:
    """A square of touched nodes about the origin, and the logarithms of their scales."""
    at = np.arange(MIDDLE - rows, MIDDLE + rows)
    i, j = (part.ravel() for part in np.meshgrid(at, at, indexing="ij"))
    value = np.random.default_rng(1).normal(0.0, 0.5, i.size).astype(np.float16).astype(float)
    field = ScaleField()
    field.take(packed(i, j, value, np.full(i.size, 0.01)))
    return field, value.reshape(at.size, at.size)


def test_between_nodes_the_logarithm_of_the_scale_is_bilinear() -> None:
    field, value = a_patch()
    axis = SPACING * (np.arange(MIDDLE - 6, MIDDLE + 6) - MIDDLE)
    points = np.random.default_rng(2).uniform(axis[0], axis[-1], (200, 2))
    expected = np.exp(RegularGridInterpolator((axis, axis), value)(points))
    scales, deviations = field.scales_at(points)
    assert scales == pytest.approx(expected, rel=1e-9)
    assert deviations == pytest.approx(0.1, rel=1e-3)
    assert [field.scale_at((x, y, 0.3))[0] for x, y in points.tolist()] == pytest.approx(expected, rel=1e-9)


def test_beyond_what_was_touched_the_scale_goes_back_to_one_and_the_doubt_grows() -> None:
    field, rows = ScaleField(), np.arange(SIDE // 4, 3 * SIDE // 4)
    column = np.full(rows.size, MIDDLE)
    field.take(packed(rows, column, np.full(rows.size, 1.0), np.zeros(rows.size)))
    away = SPACING * np.arange(FILLED + 1)
    scales, deviations = field.scales_at(np.stack([np.zeros(away.size), away], axis=1))
    assert np.log(scales) == pytest.approx(np.exp(-away / REACH), rel=1e-3)
    assert np.square(deviations) == pytest.approx(SPREAD**2 * -np.expm1(-2.0 * away / REACH), abs=1e-3)
    far = field.scale_at((0.0, (FILLED + 1.0) * SPACING))
    assert far == (1.0, SPREAD)


def test_before_anything_is_known_and_where_no_place_is_the_law_is_taken_as_it_is() -> None:
    field, _ = a_patch()
    assert ScaleField().scale_at((0.0, 0.0, 0.0)) == (1.0, SPREAD)
    for place in ((math.nan, 0.0), (0.0, math.inf), (1e9, 0.0)):
        scale, deviation = field.scale_at(place)
        assert (scale, deviation) == (1.0, SPREAD)


def test_messages_add_up_and_a_later_one_replaces_a_node() -> None:
    field = ScaleField()
    assert (field.count, field.messages) == (0, 0)
    field.take(packed([MIDDLE], [MIDDLE], [0.5], [0.01]))
    field.take(packed([MIDDLE + 1], [MIDDLE], [-0.5], [0.01]))
    field.take(packed([MIDDLE], [MIDDLE], [0.25], [0.01]))
    assert (field.count, field.messages) == (2, 3)
    assert field.scale_at((0.0, 0.0))[0] == pytest.approx(math.exp(0.25))
    assert field.scale_at((SPACING, 0.0))[0] == pytest.approx(math.exp(-0.5))


def test_a_node_takes_six_bytes() -> None:
    assert len(packed(range(16), range(16), np.zeros(16), np.ones(16))) == 8 + 16 * 6


GOOD = packed([1, 2], [3, 4], [0.1, -0.1], [0.2, 0.3])
SPOILT = {
    "nothing": b"",
    "a header alone": GOOD[:8],
    "cut": GOOD[:-1],
    "too long": GOOD + b"\0",
    "another version": GOOD[:2] + b"\x09" + GOOD[3:],
    "another kind": b"MF" + GOOD[2:],
    "too strong": packed([1], [1], [0.0], [0.0])[:8] + np.array([(1, 1, 2.0 * LARGEST_LOG, 0.1)], NODE).tobytes(),
    "no number": packed([1], [1], [0.0], [0.0])[:8] + np.array([(1, 1, np.nan, 0.1)], NODE).tobytes(),
    "a doubt below zero": packed([1], [1], [0.0], [0.0])[:8] + np.array([(1, 1, 0.0, -0.1)], NODE).tobytes(),
}


@pytest.mark.parametrize("what", SPOILT)
def test_what_is_no_message_is_refused_and_changes_nothing(what: str) -> None:
    field, _ = a_patch()
    before = field.records.tobytes()
    with pytest.raises(DecodeError, match=r"no field of scales: ."):
        field.take(SPOILT[what])
    assert field.records.tobytes() == before


@given(st.binary(max_size=64) | st.binary(min_size=12, max_size=12).map(lambda more: GOOD[:8] + more))
def test_no_bytes_make_a_scale_that_is_none(content: bytes) -> None:
    field = ScaleField()
    with suppress(DecodeError):
        field.take(content)
    scales, deviations = field.scales_at(np.random.default_rng(0).uniform(-0.5, 0.5, (50, 2)))
    assert np.isfinite(scales).all()
    assert (scales > 0.0).all()
    assert ((deviations >= 0.0) & (deviations <= SPREAD)).all()


def test_the_stiffness_of_a_law_at_rest_is_its_slope() -> None:
    assert stiffness_at_rest(KelvinVoigt(600.0, 2.0)) == pytest.approx(600.0)
    assert stiffness_at_rest(HuntCrossley(5e3, 50.0, 1.5), 4e-3) == pytest.approx(1.5 * 5e3 * 4e-3**0.5, rel=1e-3)
    assert stiffness_at_rest(KelvinVoigt(600.0, 2.0), 0.0) == pytest.approx(300.0), "half of the slope is outside"


@pytest.mark.parametrize("material", ["foam-measured", "sponge", "foam"])
def test_a_material_that_remembers_is_as_stiff_as_when_it_is_pressed_and_rests(material: str) -> None:
    """Against the same press in ticks of a millisecond; pressed in an instant, foam is half as stiff again."""
    model = make_material(material).model
    felt = []
    for depth in (1.9e-3, 2.1e-3):
        state, force = model.initial_state(), 0.0
        for tick in range(round(depth / 1e-5) + 1000):
            place = min(1e-5 * (tick + 1), depth)
            state, force, _ = advance(model, state, place, 0.01 if place < depth else 0.0, 1e-3)
        felt.append(force)
        assert force_at_rest(model, depth)[0] == pytest.approx(force, rel=0.05)
    assert stiffness_at_rest(model) == pytest.approx((felt[1] - felt[0]) / 2e-4, rel=0.05)

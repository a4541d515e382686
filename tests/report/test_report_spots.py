"""Stiff and soft spots against maps of which every number is known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scene_sessions import field_update, make_scene_session, model, put

from foretouch.models.scale_field import packed
from foretouch.models.scale_field_kernel import SIDE, SPACING
from foretouch.report import render_text, session_figures
from foretouch.report.scene.map import StiffnessMap
from foretouch.report.scene.spots import NOTICEABLE, SMALLEST, SURE, find_spots, spot_figures
from foretouch.session.spatial import Inclusion

AXIS = np.arange(-0.030, 0.0305, 1e-3)
COLUMNS, ROWS = np.meshgrid(0.075 + AXIS, AXIS)
EVERYWHERE = np.ones(COLUMNS.shape, dtype=bool)


def map_of(factor: np.ndarray, deviation: float = 0.1, touched: np.ndarray = EVERYWHERE) -> StiffnessMap:
    """A map whose stiffness is 400 N/m times a factor, each place known to a relative deviation."""
    learnt = 400.0 * factor
    return StiffnessMap(0.075 + AXIS, AXIS, learnt, deviation * learnt, None, touched)


def disc(x_mm: float, y_mm: float, radius_mm: float, ratio: float) -> np.ndarray:
    """The factor of an inclusion with its soft edge, at a place from the middle of the map."""
    one = Inclusion((0.075 + 1e-3 * x_mm, 1e-3 * y_mm, 0.0), 1e-3 * radius_mm, ratio)
    return np.array([one.factor((x, y, 0.0)) for x, y in zip(COLUMNS.flat, ROWS.flat, strict=True)]).reshape(
        COLUMNS.shape
    )


PLACES, RADII = st.integers(-14, 14), st.integers(6, 12)
RATIOS = st.floats(1.5, 6.0) | st.floats(0.2, 0.65)


@settings(max_examples=8, deadline=None)
@given(st.floats(1e-3, 1e5), st.floats(0.0, 1.0), st.integers(0, 2**31))
def test_a_field_that_is_alike_has_no_spot(stiffness: float, deviation: float, seed: int) -> None:
    """Whatever it is, however well it is known, wherever it was touched."""
    touched = np.random.default_rng(seed).random(EVERYWHERE.shape) < 0.3
    with np.errstate(all="raise"):
        assert find_spots(map_of(np.full(EVERYWHERE.shape, stiffness), deviation, touched)) == []


def test_noise_of_alike_places_is_no_spot() -> None:
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0.0, 0.15, EVERYWHERE.shape)
        assert find_spots(map_of(np.exp(noise), 0.15)) == []


@settings(max_examples=8, deadline=None)
@given(PLACES, PLACES, RADII, RATIOS)
def test_a_disc_is_given_back(x: int, y: int, radius: int, ratio: float) -> None:
    (spot,) = find_spots(map_of(disc(x, y, radius, ratio)))
    assert spot.middle == pytest.approx((0.075 + 1e-3 * x, 1e-3 * y), abs=0.5e-3)
    assert spot.radius == pytest.approx(1e-3 * radius, abs=1e-3)
    assert spot.ratio == pytest.approx(ratio, rel=0.03)
    assert spot.places.sum() * 1e-6 == pytest.approx(math.pi * spot.radius**2)


@settings(max_examples=8, deadline=None)
@given(PLACES, PLACES, PLACES, PLACES, st.floats(1.5, 4.0))
def test_two_discs_are_given_back_one_stiff_and_one_soft(x: int, y: int, u: int, v: int, ratio: float) -> None:
    assume(math.hypot(x - u, y - v) > 20.0)
    spots = find_spots(map_of(disc(x, y, 7.0, ratio) * disc(u, v, 7.0, 1.0 / ratio)))
    stiff, soft = sorted(spots, key=lambda spot: -spot.ratio)
    assert stiff.middle == pytest.approx((0.075 + 1e-3 * x, 1e-3 * y), abs=1e-3)
    assert soft.middle == pytest.approx((0.075 + 1e-3 * u, 1e-3 * v), abs=1e-3)
    assert (stiff.ratio, soft.ratio) == pytest.approx((ratio, 1.0 / ratio), rel=0.05)


@settings(max_examples=6, deadline=None)
@given(PLACES, PLACES, RADII, RATIOS, st.floats(1e-3, 1e3))
def test_soft_spots_are_the_stiff_ones_of_the_inverse_in_any_unit(
    x: int, y: int, radius: int, ratio: float, unit: float
) -> None:
    factor = disc(x, y, radius, ratio)
    (spot,), (other,) = find_spots(map_of(factor)), find_spots(map_of(unit / factor))
    assert other.middle == pytest.approx(spot.middle)
    assert (other.radius, other.deviations) == pytest.approx((spot.radius, spot.deviations))
    assert other.ratio == pytest.approx(1.0 / spot.ratio)


def test_deviations_are_those_of_the_mean_of_its_nodes() -> None:
    """A disc with a sharp edge on a map without scatter: by hand."""
    factor = np.where(np.hypot(COLUMNS - 0.075, ROWS) < 0.0085, 2.0, 1.0)
    (spot,) = find_spots(map_of(factor, 0.3))
    nodes = spot.places.sum() / 9.0
    mean = np.log(factor[spot.places]).mean()
    assert spot.deviations == pytest.approx(mean / (0.3 / math.sqrt(nodes)))
    (surer,) = find_spots(map_of(factor, 0.1))
    assert surer.deviations == pytest.approx(3.0 * spot.deviations)
    assert find_spots(map_of(factor, 1.2 * 0.3 * spot.deviations / SURE)) == []


@pytest.mark.parametrize(
    ("radius", "ratio"), [(1e3 * SMALLEST - 1.0, 2.0), (8.0, NOTICEABLE - 0.03), (8.0, 1.0 / (NOTICEABLE - 0.03))]
)
def test_what_is_too_small_or_too_alike_is_no_spot(radius: float, ratio: float) -> None:
    assert find_spots(map_of(disc(0.0, 0.0, radius, ratio), 0.02)) == []
    assert len(find_spots(map_of(disc(0.0, 0.0, radius + 4.0, max(ratio, 1.0 / ratio) + 0.2), 0.02))) == 1


def test_a_spot_is_compared_with_what_surrounds_it() -> None:
    """On a surface that becomes stiffer from one side to the other."""
    slope = np.exp(8.0 * (COLUMNS - 0.075))
    (spot,) = find_spots(map_of(slope * disc(9.0, 0.0, 6.0, 2.5)))
    assert spot.ratio == pytest.approx(2.5, rel=0.12)
    assert spot.middle == pytest.approx((0.084, 0.0), abs=1e-3)


def test_a_spot_on_the_stiffer_side_of_a_surface_is_told_from_that() -> None:
    """Which is much stiffer than the median, but no more than places of this surface differ."""
    slope = np.exp(0.4 * (COLUMNS - 0.075) / 0.030)
    assert find_spots(map_of(slope, 0.02)) == []
    (spot,) = find_spots(map_of(slope * disc(18.0, 0.0, 5.0, 6.0), 0.02))
    assert spot.middle == pytest.approx((0.093, 0.0), abs=1e-3)
    assert spot.ratio == pytest.approx(6.0, rel=0.1)


def test_a_gentle_rise_towards_the_rim_is_no_spot() -> None:
    """Its top is a third stiffer than the median, and not much more than what is beside it."""
    rise = 0.33 * np.clip((COLUMNS - 0.090) / 0.015, 0.0, 1.0)
    assert find_spots(map_of(np.exp(rise), 0.02)) == []
    assert len(find_spots(map_of(np.exp(2.0 * rise), 0.02))) == 1


def test_a_ridge_that_nobody_went_over_between_two_rows_does_not_part_a_spot() -> None:
    """A row of nodes without a touch is nearer to the law, and less sure."""
    factor, ridge = disc(0.0, 0.0, 9.0, 3.0), np.abs(ROWS) < 1.5e-3
    result = map_of(np.where(ridge, np.sqrt(factor), factor))
    result.uncertainty[ridge] *= 4.0
    (spot,) = find_spots(result)
    assert spot.radius == pytest.approx(9e-3, abs=1e-3)


@settings(max_examples=8, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 60), st.integers(0, 60), st.sampled_from(("learnt", "uncertainty"))), max_size=40
    ),
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -5.0]),
    st.integers(0, 2**31),
)
def test_no_number_that_is_none_comes_out(bad: list[tuple[int, int, str]], value: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    result = map_of(disc(0.0, 0.0, 9.0, 3.0), touched=random.random(EVERYWHERE.shape) < 0.5)
    for row, column, name in bad:
        getattr(result, name)[row, column] = value
    with np.errstate(all="raise"):
        spots = find_spots(result)
    (figures,) = spot_figures(spots)
    assert figures["kind"] == "stiff"
    assert figures["ratio"] == pytest.approx(3.0, rel=0.1)
    assert np.isfinite([*figures["centre_mm"], figures["radius_mm"], figures["ratio"], figures["deviations"]]).all()


@pytest.mark.parametrize("value", [math.nan, 0.0, -1.0, math.inf])
def test_nothing_that_counts_has_no_spot(value: float) -> None:
    assert find_spots(map_of(np.full(EVERYWHERE.shape, value))) == []
    assert find_spots(map_of(disc(0.0, 0.0, 9.0, 3.0), touched=~EVERYWHERE)) == []


def test_the_report_of_a_session_lists_them_whatever_its_scene_is_made_of() -> None:
    """The probe goes over a plane in rows 3 mm apart; what was learnt has a disc that the scene has not."""
    log = make_scene_session(17 * 200)
    along, rows = np.linspace(-0.024, 0.024, 200), np.linspace(-0.024, 0.024, 17)
    put(log.follower_space, "place", np.array([(x, y, 0.0) for y in rows for x in along]))
    log.follower["in_contact"], log.follower["force"], log.follower["exact_force"] = True, 1.0, 1.0
    i, j = (part.ravel() for part in np.meshgrid(np.arange(14, 37), np.arange(-11, 12), indexing="ij"))
    for ratio, kind in ((2.0, "stiff"), (0.5, "soft"), (1.0, "")):
        one = Inclusion((0.081, -0.006, 0.0), 0.009, ratio)
        scale = [one.factor((SPACING * x, SPACING * y, 0.0)) for x, y in zip(i, j, strict=True)]
        field = packed(i + SIDE // 2, j + SIDE // 2, np.log(scale), np.full(i.size, 1e-2))
        report = session_figures(dataclasses.replace(log, fields=(field_update(field),), models=(model(1, 100),)))
        found, text = report["scene"]["map"]["spots"], render_text(report)
        assert [spot["kind"] for spot in found] == ([kind] if kind else [])
        if kind:
            assert found[0]["centre_mm"] == pytest.approx([81.0, -6.0], abs=0.5)
            assert found[0]["radius_mm"] == pytest.approx(9.0, abs=1.0)
            assert found[0]["ratio"] == pytest.approx(ratio, rel=0.05)
            assert f"1: {kind}, at ({found[0]['centre_mm'][0]:.1f}, " in text
        else:
            assert "spots      none" in text
        assert all(len(line) < 125 for line in text.splitlines() if "spots" in line)

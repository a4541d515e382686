"""A contact map: what it remembers, its splines, and what it says where nobody has been."""

from __future__ import annotations

import math

import numpy as np
import pytest
from example_maps import example_map, example_numbers, model_of, random_numbers, whole_numbers
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.models import ContinuousSwitching, HuntCrossley, KelvinVoigt, advance
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import advance as kernel_advance
from foretouch.models.contact_map.kernel import experts, locate, run
from foretouch.models.contact_map.layout import (
    COARSE,
    GRIDS,
    LARGEST_FEATURES,
    LETTING_GO,
    MEMORY,
    PLAYS,
    TIMES,
)

places = st.lists(st.floats(-5e-3, 15e-3), min_size=1, max_size=30)
periods = st.floats(1e-5, 0.5)


def histories(depth: list[float], period: float | list[float] = 1e-3, *, origin: float = 0.0) -> np.ndarray:
    """Memory after each sample, shape (n, MEMORY)."""
    maps = example_numbers()
    maps[0].origin = origin
    memory = np.full(MEMORY, math.nan)
    result = []
    for place, time in np.broadcast(np.asarray(depth), np.asarray(period)):
        run(maps, memory, np.array([place]), np.array([time]))
        result.append(memory.copy())
    return np.array(result)


def said(maps: np.ndarray, place: float, velocity: float = 0.0, values: np.ndarray | None = None) -> np.ndarray:
    """Forces of law, coarse and fine map, and the one that they agree on, of what sticks, shape (4,)."""
    values = np.zeros(LARGEST_FEATURES) if values is None else values
    return np.array(experts(maps[0], values, place, velocity, 1.0, True))


# --- memory -----------------------------------------------------------------------------------------------------------


def play(depth: list[float], radius: float) -> list[float]:
    """A block of half-width `radius` that is pushed along by whoever reaches its edge."""
    position, result = depth[0], []
    for place in depth:
        if place > position + radius:
            position = place - radius
        elif place < position - radius:
            position = place + radius
        result.append(position)
    return result


@given(places, st.floats(-2e-3, 2e-3))
def test_plays_are_blocks_that_are_pushed(depth: list[float], origin: float) -> None:
    result = histories(depth, origin=origin)
    for k, radius in enumerate(PLAYS):
        expected = np.array(play([place - origin for place in depth], radius))
        np.testing.assert_allclose(result[:, k], expected, rtol=0.0, atol=1e-17)


@given(st.floats(1e-3, 15e-3), st.floats(0.0, 1.0))
def test_a_press_and_its_release_leave_the_play_between(peak: float, share: float) -> None:
    back = share * peak
    result = histories([0.0, peak, back])[-1]
    for k, radius in enumerate(PLAYS):
        assert result[k] == pytest.approx(min(peak - radius, back + radius), abs=1e-15)


@given(places)
def test_plays_do_not_know_how_fast_it_was(depth: list[float]) -> None:
    """The same way in smaller steps, at any speed, ends in the same place."""
    fine = np.interp(np.arange(0.0, len(depth) - 0.9, 0.25), np.arange(len(depth)), depth)
    slowly, quickly = histories(fine.tolist(), 0.1)[-1], histories(depth, 1e-4)[-1]
    np.testing.assert_allclose(slowly[: len(PLAYS)], quickly[: len(PLAYS)], rtol=0.0, atol=1e-15)


@given(st.lists(periods, min_size=1, max_size=30), st.floats(1e-3, 15e-3))
def test_averages_follow_a_step_as_first_order_lags_do(period: list[float], depth: float) -> None:
    """x (1 - exp(-t / T)) after a step from outside, exp(-t / T) of it after the step back, whatever the periods."""
    inside = [1e-3, *period]
    result = histories([-2e-3] + [depth] * len(period) + [-1e-3] * len(period), [*inside, *period])[:, len(PLAYS) : -1]
    since = np.cumsum(period)[:, None]
    risen = depth * (1.0 - np.exp(-since / TIMES))
    np.testing.assert_array_equal(result[0], 0.0)  # outside counts as no depth
    np.testing.assert_allclose(result[1 : len(period) + 1], risen, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(result[len(period) + 1 :], risen[-1] * np.exp(-since / TIMES), rtol=1e-11, atol=1e-18)


@given(st.lists(st.tuples(st.floats(-5e-3, 15e-3), periods), min_size=1, max_size=30), st.booleans())
def test_remembering_at_once_is_advancing_sample_by_sample(samples: list[tuple[float, float]], begun: bool) -> None:
    model = example_map()
    begin = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3) if begun else ()
    state = begin
    for depth, period in samples:
        state, _, _ = advance(model, state, depth, 0.1, period)
    depth, period = np.array(samples).T
    assert model.remember(begin, np.ascontiguousarray(depth), np.ascontiguousarray(period)) == state
    assert len(state) == MEMORY


def test_no_motion_changes_no_memory() -> None:
    state = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 1.0)
    assert example_map().remember(state, np.empty(0), np.empty(0)) == state


@pytest.mark.parametrize("state", [(), (1.0, 2.0)])
@pytest.mark.parametrize("law", [KelvinVoigt(1.0, 1.0), HuntCrossley(1.0, 1.0, 1.4), ContinuousSwitching(1, 1, 1, 1)])
def test_a_law_without_memory_remembers_nothing(law: KelvinVoigt, state: tuple[float, ...]) -> None:
    assert law.remember(state, np.full(9, 0.01), np.full(9, 1e-3)) == state


@pytest.mark.parametrize(("bad", "at"), [(math.nan, 1), (math.nan, MEMORY - 1), (math.inf, MEMORY - 1)])
def test_a_memory_that_is_no_number_counts_as_none(bad: float, at: int) -> None:
    state = [1e-3] * MEMORY
    state[at] = bad
    model = example_map()
    assert advance(model, tuple(state), 5e-3, 0.0, 1e-3)[1] < 10.0


# --- splines ----------------------------------------------------------------------------------------------------------


@given(st.floats(-1.0, 1.0) | st.floats(-5e-3, 5e-3), st.sampled_from([0, 1]), st.booleans())
def test_splines_are_a_partition_of_unity(place: float, kind: int, of_features: bool) -> None:
    grid = GRIDS[kind]
    spacing, below, knots = grid.spacing, grid.below, grid.knots
    if of_features:
        spacing, below, knots = grid.feature_spacing, grid.feature_below, grid.feature_knots
    values = np.empty(4)
    first = locate(place, spacing, below, knots, values)
    assert 0 <= first <= knots - 4
    assert values.sum() == pytest.approx(1.0, abs=1e-14)
    assert (values >= 0.0).all()


@pytest.mark.parametrize("kind", [0, 1])
@given(seed=st.integers(0, 99), knot=st.floats(0.02, 0.98))
def test_force_is_smooth_to_second_order_over_depth(kind: int, seed: int, knot: float) -> None:
    """Left and right of a knot two cubics agree in value, slope and curvature; in the third derivative they do not."""
    maps, grid = whole_numbers(kind, seed=seed), GRIDS[kind]
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, LARGEST_FEATURES)
    if kind == 1:  # near its ends the fine map goes over into the coarse one
        knot = 0.15 + 0.7 * knot
    at = round(knot * (grid.below + grid.above) - grid.below)
    share = np.linspace(0.05, 0.95, 9)
    sides = []
    for side in (-share, share):
        forces = [said(maps, (at + u) * grid.spacing, values=values)[1 + kind] for u in side]
        assert min(forces) > 0.0
        sides.append(np.polynomial.polynomial.polyfit(side, forces, 3))
    np.testing.assert_allclose(sides[0][:3], sides[1][:3], rtol=1e-8, atol=1e-8)
    assert sides[0][3] != pytest.approx(sides[1][3], abs=1e-6)


@given(st.floats(0.0, 8e-3))
def test_knots_on_a_line_give_that_line(place: float) -> None:
    maps = example_numbers()
    assert said(maps, max(place, 1.1e-3))[1] == pytest.approx(400.0 * max(place, 1.1e-3), rel=1e-12)


@pytest.mark.parametrize("kind", [0, 1])
def test_a_feature_counts_up_to_a_little_more_than_its_range(kind: int) -> None:
    maps = whole_numbers(kind)
    for feature in range(GRIDS[kind].features):
        for sign in (-1.0, 1.0):
            values = np.zeros((3, LARGEST_FEATURES))
            values[:, feature] = sign * np.array([0.9, 1.0, 50.0])
            within, edge, beyond = (said(maps, 0.5e-3, values=row)[1 + kind] for row in values)
            assert beyond == edge
            assert within != pytest.approx(edge, abs=1e-6)


# --- where nobody has been --------------------------------------------------------------------------------------------


def curve(function: object, *, origin: float = 0.0) -> np.ndarray:
    """A coarse map of knots on a curve over the place, visited from -4 to 8 mm."""
    maps = example_numbers((0.0, 1.0, 0.0))
    maps[0].origin = origin
    weights = maps[0].coarse.weights
    weights[:] = 0.0
    weights[: COARSE.knots] = function(  # type: ignore[operator]
        (np.arange(COARSE.knots) - COARSE.below - 1) * COARSE.spacing
    )
    return maps


CURVES = {
    "flatter than the chord": (lambda x: 2.0 + 0.0 * x, 1.0),
    "as steep as the chord and a quarter": (lambda x: 100.0 * x + 33.333 / 8e-3 * x * np.abs(x), None),
    "much steeper": (lambda x: 2e8 * np.maximum(x, 0.0) ** 4, layout.BEYOND),
}


@pytest.mark.parametrize("origin", [0.0, 2e-3])
@pytest.mark.parametrize("name", CURVES)
def test_deeper_than_ever_the_force_goes_straight_on(name: str, origin: float) -> None:
    function, bound = CURVES[name]
    maps = curve(function, origin=origin)
    reached, behind = maps[0].reached, 0.25 * COARSE.spacing
    force = said(maps, reached)[1]
    chord = force / (reached + origin)
    slope = (force - said(maps, reached - behind)[1]) / behind
    expected = slope if bound is None and origin == 0.0 else min(max(slope, chord), layout.BEYOND * chord)
    if bound is not None:
        assert expected == pytest.approx(bound * chord)
    for further in (1e-5, 1e-3, 20e-3):
        assert said(maps, reached + further)[1] == pytest.approx(force + expected * further, rel=1e-9)


def test_a_force_never_jumps_where_the_visited_ends() -> None:
    for seed in range(20):
        maps = random_numbers(seed)
        for edge in (maps[0].lowest, maps[0].reached):
            before, after = said(maps, edge - 1e-10)[1:3], said(maps, edge + 1e-10)[1:3]
            np.testing.assert_allclose(before, after, rtol=0.0, atol=1e-4)


def test_further_out_than_ever_the_force_lets_go() -> None:
    constant, steep = curve(lambda x: 2.0 + 0.0 * x), curve(lambda x: 2.0 + 1000.0 * (x + 4e-3))
    lowest = constant[0].lowest
    for share in (0.0, 0.25, 0.5, 1.0, 3.0):
        left = max(2.0 * (1.0 - share), 0.0)
        assert said(constant, lowest - share * LETTING_GO)[1] == pytest.approx(left, abs=1e-9)
        assert said(steep, lowest - share * 2e-3)[1] == pytest.approx(left, abs=1e-9)  # 1000 N/m: gone after 2 mm
    forces = said(constant, lowest - 1e-3)
    assert forces[0] == forces[1]  # the law, which knows one surface, has no say


@given(st.floats(0.0, 0.2), st.floats(-0.5, 0.5), st.floats(0.0, 1.0), st.floats(0.3, 1.5))
def test_the_law_goes_on_in_proportion(depth: float, velocity: float, alpha: float, n: float) -> None:
    maps = example_numbers((1.0, 0.0, 0.0))
    maps[0].law[:] = 3000.0, 500.0, n, alpha
    maps[0].origin, maps[0].law_surface = 1e-3, -2e-3
    known = min(depth, maps[0].law_reached - 1e-3)
    speed = float(np.clip(velocity, -layout.BEYOND * maps[0].law_speed, layout.BEYOND * maps[0].law_speed))
    law = 3000.0 * known ** (n + alpha) * (depth / known if known > 0.0 else 0.0) + 500.0 * known**n * speed
    expected = max(law, 0.0) if depth > 0.0 else 0.0
    assert said(maps, depth + 1e-3, velocity)[0] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_a_law_that_was_hardly_pressed_is_believed_a_little_further() -> None:
    maps = example_numbers((1.0, 0.0, 0.0))
    maps[0].law_reached = 1e-6
    assert said(maps, layout.PLAYS[0])[0] == pytest.approx(3000.0 * layout.PLAYS[0] ** 1.4)
    assert said(maps, 2.0 * layout.PLAYS[0])[0] == pytest.approx(2.0 * 3000.0 * layout.PLAYS[0] ** 1.4)


def test_without_a_law_its_share_gives_nothing() -> None:
    maps = example_numbers((1.0, 0.0, 0.0))
    maps[0].law[0] = 0.0
    assert said(maps, 5e-3)[0] == said(maps, 5e-3)[3] == 0.0


@given(st.integers(0, 50), st.floats(-4e-3, 8e-3), st.floats(-0.1, 0.1))
def test_the_force_is_the_experts_in_their_shares(seed: int, place: float, velocity: float) -> None:
    maps = random_numbers(seed)
    *experts, force = said(maps, place, velocity)
    assert force == pytest.approx(float(np.dot(maps[0].shares, experts)), rel=1e-12)


def test_the_uncertainty_grows_where_nobody_has_been() -> None:
    model, depths = example_map(), np.array([4e-3, 8e-3, 10e-3, 20e-3, 40e-3])
    state = (0.0,) * MEMORY
    result = np.array([advance(model, state, depth, 0.0, 1e-3)[1:] for depth in depths.tolist()])
    relative = result[:, 1] / result[:, 0]
    assert (np.diff(relative[1:]) > 0.0).all()
    assert relative[-1] > 3.0 * relative[0]


numbers = st.floats(-0.05, 0.05) | st.floats()
states = st.just(()) | st.tuples(*[numbers] * MEMORY)


@settings(max_examples=120)
@given(st.integers(0, 30), states, numbers, numbers, st.floats(0.0, 10.0) | st.floats())
def test_any_motion_of_any_map_gives_a_finite_force_that_pulls_no_more_than_it_says(
    seed: int, state: tuple[float, ...], depth: float, velocity: float, period: float
) -> None:
    maps = random_numbers(seed)
    maps["pull"] = 0.25 * (seed % 4)
    model = model_of(maps)
    after, force, deviation = advance(model, state, depth, velocity, period)
    assert math.isfinite(force)
    assert force >= -maps["pull"][0]
    assert math.isfinite(deviation)
    assert deviation >= 0.0
    assert len(after) == MEMORY


def test_a_model_runs_what_the_kernel_runs() -> None:
    maps = random_numbers(3)
    model = model_of(maps)
    memory, state = (math.nan,) * MEMORY, ()
    for depth in np.linspace(-2e-3, 12e-3, 50).tolist():
        memory, force, deviation = kernel_advance(maps, memory, depth, 0.05, 1e-3)
        state, model_force, model_deviation = advance(model, state, depth, 0.05, 1e-3)
        assert state == pytest.approx(memory, abs=1e-9)  # the origin is rounded on the wire
        assert (model_force, model_deviation) == pytest.approx((force, deviation), rel=1e-4, abs=1e-5)
    assert model.shares == pytest.approx(tuple(maps[0].shares), rel=1e-6)
    assert maps[0].uncertainty[0] > 0.0


@given(seed=st.integers(0, 99), depth=st.floats(-0.01, 0.03), velocity=st.floats(-0.3, 0.3), felt=st.floats(0.1, 10.0))
def test_no_force_within_the_visited_depth_is_far_above_the_largest_felt(
    seed: int, depth: float, velocity: float, felt: float
) -> None:
    maps = random_numbers(seed)
    maps[0].felt = felt
    depth = min(depth, maps[0].reached + maps[0].origin - 1e-6)
    force = advance(model_of(maps), (0.0,) * MEMORY, depth, velocity, 1e-3)[1]
    assert 0.0 <= force <= layout.BEYOND * felt * (1.0 + 1e-6)


def test_outside_of_where_it_was_touched_the_force_falls_to_nothing() -> None:
    maps = example_numbers((0.0, 1.0, 0.0))
    maps["lowest"], maps["touch"], maps["touch_way"], maps["touch_force"] = -4e-3, 2e-3, 1e-3, 0.1
    untouched, depths = (0.0,) * MEMORY, (2.1e-3, 1.9e-3, 1.5e-3, 0.9e-3)
    forces = [advance(model_of(maps), untouched, depth, 0.0, 1e-3)[1] for depth in depths]
    assert forces[0] > 0.5
    assert forces[1:] == pytest.approx([0.18, 0.1, 0.0], abs=1e-6)
    maps["lowest"] = 1.5e-3  # nobody has been far outside yet
    assert advance(model_of(maps), (0.0,) * MEMORY, 1.6e-3, 0.0, 1e-3)[1] > 0.3


def sticky() -> np.ndarray:
    """A map that gives -0.7 N outside of its origin, and less further in; it catches 1 mm and holds 3 mm outside."""
    maps = example_numbers((0.0, 1.0, 0.0))
    maps[0].coarse.weights[GRIDS[0].knots :] = 0.0
    maps["zero"], maps["pull"], maps["catch"], maps["hold"] = 0.7, 0.5, -1e-3, -3e-3
    return maps


def test_what_sticks_pulls_from_where_it_catches_to_where_it_lets_go() -> None:
    model, state, forces = model_of(sticky()), (), {}
    for place in (-3.5, -2.0, -0.9, -2.0, -2.9, -3.1, -2.0, 1.0, 3.0, 1.0, -2.0):
        state, force, _ = advance(model, state, 1e-3 * place, 0.0, 1e-3)
        forces.setdefault(place, []).append(force)
    assert forces[-3.5] == forces[-3.1] == [0.0]
    assert forces[-2.0] == [0.0, pytest.approx(-0.5), 0.0, pytest.approx(-0.5)]  # before it was caught, and after
    assert forces[-0.9] == forces[-2.9] == [pytest.approx(-0.5)]  # no more than was felt
    assert forces[1.0] == pytest.approx([-0.3, -0.3], abs=1e-6)
    assert forces[3.0] == pytest.approx([0.5], abs=1e-6)


@given(places)
def test_whether_it_sticks_is_known_by_where_it_was(depth: list[float]) -> None:
    maps, memory, sticks = sticky(), np.full(MEMORY, math.nan), False
    for place in depth:
        run(maps, memory, np.array([place]), np.array([1e-3]))
        sticks = place >= -1e-3 or (sticks and place >= -3e-3)
        assert memory[-1] == float(sticks)


def test_further_out_than_it_was_learnt_a_pull_fades() -> None:
    maps = sticky()
    maps["lowest"], maps["hold"], maps["catch"] = -1e-3, -1.0, -1.0
    untouched, depths = (0.0,) * MEMORY, (-1e-3, -3.5e-3, -6e-3, -9e-3)
    forces = [advance(model_of(maps), untouched, depth, 0.0, 1e-3)[1] for depth in depths]
    assert forces == pytest.approx([-0.5, -0.25, 0.0, 0.0], abs=1e-6)

"""Learning a contact map: least squares as in a batch, shares, what may not matter, and what may come in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from dense_regression import new_regression, whole_covariance
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from presses import press
from scipy.interpolate import BSpline

from foretouch.errors import SettingError
from foretouch.identification import ContactSample, ContactSamples, Learner, Status, make_estimator, predict
from foretouch.identification.contact_map.bank import EXPERT_NAMES, ContactMap
from foretouch.identification.contact_map.kernel import LARGEST_SHIFT
from foretouch.identification.contact_map.learning import PERIOD
from foretouch.identification.contact_map.prior import (
    FEATURE_REACH,
    LEVEL,
    SIZE,
    prior,
)
from foretouch.identification.contact_map.regression import fit
from foretouch.models import ContactMapModel, HuntCrossley, advance
from foretouch.models.contact_map.layout import COARSENESS, FINE, GRIDS, LARGEST_FEATURES, PLAYS, SPEED, TIMES
from foretouch.quantities import Recording

Array = NDArray[np.float64]


def recorded(samples: Sequence[ContactSample], estimator: ContactMap) -> ContactMap:
    for sample in samples:
        estimator.update(sample)
    return estimator


def taps(duration: float, *, seed: int = 0, rate: float = 250.0) -> Iterator[ContactSample]:
    """Taps of random depth and length on a material that changes every minute, conditioned."""
    random = np.random.default_rng(seed)
    time, begun, length, depth, stiffness = 0.0, 0.0, 0.3, 3e-3, 1000.0
    while time < duration:
        if time - begun > length:
            begun, length, depth = time, random.uniform(0.05, 1.0), random.choice([1e-4, 1e-3, 8e-3])
            depth *= random.uniform(0.5, 1.5)
        if int(time / 60.0) != int((time - 1.0 / rate) / 60.0):
            stiffness = 10.0 ** random.uniform(2.0, 4.5)
        phase = 2.0 * math.pi * (time - begun) / length
        x, v = depth * (math.sin(phase) - 0.2), depth * math.cos(phase) * 2.0 * math.pi / length
        force = max(stiffness * max(x, 0.0) ** 1.2 * (1.0 + 0.5 * v), 0.0) + random.normal(0.0, 0.02)
        yield ContactSample(time, x, v, force, x > 0.0)
        time += 1.0 / rate


# --- least squares ----------------------------------------------------------------------------------------------------


def regressors(kind: int, places: Array, values: Array) -> Array:
    """Rows of the least-squares problem, from an independent implementation of B-splines."""

    def splines(spacing: float, below: int, above: int) -> Array:
        ends = (np.arange(below + above + 7) - below - 3) * spacing
        return np.asarray(BSpline.design_matrix(places, ends, 3).todense())

    spacing, below, above, features, *_ = GRIDS[kind]
    slow = splines(COARSENESS * spacing, -(-below // COARSENESS), -(-above // COARSENESS))
    parts = [splines(spacing, below, above)]
    return np.hstack(parts + [values[:, [f]] * slow for f in range(features)])


def batch(rows: Array, forces: Array, covariance: Array) -> tuple[Array, Array]:
    """Weights and their covariance by regularised least squares on all samples at once."""
    gain = np.linalg.solve(rows @ covariance @ rows.T + np.eye(forces.size), rows @ covariance).T
    return gain @ forces, covariance - gain @ rows @ covariance


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_recursive_least_squares_is_the_batch_solution(kind: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    grid = GRIDS[kind]
    places = random.uniform(-grid.below * grid.spacing, grid.above * grid.spacing, 300)
    values = random.normal(0.0, 1.0, (300, LARGEST_FEATURES))
    forces = random.normal(0.0, 3.0, 300)
    learnt, state = np.zeros(GRIDS[kind].size), new_regression(kind)
    for place, row, force in zip(places.tolist(), values, forces.tolist(), strict=True):
        fit(learnt, state[0], grid, place, row, force)
    weights, rest = batch(regressors(kind, places, values), forces, prior(kind))
    learnt, covariance = whole_covariance(kind, learnt, state)
    np.testing.assert_allclose(learnt, weights, rtol=1e-7, atol=1e-7 * np.abs(weights).max())
    np.testing.assert_allclose(covariance, rest, rtol=0.0, atol=1e-9 * np.abs(rest).max())


def test_a_sample_beyond_the_fine_map_leaves_it_alone() -> None:
    weights, state = np.zeros(FINE.size), new_regression(1)
    assert fit(weights, state[0], FINE, 5e-3, np.zeros(LARGEST_FEATURES), 3.0) == math.inf
    assert not weights.any()
    np.testing.assert_array_equal(whole_covariance(1, weights, state)[1], prior(1))


def test_the_prior_is_a_doubly_integrated_noise_and_a_smooth_process() -> None:
    """Cov(g(s), g(t)) = level + slope s t + curvature * integral of (s - u)(t - u) up to the nearer, one side each."""
    for kind in (0, 1):
        result, knots = prior(kind), GRIDS[kind].knots
        for s, t in ((3.0, 7.0), (5.0, 5.0), (-2.0, -6.0), (-3.0, 4.0), (0.0, 8.0)):
            expected = LEVEL**2 + SIZE**2 * s * t
            if s * t > 0.0:
                u = (np.arange(20_000) + 0.5) / 20_000 * min(abs(s), abs(t))
                expected += SIZE**2 * float(np.mean((abs(s) - u) * (abs(t) - u))) * min(abs(s), abs(t))
            row, column = (int(place) + GRIDS[kind].below + 1 for place in (s, t))
            assert result[row, column] == pytest.approx(expected, rel=1e-6)
        apart = result[knots, knots + 2]
        distance = 2.0 * COARSENESS / FEATURE_REACH
        assert apart == pytest.approx(SIZE**2 * math.exp(-0.5 * distance**2), rel=1e-6)
        assert not result[:knots, knots:].any()
        assert np.linalg.eigvalsh(result)[0] > 0.0


def history(time: Array, depth: Array) -> Array:
    """Plays, averages and whether it is inside, after each sample; written out from the definitions."""
    result = np.zeros((time.size, len(PLAYS) + len(TIMES) + 1))
    plays, averages = np.full(len(PLAYS), depth[0]), np.full(len(TIMES), max(depth[0], 0.0))
    for index, place in enumerate(depth):
        plays = np.clip(plays, place - np.array(PLAYS), place + np.array(PLAYS))
        if index:
            kept = np.exp(-(time[index] - time[index - 1]) / np.array(TIMES))
            averages = kept * averages + (1.0 - kept) * max(place, 0.0)
        result[index] = [*plays, *averages, float(place >= 0.0)]
    return result


def test_the_coarse_map_alone_is_a_least_squares_fit_of_what_was_felt() -> None:
    """The whole estimator against a fit of all samples at once, with features computed independently."""
    random = np.random.default_rng(1)
    time = PERIOD * np.arange(220)
    depth = 5e-3 * np.sin(9.0 * time) + 2e-3 * np.sin(31.0 * time) + 4e-3
    velocity = np.gradient(depth, time)
    memory = history(time, depth)
    force = 900.0 * np.maximum(depth, 0.0) + 20.0 * velocity + random.normal(0.0, 0.1, time.size)
    rows = zip(time.tolist(), depth.tolist(), velocity.tolist(), force.tolist(), strict=True)
    bank = recorded([ContactSample(*row, True) for row in rows], ContactMap(experts=("coarse",)))

    values = np.column_stack(
        [velocity / SPEED]
        + [(depth - memory[:, k]) / radius for k, radius in enumerate(PLAYS)]
        + [(np.maximum(depth, 0.0) - memory[:, len(PLAYS) + k]) / (2.0 * GRIDS[0].spacing) for k in range(len(TIMES))]
    )
    design = regressors(0, depth, values)
    weights, _ = batch(design, force, prior(0))
    expected = np.maximum(design @ weights, 0.0)
    model = bank.model
    assert isinstance(model, ContactMapModel)
    assert bank.state == pytest.approx(tuple(memory[-1]), abs=1e-15)
    result = [advance(model, tuple(memory[k - 1]), depth[k], velocity[k], PERIOD)[1] for k in range(1, time.size)]
    np.testing.assert_allclose(result, expected[1:], rtol=1e-4, atol=1e-4)
    assert np.sqrt(np.mean((expected - force) ** 2)) < 0.1 * np.sqrt(np.mean(force**2))
    assert bank.changes == 0


# --- shares -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "experts", [EXPERT_NAMES, ("law",), ("coarse",), ("fine",), ("law", "fine"), ("fine", "coarse")]
)
def test_shares_are_of_those_that_are_asked_and_sum_to_one(experts: tuple[str, ...]) -> None:
    bank, seen = ContactMap(experts=experts), []
    for sample in taps(3.0, rate=500.0):
        bank.update(sample)
        model = bank.model
        if isinstance(model, ContactMapModel):
            assert sum(model.shares) == pytest.approx(1.0, abs=1e-6)
            seen.append(dict(zip(EXPERT_NAMES, bank.states["map"][0, 0]["shares"].tolist(), strict=True)))
    assert len(seen) > 1000
    for shares in seen:
        assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)
        assert min(shares.values()) >= 0.0
        assert all(share == 0.0 for name, share in shares.items() if name not in experts and experts != ("law",))
    assert all(seen[-1][name] == 0.0 for name in EXPERT_NAMES if name not in experts)


@pytest.mark.parametrize(("experts", "said"), [((), ""), (("law", "best"), "law, best")])
def test_experts_must_be_known(experts: tuple[str, ...], said: str) -> None:
    with pytest.raises(SettingError, match=rf"experts = '{said}': must be some of law, coarse, fine"):
        ContactMap(experts=experts)


def test_a_horizon_below_zero_is_refused() -> None:
    with pytest.raises(SettingError, match=r"horizon = -0\.1: must lie between 0 and 2"):
        ContactMap(horizon=-0.1)


# --- what may not matter ----------------------------------------------------------------------------------------------


def predicted(recording: Recording, **given_values: float) -> Array:
    return predict(recording, Learner(make_estimator("contact-map", "bank"), **given_values), delay=0.3).force


def test_the_unit_of_force_does_not_matter() -> None:
    law = HuntCrossley(3000.0, 300.0, 1.4)
    one = press(law, duration=5.0, noise=0.02)
    ten = Recording(one.time, one.position, 10.0 * one.force)
    small, large = predicted(one, contact_floor=0.05), predicted(ten, contact_floor=0.5)
    assert np.sqrt(np.mean((large - 10.0 * small) ** 2)) < 1e-3 * np.sqrt(np.mean(large**2))
    assert small.max() > 2.0


def test_where_the_origin_of_positions_is_does_not_matter() -> None:
    here = press(duration=5.0, noise=0.02)
    there = Recording(here.time, here.position - 0.37, here.force)
    near, far = predicted(here), predicted(there)
    assert np.sqrt(np.mean((near - far) ** 2)) < 1e-4 * np.sqrt(np.mean(near**2))


def learnt_on_taps(experts: tuple[str, ...]) -> ContactMap:
    return recorded(list(taps(4.0, rate=500.0)), ContactMap(experts=experts))


def forces_at(bank: ContactMap, positions: Array, surface: float) -> Array:
    model = bank.model
    assert isinstance(model, ContactMapModel)
    return np.array([advance(model, bank.state, place - surface, 0.02, 1e-3)[1] for place in positions.tolist()])


@pytest.mark.parametrize("experts", [("coarse",), ("law",), EXPERT_NAMES])
@pytest.mark.parametrize("change", [0.4e-3, -0.4e-3])
def test_a_surface_that_moves_moves_no_force(experts: tuple[str, ...], change: float) -> None:
    bank, positions = learnt_on_taps(experts), np.linspace(-2e-3, 12e-3, 60)
    before = forces_at(bank, positions, 0.0)
    bank.move_surface(change)
    np.testing.assert_allclose(forces_at(bank, positions, change), before, rtol=1e-4, atol=1e-4)
    assert before.max() > 1.0


def test_an_offset_that_moves_moves_every_force_by_as_much() -> None:
    bank, positions = learnt_on_taps(("coarse",)), np.linspace(1e-3, 7e-3, 60)
    before = forces_at(bank, positions, 0.0)
    bank.move_offset(0.2)
    np.testing.assert_allclose(forces_at(bank, positions, 0.0), np.maximum(before - 0.2, 0.0), rtol=1e-4, atol=1e-4)


def test_a_surface_somewhere_else_begins_a_new_map() -> None:
    bank = learnt_on_taps(EXPERT_NAMES)
    assert bank.model is not None
    bank.move_surface(1.1 * LARGEST_SHIFT)
    assert bank.model is None


def test_reset_forgets_everything() -> None:
    bank = learnt_on_taps(EXPERT_NAMES)
    bank.reset()
    assert bank.model is None
    assert bank.updates == 0
    assert all(math.isnan(value) for value in bank.state)
    again, fresh = (recorded(list(taps(2.0)), each) for each in (bank, ContactMap()))
    assert again.model == fresh.model
    assert again.state == fresh.state


# --- what may come in -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("minutes", [3, pytest.param(10, marks=pytest.mark.long)])
def test_minutes_of_taps_leave_the_covariance_one(minutes: int) -> None:
    """Symmetric, positive and bounded by the prior, though no step enforces it."""
    bank = ContactMap()
    statuses = {bank.update(sample) for sample in taps(60.0 * minutes)}
    assert Status.RESTARTED not in statuses
    assert bank.updates > 14_000 * minutes
    model = bank.model
    assert isinstance(model, ContactMapModel)
    assert np.isfinite(model._maps.view(np.float64)).all()
    for kind, name in enumerate(("coarse", "fine")):
        _, covariance = whole_covariance(kind, model._maps[0][name].weights, bank.states[name])
        scale = np.sqrt(np.diag(prior(kind)))
        relative = covariance / np.outer(scale, scale)
        assert np.abs(relative - relative.T).max() < 1e-9
        assert np.linalg.eigvalsh(relative)[0] > 0.0
        assert np.diag(relative).max() < 1.0 + 1e-9


BAD = st.sampled_from([math.nan, math.inf, -math.inf])
times = st.floats(1e-4, 0.1) | st.sampled_from([0.0, -1.0, math.nan, math.inf])
raw = st.tuples(times, st.floats(-0.1, 0.1) | BAD, st.floats(-100.0, 100.0) | BAD)


@settings(max_examples=25)
@given(st.lists(raw, min_size=1, max_size=60), st.integers(0, 2500))
def test_bad_samples_raise_nothing_and_the_force_stays_one(bad: list[tuple[float, ...]], good: int) -> None:
    learner = Learner(make_estimator("contact-map", "bank"))
    recording = press(duration=2.5)
    columns = (recording.time[:good].tolist(), recording.position[:good].tolist(), recording.force[:good].tolist())
    for row in zip(*columns, strict=True):
        learner.update(*row)
    now = good * 1e-3
    for step, position, force in bad:
        learner.update(now + step, position, force)
        now += step if 0.0 < step < 1.0 else 0.0
        learnt = learner.learnt()
        if learnt.model is not None:
            state, force, deviation = advance(learnt.model, learnt.state, 3e-3, 0.1, 1e-3)
            assert 0.0 <= force < math.inf
            assert 0.0 <= deviation < math.inf
            assert all(map(math.isfinite, state))


large = st.floats(-1e30, 1e30) | st.floats(-1e-2, 1e-2) | BAD


@settings(max_examples=40)
@given(st.lists(st.tuples(large, large, large, large, st.booleans()), max_size=20), st.booleans())
def test_no_sample_whatever_raises(bad: list[tuple[float, float, float, float, bool]], begun: bool) -> None:
    bank = recorded(list(taps(0.5)) if begun else [], ContactMap())
    for sample in bad:
        assert bank.update(ContactSample(*sample)) in Status
        model = bank.model
        assert model is None or math.isfinite(advance(model, bank.state, 2e-3, 0.0, 1e-3)[1])
    bank.move_surface(math.nan)
    bank.move_offset(math.inf)
    assert set(bank.parameters) >= {"stiffness", "damping"} or not bank.parameters


@pytest.mark.parametrize(
    ("field", "number"),
    [
        ("depth", 1.0),
        ("depth", -1e3),
        ("depth", 1e10),
        ("velocity", 1e10),
        ("velocity", 1e300),
        ("force", 100.0),
        ("force", 1e300),
    ],
)
def test_one_absurd_sample_does_not_end_learning(field: str, number: float) -> None:
    samples = list(taps(6.0))
    without = recorded(samples, ContactMap())
    samples[500] = samples[500]._replace(**{field: number})
    bank, positions = recorded(samples, ContactMap()), np.linspace(0.0, 4e-3, 20)
    result, expected = forces_at(bank, positions, 0.0), forces_at(without, positions, 0.0)
    np.testing.assert_allclose(result, expected, rtol=0.0, atol=0.1 * expected.max())


def test_contact_without_a_force_is_no_failure() -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    depth = -0.002 + 0.004 * np.clip(time - 1.5, 0.0, 1.0)
    samples = ContactSamples(time, depth, np.gradient(depth, time), 500.0 * np.maximum(depth, 0.0))
    estimator = ContactMap()
    assert tuple(Status).index(Status.RESTARTED) not in estimator.run(samples)
    assert estimator.model is not None


def test_a_sample_of_nonsense_is_said_to_be_one() -> None:
    bank = learnt_on_taps(EXPERT_NAMES)
    before = bank.updates
    assert bank.update(ContactSample(9.0, 1e-3, 0.0, math.nan, True)) is Status.UNUSABLE
    assert bank.update(ContactSample(9.0, math.nan, 0.0, 0.0, False)) is Status.FREE_AIR
    assert bank.update(ContactSample(1.0, 1e-3, 0.0, 1.0, True)) is Status.UNUSABLE
    assert bank.updates == before

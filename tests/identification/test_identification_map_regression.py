"""Least squares in the weights that were reached, against the same in all weights; and what a sample costs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from dense_regression import DenseRegression, new_regression, whole_covariance
from exact_samples import feed, samples
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.identification import (
    ContactMap,
    ContactSample,
    ContactSamples,
    Estimator,
    ExactContinuousSwitching,
    Status,
)
from foretouch.identification.contact_map.regression import fade, fit
from foretouch.identification.exact.belief import law_numbers
from foretouch.models import ContactMapModel
from foretouch.models.contact_map.layout import COARSE, FINE, GRIDS, LARGEST_FEATURES

Array = NDArray[np.float64]


def compared(kind: int, places: list[float], seed: int = 0, *, fading: bool = False) -> tuple[float, float, float]:
    """Largest differences of errors, weights and covariance from the dense form, in their own sizes."""
    random = np.random.default_rng(seed)
    dense, states = DenseRegression(kind), new_regression(kind)
    weights = np.zeros(dense.weights.size)
    apart, size = 0.0, 1e-300
    for index, place in enumerate(places):
        values, force = random.normal(0.0, 1.0, LARGEST_FEATURES), 900.0 * max(place, 0.0) + random.normal(0.0, 0.5)
        error = fit(weights, states[0], GRIDS[kind], place, values, force)
        expected = dense.fit(place, values, force)
        if np.isfinite(expected):
            apart, size = max(apart, abs(error - expected)), max(size, abs(force))
        if fading and index % 40 == 0:
            fade(states[0], 0.01)
            dense.fade(0.01)
    everywhere, covariance = whole_covariance(kind, weights, states)
    return (
        apart / size,
        float(np.abs(everywhere - dense.weights).max() / max(np.abs(dense.weights).max(), 1e-300)),
        float(np.abs(covariance - dense.covariance).max() / np.abs(dense.covariance).max()),
    )


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("fading", [False, True])
def test_it_is_the_dense_form_to_nine_digits(kind: int, fading: bool) -> None:
    scale = 1.0 if kind == 0 else 0.1
    phase = 0.02 * np.arange(600)
    places = scale * (6e-3 * np.sin(phase) + 3e-3 * np.sin(0.37 * phase) + 4e-3 * phase / phase[-1])
    errors, weights, covariance = compared(kind, places.tolist(), fading=fading)
    assert errors < 1e-9
    assert weights < 1e-9
    assert covariance < 1e-9


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-0.02, 0.06), min_size=1, max_size=40), st.integers(0, 99))
def test_places_may_come_in_any_order(places: list[float], seed: int) -> None:
    """Far jumps reach many knots at once, inwards and outwards, and beyond the last knots."""
    assert max(compared(0, places, seed)) < 1e-8


def test_only_what_was_visited_is_computed_with() -> None:
    """Rows of the covariance: four knots around each place visited, of the elastic part and of every feature."""
    states, weights = new_regression(0), np.zeros(COARSE.size)
    for place in np.linspace(0.5e-3, 9.5e-3, 40):
        fit(weights, states[0], COARSE, float(place), np.ones(LARGEST_FEATURES), 1.0)
    elastic, feature = 9 + 4, 3 + 4
    assert states[0].rows == elastic + LARGEST_FEATURES * feature
    assert states[0].rows < 0.4 * weights.size
    before = int(states[0].rows)
    for place in np.linspace(0.5e-3, 9.5e-3, 40):
        fit(weights, states[0], COARSE, float(place), np.ones(LARGEST_FEATURES), 1.0)
    assert states[0].rows == before


def test_the_fine_map_is_reached_in_full_at_once() -> None:
    states = new_regression(1)
    assert states[0].rows == FINE.size
    assert fit(np.zeros(FINE.size), states[0], FINE, -1.01 * FINE.below * FINE.spacing, np.zeros(6), 1.0) == np.inf


# --- one call a sample, and a recording at once -----------------------------------------------------------------------


def pressed(size: int = 13000) -> list[ContactSample]:
    """Presses in and out of contact, one sample lost, one of nonsense, and a material that becomes another one."""
    time = 1e-3 * np.arange(size)
    depth = 7e-3 * np.sin(9.0 * time) + 2e-3 * np.sin(4.1 * time)
    velocity = np.gradient(depth, time)
    stiffness = np.where(time < 10.5, 800.0, 9000.0)
    force = np.maximum(stiffness * np.maximum(depth, 0.0) ** 1.1 * (1.0 + velocity), 0.0)
    force += np.random.default_rng(3).normal(0.0, 0.02, size)
    rows = zip(time.tolist(), depth.tolist(), velocity.tolist(), force.tolist(), (depth > 0.0).tolist(), strict=True)
    result = [ContactSample(*row) for row in rows]
    result[1000] = result[1000]._replace(force=np.nan)
    result[1500] = result[1499]
    return result


def columns(data: list[ContactSample]) -> ContactSamples:
    return ContactSamples(*zip(*data, strict=True))


def same_state(one: ExactContinuousSwitching | ContactMap, other: ExactContinuousSwitching | ContactMap) -> bool:
    states = (each.states if isinstance(each, ContactMap) else each._filters for each in (one, other))
    return len({state.tobytes() for state in states}) == 1


@pytest.mark.parametrize("make", [ExactContinuousSwitching, ContactMap])
def test_a_recording_at_once_is_the_same_bit_for_bit(make: type[ExactContinuousSwitching] | type[ContactMap]) -> None:
    data, one, whole = pressed(), make(), make()
    statuses = [one.update(sample) for sample in data]
    half = len(data) // 2
    codes = np.concatenate([whole.run(columns(part)) for part in (data[:half], data[half:])])
    assert [list(Status)[code] for code in codes.tolist()] == statuses
    assert Status.CHANGED in statuses
    assert same_state(one, whole)
    assert (one.updates, one.changes, one.parameters) == (whole.updates, whole.changes, whole.parameters)
    assert one.model == whole.model


@pytest.mark.parametrize("make", [ExactContinuousSwitching, ContactMap])
def test_columns_must_be_of_one_length(make: type[ExactContinuousSwitching] | type[ContactMap]) -> None:
    time, depth, velocity, force, contact = columns(pressed()).columns
    with pytest.raises(InputError, match="must be columns of one length"):
        make().run(ContactSamples(time, depth, velocity, force[:-1], contact))


def test_the_law_in_the_map_is_that_of_the_exact_estimator() -> None:
    bank, alone = ContactMap(), ExactContinuousSwitching()
    feed(bank, samples(noise=0.02, duration=1.0))
    law, model = bank._law.model, bank.model
    assert law is not None
    assert isinstance(model, ContactMapModel)
    feed(alone, samples(noise=0.02, duration=1.0))
    numbers = np.zeros(4)
    assert law_numbers(alone._belief, numbers)
    assert alone.model is not None
    np.testing.assert_allclose(numbers, alone.model.parameters, rtol=1e-15)
    assert np.shares_memory(bank._law._filters, bank.states)
    assert not law_numbers(ExactContinuousSwitching()._belief, numbers)


@pytest.mark.parametrize("make", [ExactContinuousSwitching, ContactMap])
def test_nothing_grows_with_the_samples(make: type[Estimator]) -> None:
    data, estimator = pressed(), make()
    feed(estimator, data[:2000])
    tracemalloc.start()
    try:
        feed(estimator, data[2000:3000])
        before = tracemalloc.get_traced_memory()[0]
        feed(estimator, data[3000:])
        assert tracemalloc.get_traced_memory()[0] - before < 2000
    finally:
        tracemalloc.stop()


INTERPRETED = """
import json, sys
sys.path.insert(0, {folder!r})
from exact_samples import samples, feed
from foretouch.identification import ContactMap
bank = ContactMap()
feed(bank, samples(noise=0.02, duration=0.3))
print(json.dumps([bank._state.map.view('f8').tolist(), bank.updates]))
"""


def test_compiled_and_interpreted_are_equal() -> None:
    """To nine digits of the largest weight: LLVM and Python may round a power or an exponential differently."""
    bank = ContactMap()
    feed(bank, samples(noise=0.02, duration=0.3))
    script = INTERPRETED.format(folder=os.path.dirname(__file__))
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True, timeout=120
    )
    flat, updates = json.loads(done.stdout)
    expected = bank._state.map.view(np.float64)
    assert updates == bank.updates
    np.testing.assert_allclose(flat, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())

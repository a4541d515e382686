"""What a loop asks of a model: the compiled forms are those of the interface, to the last bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from example_maps import example_map, model_of, random_numbers
from hypothesis import given
from hypothesis import strategies as st
from numba import config

from foretouch.core.compiling import interpreted
from foretouch.models import (
    ContactMapModel,
    ContactModel,
    ContinuousSwitching,
    HuntCrossley,
    KelvinVoigt,
    LinearisedContinuousSwitching,
    Predictor,
    ThresholdSwitching,
)
from foretouch.models.contact_map.kernel import advance, leaving_work, local_slopes
from foretouch.models.contact_map.layout import MEMORY
from foretouch.models.contact_model import EXIT_SPEED, SLICE_BEYOND, SLICES, SLICES_BEYOND

LAWS = [
    KelvinVoigt(500.0, 10.0),
    HuntCrossley(9000.0, 800.0, 1.4),
    ContinuousSwitching(5000.0, 300.0, 0.9, 0.4),
    ThresholdSwitching(900.0, 5.0, 9000.0, 800.0, 1.4, 600.0),
    LinearisedContinuousSwitching(9.0, 1.3, 0.4, 0.0),
]

depths = st.floats(-0.02, 0.05) | st.sampled_from((-1.0, 0.0, 1e-300, 1.0))
offsets = st.floats(-5.0, 5.0) | st.just(0.0)
limits = st.floats(0.1, 20.0) | st.just(math.inf)
states = st.lists(st.floats(-5e-3, 10e-3), min_size=MEMORY, max_size=MEMORY).map(tuple)


def a_map(seed: int) -> ContactMapModel:
    return model_of(random_numbers(seed))


@given(st.sampled_from(LAWS), depths, st.floats(-0.3, 0.3), offsets, limits)
def test_a_compiled_law_is_that_of_the_interface(
    law: ContactModel, depth: float, velocity: float, offset: float, largest: float
) -> None:
    predictor, reach = Predictor(), 1e-4
    predictor.adopt(law, 0.0)
    predictor.update(0.0, depth)
    force = predictor.update(1e-3, depth, velocity)
    assert force == law.advance((), depth, velocity, 1e-3)[1]
    assert predictor.leaving_work(offset, largest) == law.leaving_work((), depth, offset, largest)
    asked = depth if depth >= 0.0 or force > 0.0 else 0.0
    assert predictor.local_slopes(reach) == law.local_slopes((), asked, velocity, reach)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.law)
def test_the_leaving_work_of_gives_back_what_is_stored(law: ContactModel) -> None:
    depth = 8e-3
    places = np.linspace(0.0, depth, 20001)
    stored = np.trapezoid([law.advance((), x, 0.0, 1e-3)[1] for x in places.tolist()], places)
    work, way = law.leaving_work((), depth)
    assert work == pytest.approx(stored, rel=5e-3)
    assert way == pytest.approx(depth + 2.5e-4 * (way > depth + 1e-4), rel=1e-9)


def leaving_work_of_by_steps(
    model: ContactMapModel, state: tuple[float, ...], depth: float, offset: float, largest: float
):
    """`ContactModel.leaving_work` in steps of the model; at first no time passes."""

    def felt(force: float) -> float:
        return max(min(force, largest) + offset, 0.0)

    before = felt(model.advance(state, depth, 0.0, 1e-300)[1])
    energy = way = 0.0
    for count, length in ((SLICES, max(depth, 0.0) / SLICES), (SLICES_BEYOND, SLICE_BEYOND)):
        for _ in range(count if length > 0.0 else 0):
            if count == SLICES_BEYOND and not before > 0.0:
                break
            depth -= length
            state, force, _ = model.advance(state, depth, 0.0, length / EXIT_SPEED)
            energy += 0.5 * (before + felt(force)) * length
            way += length
            before = felt(force)
    return energy, way


@given(st.integers(0, 20), states, st.floats(-5e-3, 0.03), st.floats(-2.0, 5.0), limits)
def test_the_leaving_work_of_of_a_map_is_one_of_its_steps(
    seed: int, state: tuple[float, ...], depth: float, offset: float, largest: float
) -> None:
    model = a_map(seed)
    state = model.advance(state, depth, 0.0, 1e-3)[0]  # one that belongs to this depth
    work, way = model.leaving_work(state, depth, offset, largest)
    by_steps = leaving_work_of_by_steps(model, state, depth, offset, largest)
    assert work == pytest.approx(by_steps[0], rel=1e-6, abs=1e-12)
    if work > 1e-9:
        assert way == pytest.approx(by_steps[1], abs=1e-9)


KINDS = (float, np.float64) if config.DISABLE_JIT else (float,)
"""What a call gives: compiled code gives Python's own numbers, interpreted code also those of an array."""


@pytest.mark.parametrize("call", [advance, local_slopes, leaving_work], ids=lambda call: call.__name__)
@pytest.mark.parametrize("at", range(MEMORY))
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_memory_with_a_number_that_is_none_is_none(call, at, bad) -> None:
    model, state = example_map(), [1e-3, 2e-3, 1e-3, 1e-3, 1e-3, 1.0]
    state[at] = bad
    arguments = 4e-3, 0.05, 1e-3
    result = call(model._maps, tuple(state), *arguments)
    assert repr(result) == repr(call(model._maps, (math.nan,) * MEMORY, *arguments))
    assert all(type(number) in KINDS and math.isfinite(number) for number in result[-2:])


@pytest.mark.parametrize("state", [(), (1e-3,), (1e-3,) * (MEMORY + 1)])
def test_a_memory_of_another_length_is_none(state: tuple[float, ...]) -> None:
    model, untouched = example_map(), (math.nan,) * MEMORY
    for name, arguments in (
        ("advance", (4e-3, 0.05, 1e-3)),
        ("local_slopes", (4e-3, 0.05, 1e-4)),
        ("leaving_work", (4e-3, 0.5, 10.0)),
    ):
        assert repr(getattr(model, name)(state, *arguments)) == repr(getattr(model, name)(untouched, *arguments))


@given(st.integers(0, 20), states, depths, st.floats(-0.5, 0.5))
def test_interpreted_calls_give_the_same(seed: int, state: tuple[float, ...], depth: float, velocity: float) -> None:
    maps = a_map(seed)._maps
    for call, arguments in (
        (advance, (depth, velocity, 1e-3)),
        (local_slopes, (depth, velocity, 1e-4)),
        (leaving_work, (depth, 0.1, 10.0)),
    ):
        plain = interpreted(call)
        compiled, expected = call(maps, state, *arguments), plain(maps, state, *arguments)
        np.testing.assert_allclose(np.hstack(compiled), np.hstack(expected), rtol=1e-12, atol=1e-15)

"""A contact map as bytes: nothing is lost that a force is computed from, and nothing else is taken for a map."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from example_maps import PARAMETERS, example_map, model_of, random_numbers
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from foretouch.errors import SettingError
from foretouch.messages import VERSION, ModelUpdate, decode, encode
from foretouch.models import ContactMapModel, HuntCrossley, advance, make_model
from foretouch.models.contact_map.kernel import advance as kernel_advance
from foretouch.models.contact_map.layout import COARSE, HEADER, MEMORY, SIZE, Map
from foretouch.models.contact_map.wire import shrunk, unpack
from foretouch.recordings.formats.cdr import Layout

INDEX = {name: offset // 8 for name, (_, offset) in Map.layout.fields.items()}  # type: ignore[union-attr]


def forces(maps: np.ndarray, depths: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Force and standard deviation along a motion, shape (n, 2)."""
    memory, result = (math.nan,) * MEMORY, []
    for depth, velocity in zip(depths.tolist(), velocities.tolist(), strict=True):
        memory, *after = kernel_advance(maps, memory, depth, velocity, 2e-3)
        result.append(after)
    return np.array(result)


@given(st.integers(0, 10_000), st.booleans())
def test_bytes_give_the_same_forces_to_32_bits(seed: int, fine: bool) -> None:
    """Within what was visited to a few units of rounding; far outside a slope is that of a difference."""
    maps = random_numbers(seed, fine=fine)
    read = model_of(maps)._maps
    random = np.random.default_rng(seed)
    low, high = maps[0].lowest + maps[0].origin, maps[0].reached + maps[0].origin
    velocities = random.uniform(-0.3, 0.3, 200)
    inside = random.uniform(low + 1e-8, high - 1e-8, 200)
    scale = forces(maps, inside, velocities).max()
    for depths, tolerance in ((inside, 1e-5), (random.uniform(low - 20e-3, high + 20e-3, 200), 2e-3)):
        expected = forces(maps, depths, velocities)
        np.testing.assert_allclose(forces(read, depths, velocities), expected, rtol=tolerance, atol=tolerance * scale)


@given(st.integers(0, 10_000), st.booleans())
def test_packing_what_was_unpacked_gives_the_same_bytes(seed: int, fine: bool) -> None:
    content = shrunk(random_numbers(seed, fine=fine))[0]
    read = unpack(content)
    assert read is not None
    assert shrunk(read)[0] == content
    made = ContactMapModel.of(random_numbers(seed, fine=fine))
    assert made is not None
    again = ContactMapModel(*made.parameters, made.map)
    assert made == again
    assert made._maps.tobytes() == again._maps.tobytes()


def test_a_fine_map_without_a_share_stays_at_home() -> None:
    with_it, without = random_numbers(1), random_numbers(1, fine=False)
    assert len(shrunk(without)[0]) < len(shrunk(with_it)[0]) - 4 * 50
    assert not np.array_equal(without[0].shares, with_it[0].shares)


def test_only_what_was_visited_crosses() -> None:
    """Elastic part and six features, four splines each around one place; then one more for each interval."""
    maps = random_numbers(2, fine=False)
    maps[0].lowest = maps[0].reached = 0.1e-3
    narrow = len(shrunk(maps)[0])
    assert narrow == 4 * (HEADER + 2 * 6 + 4 + 6 * 4)
    maps[0].reached = 3.1e-3
    assert len(shrunk(maps)[0]) == narrow + 4 * (3 + 6)


def test_the_largest_map_fits_a_message() -> None:
    maps = random_numbers(3)
    maps[0].lowest, maps[0].reached = -COARSE.below * COARSE.spacing, COARSE.above * COARSE.spacing
    assert len(shrunk(maps)[0]) == 4 * SIZE <= 4096  # what `ModelUpdate.map` may hold


# --- what is no map ---------------------------------------------------------------------------------------------------

GOOD = [shrunk(random_numbers(seed, fine=bool(seed % 2)))[0] for seed in range(6)]
BAD = st.sampled_from([math.nan, math.inf, -math.inf])


def with_number(content: bytes, index: int, number: float) -> bytes:
    return content[: 4 * index] + struct.pack("<f", number) + content[4 * index + 4 :]


def refused(content: bytes) -> None:
    with pytest.raises(SettingError) as caught:
        ContactMapModel(*PARAMETERS, content)
    assert str(caught.value) == f"map = '{len(content)} bytes': is no contact map"


@settings(max_examples=50)
@given(st.sampled_from(GOOD), st.integers(0, 4 * SIZE))
@example(GOOD[0], 0)
@example(GOOD[1], 4)
def test_a_part_of_a_map_is_refused(content: bytes, length: int) -> None:
    assume(length < len(content))
    refused(content[:length])


@settings(max_examples=50)
@given(st.sampled_from(GOOD), st.binary(min_size=1, max_size=400) | st.integers(1, 400).map(lambda n: bytes(4 * n)))
def test_more_than_a_map_is_refused(content: bytes, more: bytes) -> None:
    refused(content + more)


@settings(max_examples=50)
@given(st.sampled_from(GOOD), st.integers(0, SIZE), BAD)
def test_a_map_with_a_number_that_is_none_is_refused(content: bytes, index: int, bad: float) -> None:
    refused(with_number(content, index % (len(content) // 4), bad))


@settings(max_examples=50)
@given(st.sampled_from(GOOD), st.integers(0, 2), st.floats(-2.0, 2.0, width=32))
def test_shares_that_are_none_are_refused(content: bytes, expert: int, share: float) -> None:
    before = struct.unpack_from("<3f", content, 4 * INDEX["shares"])
    shares = [*before[:expert], share, *before[expert + 1 :]]
    assume(min(shares) < 0.0 or abs(sum(shares) - 1.0) > 2e-3)
    refused(with_number(content, INDEX["shares"] + expert, share))


@pytest.mark.parametrize(
    ("name", "at"), [*(("law", k) for k in range(4)), ("law_speed", 0), ("uncertainty", 0), ("uncertainty", 1)]
)
def test_what_cannot_be_negative_is_refused_negative(name: str, at: int) -> None:
    refused(with_number(GOOD[0], INDEX[name] + at, -1.0))


def test_a_map_that_ends_before_it_begins_is_refused() -> None:
    refused(with_number(GOOD[0], INDEX["reached"], -9.5e-3))


@settings(max_examples=50)
@given(st.binary(max_size=4 * SIZE + 8) | st.lists(st.floats(width=32), max_size=SIZE + 2).map(lambda n: as_bytes(n)))
def test_arbitrary_bytes_are_refused(content: bytes) -> None:
    refused(content)


def as_bytes(numbers: list[float]) -> bytes:
    return struct.pack(f"<{len(numbers)}f", *numbers)


@settings(max_examples=75)
@given(
    st.sampled_from(GOOD),
    st.lists(st.tuples(st.integers(0, SIZE), st.floats(width=32)), min_size=1, max_size=4),
    st.floats(-1.0, 1.0),
)
def test_a_map_of_any_numbers_is_refused_or_pulls_no_more_than_it_says(
    content: bytes, changes: list[tuple[int, float]], depth: float
) -> None:
    for index, number in changes:
        content = with_number(content, index % (len(content) // 4), number)
    try:
        model = ContactMapModel(*PARAMETERS, content)
    except SettingError:
        return
    for place in (depth, 1e-3, 0.0):
        _, force, deviation = advance(model, (), place, 0.1, 1e-3)
        assert math.isfinite(force)
        assert force >= -model.record[0].pull
        assert math.isfinite(deviation)


@pytest.mark.parametrize("name", ContactMapModel.parameter_names)
def test_numbers_of_the_law_are_checked(name: str) -> None:
    numbers = dict(zip(ContactMapModel.parameter_names, PARAMETERS, strict=True)) | {name: -1.0}
    with pytest.raises(SettingError, match=rf"{name} = -1\.0: must be finite and at least 0"):
        ContactMapModel(**numbers, map=GOOD[0])


def test_a_map_belongs_to_a_contact_map() -> None:
    with pytest.raises(SettingError, match="map = '3 bytes': hunt-crossley has none"):
        make_model("hunt-crossley", (1.0, 1.0, 1.0), b"abc")
    with pytest.raises(SettingError, match="map = '0 bytes': is no contact map"):
        make_model("contact-map", PARAMETERS)


# --- messages ---------------------------------------------------------------------------------------------------------


def message(model: ContactMapModel, state: tuple[float, ...]) -> ModelUpdate:
    fields = {
        "version": VERSION,
        "sequence": 7,
        "time_ns": 8,
        "command_sequence": 9,
        "law": model.law,
        "parameters": model.parameters,
        "state": state,
        "surface": 0.01,
        "valid": True,
        "reason": "learnt from this sample",
        "estimator": "bank",
        "map": model.map,
    }
    counts = dict.fromkeys(("sequence", "time_ns", "command_sequence"), 0)
    return ModelUpdate(**(counts | fields))


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.tuples(*[st.floats(-0.1, 0.1)] * MEMORY))
def test_a_model_survives_both_wires(seed: int, state: tuple[float, ...]) -> None:
    model = model_of(random_numbers(seed))
    sent = message(model, state)
    layout = Layout(ModelUpdate)
    for arrived in (decode(encode(sent), ModelUpdate), layout.unpack(layout.pack(sent))):
        assert arrived == sent
        again = make_model(arrived.law, arrived.parameters, arrived.map)
        assert again == model
        assert again.map == model.map
        for depth in (-1e-3, 2e-3, 40e-3):
            assert advance(again, arrived.state, depth, 0.1, 1e-3) == advance(model, state, depth, 0.1, 1e-3)


def test_messages_are_small() -> None:
    """Fifty a second of up to 1000 bytes are 50 kB/s: a map of soft material needs half, one with both parts more."""
    state = (0.0123,) * MEMORY
    assert len(encode(message(example_map((0.3, 0.7, 0.0)), state))) < 600
    assert len(encode(message(example_map(), state))) < 1200
    assert len(encode(message(example_map(), state))) - len(example_map().map) < 200


def test_equal_models_are_equal_and_frozen() -> None:
    one, other = example_map(), example_map()
    assert one == other
    assert hash(one) == hash(other)
    assert one != example_map(seed=1)
    assert one != HuntCrossley(3000.0, 1500.0, 1.4)
    with pytest.raises(AttributeError):
        one.stiffness = 1.0  # type: ignore[misc]

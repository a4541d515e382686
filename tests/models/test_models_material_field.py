"""The quadratic law and the field of materials: closed forms, SciPy's interpolation, and hostile bytes."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from foretouch.errors import DecodeError, SettingError
from foretouch.models import MOST_NODES, ContactModel, MaterialField, QuadraticContact, advance

LAW = QuadraticContact(300.0, 4e4, 500.0)
RANDOM = np.random.default_rng(5)
SHAPE = (5, 6, 4)
GRID = np.stack(np.meshgrid(*[np.arange(n) - 2 for n in SHAPE], indexing="ij"), axis=-1).reshape(-1, 3)
VALUES = RANDOM.uniform((100.0, 1e3, 0.0, 5.0), (900.0, 9e4, 800.0, 50.0), (len(GRID), 4)).astype(np.float32)
FIELD = MaterialField(GRID, VALUES, mean=(400.0, 2e4, 100.0), uncertainty=500.0)
H = FIELD.spacing


def test_the_law_is_its_equation() -> None:
    x, v = 0.004, -0.03
    force = 300.0 * x + 4e4 * x * x + 500.0 * x * v
    assert advance(LAW, (), x, v, 1e-3)[1] == pytest.approx(force)
    assert advance(LAW, (), -x, 1.0, 1e-3)[1] == 0.0
    assert advance(LAW, (), x, -10.0, 1e-3)[1] == 0.0  # it never pulls


@given(st.floats(-0.02, 0.05), st.floats(-5.0, 5.0), st.floats(1e-6, 1e-3))
def test_its_slopes_are_finite_differences(depth: float, velocity: float, reach: float) -> None:
    expected = ContactModel.local_slopes(LAW, (), depth, velocity, reach)
    assert LAW.local_slopes((), depth, velocity, reach) == pytest.approx(expected, rel=1e-6, abs=1e-4)


def test_inside_the_lattice_it_is_trilinear_interpolation() -> None:
    axes = [H * (np.arange(n) - 2) for n in SHAPE]
    points = RANDOM.uniform([axis[0] for axis in axes], [axis[-1] for axis in axes], (300, 3))
    result = np.array([[*law.parameters, deviation] for law, deviation, _ in map(FIELD.law_at, points.tolist())])
    for column in range(3):
        scipy = RegularGridInterpolator(axes, VALUES[:, column].reshape(SHAPE).astype(float))
        np.testing.assert_allclose(result[:, column], scipy(points), rtol=1e-12)
    stiffness, deviations = FIELD.stiffness_at(points, 0.003)
    np.testing.assert_allclose(stiffness, result[:, 0] + 0.006 * result[:, 1])
    np.testing.assert_allclose(deviations, result[:, 3])
    shares = np.prod(np.maximum(1.0 - np.abs(points[:, None] - H * GRID) / H, 0.0), axis=2)  # of all nodes, the tent
    np.testing.assert_allclose(deviations, np.sqrt(shares**2 @ VALUES[:, 3].astype(float) ** 2))


def test_at_a_node_it_is_the_node() -> None:
    for index, place in enumerate(FIELD.nodes().tolist()):
        law, deviation, known = FIELD.law_at(place)
        assert known
        assert (*law.parameters, deviation) == pytest.approx(tuple(FIELD.values[index].tolist()), rel=1e-6)


@pytest.mark.parametrize("place", [(1.0, 0.0, 0.0), (1e30, -1e30, 0.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)])
def test_where_nothing_is_known_it_is_the_mean_with_its_uncertainty(place: tuple[float, float, float]) -> None:
    assert FIELD.law_at(place) == (FIELD.mean, 500.0, False)


@given(st.tuples(*[st.floats(-0.04, 0.04)] * 3), st.tuples(*[st.floats(-1e-5, 1e-5)] * 3))
def test_the_law_has_no_steps(place: tuple[float, ...], way: tuple[float, ...]) -> None:
    """Into the unknown too: a probe that slides feels no edge."""
    one, other = FIELD.law_at(place)[0], FIELD.law_at([p + w for p, w in zip(place, way, strict=True)])[0]
    for before, after, largest in zip(one.parameters, other.parameters, (900.0, 9e4, 800.0), strict=True):
        assert abs(after - before) <= 2.0 * largest * sum(map(abs, way)) / H + 1e-9


def test_it_survives_the_wire() -> None:
    content = FIELD.to_bytes()
    again = MaterialField.from_bytes(content)
    assert again == FIELD
    assert hash(again) == hash(FIELD)
    assert again.to_bytes() == content
    assert again.law_at((0.001, 0.002, 0.003)) == FIELD.law_at((0.001, 0.002, 0.003))
    assert len(content) <= 24 * (len(FIELD) + 2)
    nothing = MaterialField([], [], mean=(0.0, 0.0, 0.0), uncertainty=1e3)
    assert MaterialField.from_bytes(nothing.to_bytes()) == nothing


@given(st.binary(max_size=200))
def test_noise_is_no_field(content: bytes) -> None:
    with pytest.raises(DecodeError):
        MaterialField.from_bytes(content)


@given(st.data())
@settings(max_examples=200)
def test_a_field_that_was_tampered_with_is_refused_or_a_field(data: st.DataObject) -> None:
    content = bytearray(FIELD.to_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content)))]
    try:
        field = MaterialField.from_bytes(bytes(content))
    except DecodeError as error:
        assert "\n" not in str(error)  # noqa: PT017 - most are refused, and some are fields
        return
    law, deviation, _ = field.law_at((0.001, 0.0, 0.002))
    assert math.isfinite(advance(law, (), 0.01, 10.0, 1e-3)[1])
    assert math.isfinite(deviation)
    assert MaterialField.from_bytes(field.to_bytes()) == field


def test_every_kind_of_nan_is_refused_and_nothing_is_said_beside_it() -> None:
    """Signalling ones too, at whose conversion NumPy warns."""
    for bits in ("01 00 80 7f", "01 00 80 ff", "00 00 c0 7f", "00 00 80 7f"):
        content = FIELD.to_bytes()
        with pytest.raises(DecodeError, match="finite"):
            MaterialField.from_bytes(content[:-4] + bytes.fromhex(bits))


def node(value: float, at: int) -> list[list[float]]:
    numbers = [1.0, 1.0, 1.0, 1.0]
    numbers[at] = value
    return [numbers]


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 1e20])
@pytest.mark.parametrize("at", range(4))
def test_numbers_out_of_range_are_refused(value: float, at: int) -> None:
    with pytest.raises(SettingError, match="must be finite, 0 to"):
        MaterialField([(0, 0, 0)], node(value, at), mean=(1.0, 1.0, 1.0), uncertainty=1.0)
    with pytest.raises(SettingError, match="must be finite, 0 to"):
        MaterialField([], [], mean=node(value, at)[0][:3], uncertainty=node(value, at)[0][3])


def test_too_many_too_far_and_twice_are_refused() -> None:
    many = [(i, 0, 0) for i in range(MOST_NODES + 1)]
    values = np.ones((MOST_NODES + 1, 4))
    with pytest.raises(SettingError, match="1024 at most"):
        MaterialField(many, values, mean=(1.0, 1.0, 1.0), uncertainty=1.0)
    assert len(MaterialField(many[1:], values[1:], mean=(1.0, 1.0, 1.0), uncertainty=1.0).to_bytes()) < 24 * 1024
    with pytest.raises(SettingError, match="16 bits"):
        MaterialField([(40_000, 0, 0)], values[:1], mean=(1.0, 1.0, 1.0), uncertainty=1.0)
    with pytest.raises(SettingError, match="different"):
        MaterialField([(1, 2, 3)] * 2, values[:2], mean=(1.0, 1.0, 1.0), uncertainty=1.0)
    with pytest.raises(SettingError, match="spacing"):
        MaterialField([], [], mean=(1.0, 1.0, 1.0), uncertainty=1.0, spacing=1e-6)


def test_a_law_costs_the_same_however_large_the_field_is() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(10) - 5] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    large = MaterialField(grid, np.resize(VALUES, (len(grid), 4)), mean=(400.0, 2e4, 100.0), uncertainty=500.0)
    points = RANDOM.uniform(-2.0 * H, H, (2000, 3)).tolist()  # inside both
    costs = {}
    for field in (FIELD, large):
        field.law_at(points[0])
        took = []
        for point in points:
            start = time.perf_counter_ns()
            field.law_at(point)
            took.append(time.perf_counter_ns() - start)
        costs[len(field)] = np.median(took)
    assert costs[len(large)] < 3.0 * costs[len(FIELD)]
